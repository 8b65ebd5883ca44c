"""Sheets of commissioned devices as files of this user, and the key that signs them."""

import os
import secrets
from contextlib import suppress
from pathlib import Path

import msgspec

from cogrip.devices.commissioning_sheet import FORMAT, Sheet
from cogrip.devices.device import DeviceError
from cogrip.devices.io.calibration_store import FOLDER, CalibrationStore, calibration_folder

KEY_BYTES = 32
KEY_FILE = "commissioning.key"
MOST_BYTES = 1 << 20


class SheetStore:
    """Sheets beside the calibrations."""

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder or calibration_folder()
        self._calibrations = CalibrationStore(self._folder)

    def path_of(self, device: str) -> Path:
        """Return the file of one device."""
        path = self._calibrations.path_of(device)
        return path.with_name(f"{path.stem}-commissioned.json")

    def calibration_of(self, device: str) -> bytes:
        """Return what the file of its calibration holds; nothing where there is none. Raises DeviceError."""
        path = self._calibrations.path_of(device)
        try:
            return path.read_bytes()
        except FileNotFoundError:
            return b""
        except OSError as error:
            raise DeviceError(f"{path}: cannot be read: {error.strerror}") from None

    def find(self, device: str) -> Sheet | None:
        """Return the sheet of a device, None where it was never commissioned.

        Raises DeviceError for one that cannot be read, or was changed since it was signed.
        """
        path = self.path_of(device)
        again = f"commission it again: cogrip devices commission '{device}'"
        try:
            with path.open("rb") as file:
                sheet = msgspec.json.decode(file.read(MOST_BYTES), type=Sheet)
        except FileNotFoundError:
            return None
        except (OSError, msgspec.MsgspecError) as error:
            raise DeviceError(f"{path}: cannot be read as a sheet ({error}); {again}") from None
        if sheet.format != FORMAT or self.path_of(sheet.device) != path or not sheet.is_genuine(self._key()):
            raise DeviceError(f"{path}: the sheet was changed since it was signed, or is another device's; {again}")
        return sheet

    def keep(self, sheet: Sheet) -> Path:
        """Sign a sheet and write it in place of the one before. Raises DeviceError where that cannot be."""
        path = self.path_of(sheet.device)
        new = path.with_suffix(f".{os.getpid()}.new")  # two may commission at once
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            new.write_bytes(msgspec.json.format(msgspec.json.encode(sheet.signed(self._key()))) + b"\n")
            new.replace(path)
        except OSError as error:
            raise DeviceError(f"{path}: cannot be written: {error.strerror}; name another folder in {FOLDER}") from None
        return path

    def _key(self) -> bytes:
        """Return this user's key, made at first. Raises DeviceError."""
        path = self._folder / KEY_FILE
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if not path.exists():
                new = path.with_suffix(f".{os.getpid()}.new")
                with os.fdopen(os.open(new, os.O_CREAT | os.O_TRUNC | os.O_WRONLY, 0o600), "wb") as file:
                    file.write(secrets.token_bytes(KEY_BYTES))
                with suppress(FileExistsError):  # of another process, which was first
                    os.link(new, path)
                new.unlink()
            key = path.read_bytes()
        except OSError as error:
            raise DeviceError(f"{path}: {error.strerror}; name another folder in {FOLDER}") from None
        if len(key) != KEY_BYTES:
            raise DeviceError(f"{path}: is no key of {KEY_BYTES} bytes; delete it, and commission the devices again")
        return key
