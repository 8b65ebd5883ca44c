"""Reports of 3Dconnexion's controllers, a cap on a base. Pure.

    report 1  x, y, z as 16-bit numbers, on newer models the rotations too
    report 2  rotations
    report 3  buttons, a bit each

Source: the device table of the package pyspacemouse (`devices.toml`). Raw x is to the right, y toward the user, z down; full
deflection is 350. Rotations are left unread.
"""

from collections.abc import Mapping
from struct import Struct

FULL = 350.0
REPEAT_S = 0.25  # longest silence of a cap that is held away from its rest: it reports some 60 to 120 times a second
_XYZ = Struct("<3h")

USB_IDS: dict[tuple[int, int], str] = {
    (0x046D, 0xC625): "SpacePilot",
    (0x046D, 0xC626): "SpaceNavigator",
    (0x046D, 0xC627): "SpaceExplorer",
    (0x046D, 0xC629): "SpacePilot Pro",
    (0x046D, 0xC62B): "SpaceMouse Pro",
    (0x256F, 0xC62E): "SpaceMouse Wireless",
    (0x256F, 0xC632): "SpaceMouse Pro Wireless",
    (0x256F, 0xC633): "SpaceMouse Enterprise",
    (0x256F, 0xC635): "SpaceMouse Compact",
    (0x256F, 0xC638): "SpaceMouse Pro Wireless",
    (0x256F, 0xC63A): "SpaceMouse Wireless",
    (0x256F, 0xC641): "SpaceMouse",
    (0x256F, 0xC652): "Universal Receiver",
}
"""USB ids -> name."""

MOST_BUTTONS = 32


class SpaceMouseDecoder:
    """See `Decoder`."""

    silence_s = REPEAT_S

    def __init__(self) -> None:
        self.deflection = (0.0, 0.0, 0.0)
        self.buttons = 0
        self.refused = 0
        self.lacks: Mapping[int, str] = {}

    def feed(self, data: bytes) -> None:
        """Take one report."""
        if len(data) >= 1 + _XYZ.size and data[0] == 1:
            right, toward, down = _XYZ.unpack_from(data, 1)
            self.deflection = (_part(toward), _part(right), _part(-down))
        elif len(data) >= 2 and data[0] == 3:
            self.buttons = int.from_bytes(data[1:5], "little")
        elif not data or data[0] in (1, 3):
            self.refused += 1  # too short; what other reports say is not asked for

    def rest(self) -> None:
        """See `Decoder.rest`."""
        self.deflection = (0.0, 0.0, 0.0)


def _part(raw: int) -> float:
    return max(-1.0, min(1.0, raw / FULL))
