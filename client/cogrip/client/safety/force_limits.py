"""Limits of one group of a device's axes, the first three or those after them: peak, warm motors, slope.

Each group has its own: force, torque and the force of a gripper are of different motors. Symbols: forces [N], shape (axes of
the group,); of the axes after the first three forces on lengths (`pose_axes`, `grip_axes`), which `shown` turns back.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import dist

from cogrip.client.hand.further_axes import further_axes
from cogrip.client.hand.handle import BEYOND
from cogrip.client.rows.row_size import change_surely_below
from cogrip.client.safety.thermal import ThermalLimit
from cogrip.devices.device import MOST_SLOPE_NPS, Capability
from cogrip.machine.addition import add_floats
from cogrip.protocol.axes import PLACES

SOFT_SLOPE_NPS = 410.0  # largest slope after a gap: 0.4 N a tick at 1024 Hz
SOFT_S = 0.05  # time after a gap in which the force may still return to the law with that slope


@dataclass(frozen=True, slots=True)
class ForceBounds:
    """Bounds of a group: forces [N], slope [N/s], speed [m/s]. A message shows `per_unit` times a force in `unit`.

    range_m: where readings of the group can be, as lengths; None: anywhere
    """

    peak_n: float
    continuous_n: float
    slew_nps: float
    speed_mps: float
    per_unit: float = 1.0
    unit: str = "N"
    rate_unit: str = "m/s"
    range_m: tuple[float, float] | None = None

    def shown(self, force_n: float) -> str:
        """Return a force, a torque, or the force of a gripper, with its unit."""
        return f"{self.per_unit * force_n:g} {self.unit}"


def bounds_of(record: Capability, length_scale: float) -> tuple[ForceBounds, ...]:
    """Return the bounds of the first three axes, then of those after them, where there are any."""
    places = ForceBounds(record.peak_force_n, record.continuous_force_n, record.slew_nps, record.speed_mps)
    other = further_axes(record, length_scale)
    if other is None:
        return (places,)
    units, range_m = ("N m", "rad/s"), None
    if record.gripper is not None and record.grip_m is not None:
        closed, opened = record.grip_m
        beyond = BEYOND * (opened - closed)
        units, range_m = (
            ("N at the gripper", "m/s at the gripper"),
            (length_scale * (closed - beyond), length_scale * (opened + beyond)),
        )
    return places, ForceBounds(
        other.peak_n, other.continuous_n, other.slew_nps, other.speed_mps, length_scale, *units, range_m
    )


class ForceLimits:
    """Limits of one group. A tick: `clip` the law's force where there is one, then `follow` it. The caller clears the flags.

    out      force that went to the motors last
    limited  whether a limit held the force of this tick; `derated` whether warm motors did, `over` whether the peak did
    """

    def __init__(self, bounds: ForceBounds, axes: int, tick_s: float, note: Callable[[str], None]) -> None:
        self._tick_s = tick_s
        self._note = note
        self.thermal = ThermalLimit(tick_s, bounds.peak_n, bounds.continuous_n)
        self._soft_n = SOFT_SLOPE_NPS * tick_s
        self._soft_ticks = round(SOFT_S / tick_s)
        self._soft_left = 0
        self.out: tuple[float, ...] = (0.0,) * axes
        self.limited = self.derated = self.over = False
        self.set_bounds(bounds)

    def set_bounds(self, bounds: ForceBounds) -> None:
        """Set the bounds."""
        self.bounds, self._peak_n = bounds, bounds.peak_n
        self.thermal.set_limits(bounds.peak_n, bounds.continuous_n)
        self._slope_n = min(bounds.slew_nps, MOST_SLOPE_NPS) * self._tick_s

    def clip(self, force_n: Sequence[float], size_n: float) -> Sequence[float]:
        """Return the force, scaled down to the limit of peak and warm motors. size_n: its size."""
        most_n = self.thermal.limit_n
        if size_n <= most_n:
            return force_n
        scale = most_n / size_n
        self.limited, self.derated = True, most_n < self._peak_n
        self.over = size_n > self._peak_n and not self.derated
        return [value * scale for value in force_n]

    def follow(self, wanted: tuple[float, ...], gap: bool, fall: float) -> tuple[float, ...]:
        """Return the force for the motors, limited in slope, and heat them. fall: of the peak a tick, allowed in a gap."""
        if gap or self._soft_left:
            wanted = self._soften(wanted, gap, fall)
        if not change_surely_below(wanted, self.out, self._slope_n) and dist(wanted, self.out) > self._slope_n:
            wanted, self.limited = self._slew(wanted, self._slope_n, "slew limited"), True
        self.out = wanted
        self.enter()
        return wanted

    def soften(self) -> None:
        """Limit the slope to SOFT_SLOPE_NPS, as after a gap, until the force has reached the law's, which has changed."""
        self._soft_left = self._soft_ticks

    def enter(self) -> None:
        """Heat the motors' model by one tick of the force that went to them."""
        square = 0.0
        if len(self.out) == PLACES:  # as below, without a loop
            x, y, z = self.out
            square = x * x + y * y + z * z
        else:
            for value in self.out:
                square += value * value
        self.thermal.enter(square)

    def correct(self, force_n: tuple[float, ...], goes_on: bool) -> None:
        """Correct heat and, where `goes_on`, slope by the force that acts in place of `out`."""
        entered, square = [add_floats([value * value for value in force]) for force in (self.out, force_n)]
        self.thermal.correct(entered, square)
        if goes_on:
            self.out = force_n

    def _soften(self, wanted: tuple[float, ...], gap: bool, fall: float) -> tuple[float, ...]:
        """Limit the slope in a gap, and after it until the force has met the law again."""
        out = self._slew(wanted, max(self._soft_n, self._peak_n * fall), "gap softened")
        if gap:
            self._soft_left = self._soft_ticks
        elif out is wanted:
            self._soft_left = 0
        else:
            self._soft_left -= 1
        return out

    def _slew(self, wanted: tuple[float, ...], most_n: float, name: str) -> tuple[float, ...]:
        """Limit the force to `most_n` around the last one."""
        change = dist(wanted, self.out)
        if change <= most_n:
            return wanted
        self._note(name)
        fraction = most_n / change
        return tuple([old + fraction * (new - old) for old, new in zip(self.out, wanted, strict=True)])
