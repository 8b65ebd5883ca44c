"""Folders of the source tree, from the lowest layer to the highest; each has a package of its name."""

FOLDERS = (
    "machine", "protocol", "devices", "client", "server", "sim", "results", "analysis", "experiments", "view", "cli", "api",
)  # fmt: skip
