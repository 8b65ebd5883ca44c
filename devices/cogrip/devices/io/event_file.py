"""A gamepad's event file on Linux: whole events, its axes' ranges, and its motors."""

import errno
import os
from contextlib import suppress
from pathlib import Path
from struct import unpack, unpack_from

from cogrip.devices.device import DeviceError
from cogrip.devices.io.platform import LINUX, control, open_without_waiting
from cogrip.devices.steered.gamepad import EVENT_BYTES, STEERING, GamepadDecoder, gamepads, play, rumble_effect

LISTING = Path("/proc/bus/input/devices")
MOST_EVENTS = 64
_READ, _WRITE = 2, 1
RULE = 'a udev rule (SUBSYSTEM=="input", ENV{ID_INPUT_JOYSTICK}=="1", TAG+="uaccess": configs/99-cogrip.rules)'


def _request(direction: int, number: int, size: int) -> int:
    """Return an ioctl request of the input system: _IOC(direction, 'E', number, size)."""
    return direction << 30 | size << 16 | ord("E") << 8 | number


def found_gamepads(listing: Path = LISTING) -> list[tuple[str, str]]:
    """Return (event file, name) of each that is plugged in; none where the system is not Linux."""
    try:
        return gamepads(listing.read_text(errors="replace"))
    except OSError:
        return []


class EventFile:
    """See `Link` of `steered.device`. path: "" for the first gamepad."""

    def __init__(self, name: str, path: str) -> None:
        self.name = name
        self._path = path
        self._file = -1
        self._effect = -1

    def open(self) -> GamepadDecoder:
        """Raises DeviceError where there is none, or where it may not be opened."""
        if not LINUX:
            raise DeviceError(f"{self.name}: gamepads are read by Linux's event files; take another device here")
        path = self._path or next((path for path, _ in found_gamepads()), "")
        if not path:
            raise DeviceError(
                f"{self.name}: no gamepad is there; plug one in, or name its file: gamepad:/dev/input/event5"
            )
        try:
            self._file = self._opened(path)
        except PermissionError:
            raise DeviceError(
                f"{self.name}: {path} may not be opened; give yourself the right to it by {RULE}"
            ) from None
        except OSError as error:
            raise DeviceError(f"{self.name}: {path} cannot be opened ({error.strerror}); plug it in") from None
        return GamepadDecoder(self._ranges())

    @staticmethod
    def _opened(path: str) -> int:
        """Return a descriptor, to write as well where that is allowed: its motors need it. Raises OSError."""
        try:
            return open_without_waiting(path, os.O_RDWR)
        except PermissionError:
            return open_without_waiting(path, os.O_RDONLY)

    def _ranges(self) -> dict[int, tuple[int, int]]:
        """Return the ranges of the axes that there are; a stand-in that is no event file has none.

        The system answers with a range of 0 to 0 for an axis that there is not.
        """
        found = {}
        for code in STEERING:
            with suppress(OSError):
                answer = control(self._file, _request(_READ, 0x40 + code, 24), bytes(24))
                _, low, high = unpack_from("@3i", answer)
                if high > low:
                    found[code] = (low, high)
        return found

    def receive(self) -> list[bytes]:
        """Return the events that wait. Raises DeviceError where it is unplugged."""
        try:
            data = os.read(self._file, MOST_EVENTS * EVENT_BYTES)
        except BlockingIOError:
            return []
        except OSError as error:
            why = "" if error.errno == errno.ENODEV else f" ({error.strerror})"
            raise DeviceError(f"{self.name}: unplugged{why}; plug it in again, then re-arm") from None
        if not data:
            raise DeviceError(f"{self.name}: unplugged; plug it in again, then re-arm")
        return [data]

    def rumble(self, strength: float) -> None:
        """Nothing happens where it has no motors, or may only be read."""
        with suppress(OSError):
            answer = control(self._file, _request(_WRITE, 0x80, 48), rumble_effect(self._effect, strength))
            (self._effect,) = unpack("@h", answer[2:4])
            os.write(self._file, play(self._effect, int(strength > 0.0)))

    def close(self) -> None:
        file, self._file = self._file, -1
        if file >= 0:
            if self._effect >= 0:
                with suppress(OSError):
                    os.write(file, play(self._effect, 0))
            self._effect = -1
            os.close(file)
