"""The Force Dimension SDK (libdrd), through the package `forcedimension_core`. Importing that loads it: once in a process."""

import os
from contextlib import redirect_stderr
from importlib import import_module
from io import StringIO
from pathlib import Path

from cogrip.devices.device import DeviceError
from cogrip.devices.forcedimension.sdk import Sdk

SDK_FOLDER = "FDSDK"  # environment variable in which the package looks for the SDK

CURE = f"install the vendor's SDK, 3.16 or later, and name its folder with sdk=FOLDER or in {SDK_FOLDER}"


def load(folder: str) -> Sdk:
    """The SDK in `folder`, "" for where the package looks by itself. Raises DeviceError."""
    before = os.environ.get(SDK_FOLDER)
    if folder:
        os.environ[SDK_FOLDER] = folder  # the package takes no argument
    said = StringIO()  # it writes its reason where a terminal may be drawn upon
    try:
        with redirect_stderr(said):
            dhd = import_module("forcedimension_core.dhd")
            containers = import_module("forcedimension_core.containers")
            runtime = import_module("forcedimension_core.runtime")
    except ModuleNotFoundError as error:
        raise DeviceError(
            f"forcedimension: needs the package {error.name!r}: pip install 'cogrip[forcedimension]'"
        ) from None
    except (ImportError, AttributeError, OSError) as error:
        reason = " ".join(said.getvalue().split()) or str(error)
        raise DeviceError(f"forcedimension: the SDK cannot be loaded ({reason}); {CURE}") from None
    finally:
        if folder:
            os.environ.pop(SDK_FOLDER)
            if before is not None:
                os.environ[SDK_FOLDER] = before
    loaded = str(getattr(runtime._libdrd, "_name", ""))
    if folder and not Path(loaded).parent.resolve().is_relative_to(Path(folder).resolve()):
        raise DeviceError(f"forcedimension: sdk={folder} has no library, or {loaded} was loaded before; {CURE}")
    return Sdk(dhd, containers.Status, lambda number: int(runtime._libdhd.dhdGetSystemType(number)))
