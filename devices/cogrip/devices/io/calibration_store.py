"""Calibrations as files of this user: one JSON for each device, replaced as a whole; identified losses beside them."""

import hashlib
import os
import re
from pathlib import Path
from typing import TypeVar

import msgspec

from cogrip.devices.arm.pose import Calibration, OwnLosses
from cogrip.devices.device import DeviceError
from cogrip.devices.io.platform import config_folder

_Kept = TypeVar("_Kept", Calibration, OwnLosses)
FOLDER = "COGRIP_CALIBRATION"  # environment variable that names another folder


def calibration_folder() -> Path:
    """Return the folder of this user's calibrations."""
    if named := os.environ.get(FOLDER):
        return Path(named)
    return config_folder() / "cogrip" / "calibration"


class CalibrationStore:
    """See `Store`."""

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder or calibration_folder()

    def path_of(self, device: str) -> Path:
        """The file of one device: a name that people can read, and a digest that tells alike ones apart.

        A device node is the same one by any link to it; a link may lead to another node when the device is plugged in again.
        """
        scheme, _, place = device.partition(":")
        if place.startswith("/"):
            node, mark, keys = place.partition("?")
            device = f"{scheme}:{os.path.realpath(node)}{mark}{keys}"
        readable = re.sub(r"[^A-Za-z0-9]+", "-", device).strip("-")[:60]
        digest = hashlib.sha256(device.encode("utf-8", "surrogatepass")).hexdigest()
        return self._folder / f"{readable}-{digest[:8]}.json"

    def find(self, device: str) -> Calibration | None:
        """None where there is none. Raises DeviceError for a file that is none of ours."""
        return self._read(self.path_of(device), device, Calibration)

    def find_losses(self, device: str) -> OwnLosses | None:
        """None where they were never identified. Raises DeviceError for a file that is none of ours."""
        return self._read(self._losses_path(device), device, OwnLosses)

    def _losses_path(self, device: str) -> Path:
        path = self.path_of(device)
        return path.with_name(f"{path.stem}-damping.json")

    def _read(self, path: Path, device: str, kind: type[_Kept]) -> _Kept | None:
        try:
            return msgspec.json.decode(path.read_bytes(), type=kind)
        except FileNotFoundError:
            return None
        except (OSError, msgspec.MsgspecError) as error:
            raise DeviceError(
                f"{path}: cannot be read as a calibration ({error}); delete it and calibrate {device} again"
            ) from None

    def keep(self, calibration: Calibration) -> Path:
        """Write it. Raises DeviceError where that cannot be."""
        return self._write(self.path_of(calibration.device), calibration)

    def keep_losses(self, losses: OwnLosses) -> Path:
        """Write them. Raises DeviceError where that cannot be."""
        return self._write(self._losses_path(losses.device), losses)

    def _write(self, path: Path, kept: Calibration | OwnLosses) -> Path:
        new = path.with_suffix(".new")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            new.write_bytes(msgspec.json.format(msgspec.json.encode(kept)) + b"\n")
            new.replace(path)
        except OSError as error:
            raise DeviceError(f"{path}: cannot be written: {error.strerror}; name another folder in {FOLDER}") from None
        return path
