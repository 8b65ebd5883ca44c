"""Events of gamepads on Linux, and the effect that makes them rumble. Pure.

Source: linux/input.h and input-event-codes.h, and the kernel's page on gamepads: ABS_X and ABS_Y are the left stick's, to the
right and down (toward the user), ABS_RY the right stick's, or ABS_RZ where there is none (joysticks, and gamepads that are read
as such: elsewhere it is a trigger), BTN_SOUTH and on the buttons. A time is two longs.
"""

from collections.abc import Mapping
from struct import Struct, pack

EV_SYN, EV_KEY, EV_ABS, EV_FF = 0x00, 0x01, 0x03, 0x15
SYN_DROPPED = 3
ABS_X, ABS_Y, ABS_RY, ABS_RZ = 0x00, 0x01, 0x04, 0x05
STEERING = (ABS_Y, ABS_X, ABS_RY, ABS_RZ)  # axes that point toward the user, right, down, and down on other gamepads
BTN_JOYSTICK, BTN_GAMEPAD = 0x120, 0x130
BUTTONS = 16  # most buttons of a joystick, and of a gamepad
FF_RUMBLE = 0x50
RUMBLE_MS = 500  # time for which a motor turns, unless it is told anew

_EVENT = Struct("@llHHi")
EVENT_BYTES = _EVENT.size

Ranges = Mapping[int, tuple[int, int]]
"""Axis code -> (least, largest) value, of the axes that there are; empty where not known: most gamepads' hold then."""


class GamepadDecoder:
    """See `Decoder`. dropped: times that the system lost events, so that all is taken as released until it is told anew."""

    silence_s = 0.0  # a stick that is held still says nothing

    def __init__(self, ranges: Ranges) -> None:
        down = ABS_RZ if ABS_RZ in ranges and ABS_RY not in ranges else ABS_RY
        self._down = down
        needed = ((ABS_Y, "ABS_Y"), (ABS_X, "ABS_X"), (down, "ABS_RY or ABS_RZ"))
        self.lacks: Mapping[int, str] = {
            axis: name for axis, (code, name) in enumerate(needed) if ranges and code not in ranges
        }
        self.deflection = (0.0, 0.0, 0.0)
        self.buttons = 0
        self.refused = 0
        self.dropped = 0
        self._ranges = ranges

    def feed(self, data: bytes) -> None:
        """Take whole events."""
        if len(data) % EVENT_BYTES:
            self.refused += 1
        for _, _, kind, code, value in _EVENT.iter_unpack(data[: len(data) - len(data) % EVENT_BYTES]):
            if kind == EV_ABS and code in (ABS_Y, ABS_X, self._down):
                self._move(code, value)
            elif kind == EV_KEY and BTN_JOYSTICK <= code < BTN_GAMEPAD + BUTTONS:
                bit = 1 << (code % BUTTONS)
                self.buttons = self.buttons | bit if value else self.buttons & ~bit
            elif kind == EV_SYN and code == SYN_DROPPED:
                self.dropped += 1
                self.refused += 1
                self.rest()
                self.buttons = 0

    def _move(self, code: int, value: int) -> None:
        low, high = self._ranges.get(code, (-32768, 32767))
        part = max(-1.0, min(1.0, (2.0 * value - low - high) / (high - low))) if high > low else 0.0
        toward, right, up = self.deflection
        if code == ABS_Y:
            toward = part
        elif code == ABS_X:
            right = part
        else:
            up = -part
        self.deflection = (toward, right, up)

    def rest(self) -> None:
        """See `Decoder.rest`."""
        self.deflection = (0.0, 0.0, 0.0)


def rumble_effect(number: int, strength: float) -> bytes:
    """Return struct ff_effect: both motors with 0 to 1 of what they can; number: of the effect, -1 for a new one."""
    level = round(65535 * max(0.0, min(1.0, strength)))
    head = pack("@HhHHHHH", FF_RUMBLE, number, 0, 0, 0, RUMBLE_MS, 0)
    return (head.ljust(16, b"\0") + pack("@HH", level, level)).ljust(48, b"\0")


def play(number: int, times: int) -> bytes:
    """Return the event that plays an effect; 0 times stops it."""
    return _EVENT.pack(0, 0, EV_FF, number, times)


def gamepads(listing: str) -> list[tuple[str, str]]:
    """Return (event file, name) of each joystick in the text of /proc/bus/input/devices."""
    found = []
    for block in listing.split("\n\n"):
        lines = {line[0]: line[3:] for line in block.splitlines() if line[1:3] == ": " and line[0] in "NH"}
        handlers = lines.get("H", "").removeprefix("Handlers=").split()
        events = [each for each in handlers if each.startswith("event")]
        if events and any(each.startswith("js") for each in handlers):
            found.append((f"/dev/input/{events[0]}", lines.get("N", "").removeprefix("Name=").strip('"')))
    return found
