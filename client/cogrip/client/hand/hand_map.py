"""The map between a hand and its tool: position scale g, force scale s, rotation R, and the clutch (theory 1.1).

    p_w = p_0 + g R (x_h - x_0)        v_w = g R v_h        F_h = (s / g) R^T F_w

Angles are turned and not scaled, the opening of a gripper is neither; torques, and its force, have the weight of the forces:

    omega_w = R omega_h        tau_h = (s / g^2) R^T tau_w        F_h v_h + tau_h omega_h = (s / g^2) (F_w v_w + tau_w omega_w)

The coupling is of the tool; samples, limits and the device's energy ledger stay the hand's own, so every limit of the device
holds whatever g and s are. A change of either, and the clutch, take the hand's present place as x_0 and the tool's as p_0.
"""

from collections.abc import Sequence
from dataclasses import replace

from cogrip.client.hand.frame import HandFrame
from cogrip.client.hand.velocity import largest_impedance
from cogrip.devices.device import Capability
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES, POSE_AXES
from cogrip.protocol.laws.rotations import UNTURNED, Quaternion, exp, inverse, log, product, turned
from cogrip.protocol.settings.tool_frame import ToolFrame


class HandMap(HandFrame):
    """The map of one seat of `axes` axes: lengths on all of them (`pose_axes`)."""

    def __init__(self, tool: ToolFrame, axes: int) -> None:
        super().__init__()
        self._axes = axes
        self.mapped = True
        self.turns = axes == POSE_AXES
        self._hand_m: Row = (0.0,) * axes
        self._tool_m: Row = self._hand_m
        self._turn: Quaternion = UNTURNED  # orientation of the tool where the hand's is none
        self.begin(tool)

    def begin(self, tool: ToolFrame) -> None:
        """Go by these settings, about the origin."""
        self.tool = tool
        g, s, places = tool.position_scale, tool.force_scale, min(self._axes, PLACES)
        columns = [turned(tool.rotation, [float(axis == column) for axis in range(PLACES)]) for column in range(places)]
        self._rows = [[columns[column][row] for column in range(places)] for row in range(places)]  # R
        self._columns = [list(column[:places]) for column in columns]  # R^T
        self._g, self.power_ratio = g, s / (g * g)
        self.stiffest = tool.stiffest(self._axes)
        self.button = 1 << tool.clutch_button >> 1

    def change(self, tool: ToolFrame, hand_m: Row, pose: Row) -> None:
        """Go by these settings from now on, with hand and tool where they are. pose: the hand's [m, rad]."""
        self._freeze(hand_m, pose)
        self.begin(tool)
        if not self.held:
            self._thaw(hand_m, pose)

    def hold(self, held: bool, hand_m: Row, pose: Row) -> None:
        """Hold the clutch, or release it, with the hand here."""
        if held and not self.held:
            self._freeze(hand_m, pose)
        elif self.held and not held:
            self._thaw(hand_m, pose)
        self.held = held

    def _freeze(self, hand_m: Row, pose: Row) -> None:
        """Keep the tool's place and orientation."""
        if not self.held:
            self._tool_m = self.place(hand_m)
            if self.turns:
                self._turn = self._orientation(pose[PLACES:])

    def _thaw(self, hand_m: Row, pose: Row) -> None:
        """Have the tool, as it was kept, go on with the hand."""
        self._hand_m = hand_m
        if self.turns:
            kept, self._turn = self._turn, UNTURNED
            self._turn = product(inverse(self._orientation(pose[PLACES:])), kept)

    def _orientation(self, rotation_rad: Sequence[float]) -> Quaternion:
        """Return the tool's orientation for the hand's rotation vector."""
        return product(exp(turned(self.tool.rotation, rotation_rad)), self._turn)

    def rotation(self, rotation_rad: Sequence[float]) -> Row:
        """Return the tool's rotation vector for the hand's [rad]."""
        return log(self._turn if self.held else self._orientation(rotation_rad))

    def rates(self, hand: Sequence[float]) -> Row:
        """Return velocities of the tool for those of the hand, or differences."""
        x = [self._g * part for part in _times(self._rows, hand)]
        return (*x, *self._behind(self._rows, hand)) if self._axes > PLACES else tuple(x)

    def _behind(self, rows: Sequence[Sequence[float]], values: Sequence[float]) -> Sequence[float]:
        """Return what becomes of the axes behind the places."""
        return _times(rows, values[PLACES:]) if self.turns else values[PLACES:]

    def shown(self, hand: Sequence[float]) -> Row:
        """Return velocities as the world sees them: none while the clutch is held."""
        return (0.0,) * len(hand) if self.held else self.rates(hand)

    def place(self, hand_m: Sequence[float]) -> Row:
        """Return the tool's place for the hand's."""
        if self.held:
            return self._tool_m
        moved = self.rates([at - begun for at, begun in zip(hand_m, self._hand_m, strict=True)])
        return tuple([at + by for at, by in zip(self._tool_m, moved, strict=True)])

    def hand_force(self, force_n: Sequence[float]) -> list[float]:
        """Return the force on the hand for that on the tool."""
        ratio = self.power_ratio
        x = [ratio * self._g * part for part in _times(self._columns, force_n)]
        return x + [ratio * part for part in self._behind(self._columns, force_n)] if self._axes > PLACES else x

    def tool_force(self, force_n: Sequence[float]) -> Row:
        """Return the force on the tool for that on the hand."""
        per = 1.0 / self.power_ratio
        x = [per / self._g * part for part in _times(self._rows, force_n)]
        return (*x, *[per * part for part in self._behind(self._rows, force_n)]) if self._axes > PLACES else tuple(x)

    def record(self, record: Capability, tick_s: float) -> Capability:
        """Return a device's record as the tool's coupling sees it: speed, force, and the impedance that it carries."""
        per_force = 1.0 / (self.power_ratio * min(self._g, 1.0) if self._axes > PLACES else self.power_ratio * self._g)
        carried = largest_impedance(record, tick_s).impedance_nspm / self.stiffest
        return replace(
            record, speed_mps=record.speed_mps * (max(self._g, 1.0) if self._axes > PLACES else self._g),
            peak_force_n=record.peak_force_n * per_force, continuous_force_n=record.continuous_force_n * per_force,
            damping_nspm=min(carried, record.damping_nspm / self.stiffest), resolution_m=0.0,
            apparent_mass_kg=record.apparent_mass_kg / self.stiffest,
        )  # fmt: skip


def _times(rows: Sequence[Sequence[float]], vector: Sequence[float]) -> list[float]:
    return [add_floats([a * b for a, b in zip(row, vector, strict=False)]) for row in rows]
