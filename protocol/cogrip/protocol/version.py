"""The version of this software, as installed."""

from importlib.metadata import PackageNotFoundError, version

try:
    VERSION = version("cogrip")
except PackageNotFoundError:  # run from a checkout that is on the path but not installed
    VERSION = "0+unknown"
