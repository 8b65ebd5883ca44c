"""The frame of the hand: how it moves its tool. Here the tool moves as the hand does; `HandMap` scales, turns and holds it."""

from collections.abc import Sequence

from cogrip.devices.device import Capability
from cogrip.machine.rows import Row
from cogrip.protocol.settings.tool_frame import ToolFrame


class HandFrame:
    """Tool and hand are at one place, and what acts on one acts on the other.

    tool         settings of the frame
    mapped       whether the tool moves otherwise than the hand
    power_ratio  s / g^2: power at the hand by power at the tool
    stiffest     impedance, or stiffness, at the hand by that of the tool
    turns        whether the hand turns its tool
    held         whether the clutch is held: the tool stands still; `asked` whether it is to be, whatever its button does
    button       bit of that button in `Sample.buttons`
    """

    def __init__(self) -> None:
        self.tool = ToolFrame()
        self.mapped = self.turns = self.held = self.asked = False
        self.power_ratio = self.stiffest = 1.0
        self.button = 0

    def place(self, hand_m: Row) -> Row:
        """Return the tool's place for the hand's."""
        return hand_m

    def rates(self, hand: Sequence[float]) -> Sequence[float]:
        """Return velocities of the tool for those of the hand, or differences."""
        return hand

    def shown(self, hand: Sequence[float]) -> Sequence[float]:
        """Return velocities as the world sees them: none while the clutch is held."""
        return hand

    def rotation(self, rotation_rad: Row) -> Row:
        """Return the tool's rotation vector for the hand's [rad]."""
        return rotation_rad

    def hand_force(self, force_n: Sequence[float]) -> Sequence[float]:
        """Return the force on the hand for that on the tool."""
        return force_n

    def tool_force(self, force_n: Sequence[float]) -> Sequence[float]:
        """Return the force on the tool for that on the hand."""
        return force_n

    def record(self, record: Capability, tick_s: float) -> Capability:
        """Return a device's record as the tool's coupling sees it: speed, force, and the impedance that it carries."""
        return record
