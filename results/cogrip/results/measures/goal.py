"""Goal of a trial: the object in its place for a while; and the course that it is to follow.

A goal is reached at the first moment from which the object stays within `within_m` of `place_m` for `dwell_s`.
"""

from collections.abc import Sequence
from math import dist

import msgspec

from cogrip.devices.device import DeviceError
from cogrip.devices.family.simulated import make as make_simulated
from cogrip.devices.settings import parse_address
from cogrip.devices.simulated.simulated_device import SimulatedDevice
from cogrip.protocol.axes import PLACES

Vector = tuple[float, ...]


class Goal(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[goal]. place_m: of the object, from where it starts; axes that are not given are not looked at.

    track: hand whose intended motion the object is to follow, such as sine&amplitude_m=0.02&frequency_hz=0.5.
    """

    place_m: tuple[float, ...] = ()
    within_m: float | None = None
    dwell_s: float = 0.0
    track: str = ""

    @property
    def stated(self) -> bool:
        """Return whether there is a place to be reached."""
        return bool(self.place_m) and self.within_m is not None


NO_GOAL = Goal()
_ROUNDING_S = 1e-9


class GoalWatch:
    """Watches the object, a sample at a time. reached_s: when the goal was reached, None if it is not."""

    def __init__(self, goal: Goal) -> None:
        self._goal = goal
        self._start: Vector | None = None
        self._inside_since: float | None = None
        self.reached_s: float | None = None

    def look(self, time_s: float, object_m: Sequence[float]) -> bool:
        """Take where the object is. Return whether the goal is reached."""
        if self._start is None:
            self._start = tuple(object_m)
        if self.reached_s is not None or self._goal.within_m is None:
            return self.reached_s is not None
        moved = [x - start for x, start in zip(object_m, self._start, strict=True)]
        wanted = self._goal.place_m[: len(moved)]
        if dist(moved[: len(wanted)], wanted) > self._goal.within_m:
            self._inside_since = None
            return False
        if self._inside_since is None:
            self._inside_since = time_s
        if time_s - self._inside_since < self._goal.dwell_s - _ROUNDING_S:
            return False
        self.reached_s = self._inside_since
        return True


def course(track: str, axes: int, times_s: Sequence[float]) -> list[Vector]:
    """Return the places [m] of a course at these times, from its start, shape (n, axes). Raises DeviceError."""
    rate_hz = 100_000  # of the clock on which a course is asked; its ticks are whole
    device = make_simulated(parse_address(f"sim:ideal?hand={track}"), min(axes, PLACES), {})
    assert isinstance(device, SimulatedDevice)
    hand = device.hand
    home = hand.open(rate_hz, None)
    found = (hand.intended(round(time_s * rate_hz))[0] for time_s in times_s)
    return [tuple(x - start for x, start in zip(place, home, strict=True)) for place in found]


def unfit_goal(goal: Goal, axes: int) -> str:
    """Return why a goal cannot be reached, "" if it can, and if there is none."""
    if bool(goal.place_m) != (goal.within_m is not None):
        return "goal.place_m and goal.within_m go together; give both, or neither"
    if len(goal.place_m) > axes:
        return f"goal.place_m has {len(goal.place_m)} places, and the object {axes} axes; leave the last out"
    if goal.within_m is not None and not goal.within_m > 0.0:
        return f"goal.within_m = {goal.within_m:g} must be above 0"
    if not goal.dwell_s >= 0.0:
        return f"goal.dwell_s = {goal.dwell_s:g} must be at least 0"
    if goal.track:
        try:
            course(goal.track, axes, [0.0])
        except DeviceError as error:
            return f"goal.track: {error}"
    return ""
