"""Hand that is led from place to place: approach, squeeze, lift, carry, set down, let go.

At time t_i it intends place p_i, from home; between two times it goes there by a minimum-jerk stroke, as `reach` does;
before the first and after the last it rests. Led d into something that gives way by x, it presses with K_h (d - x).
On a machine that turns it goes from one rotation vector to the next in the same way.
"""

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise

from cogrip.devices.device import DeviceError
from cogrip.devices.settings import Finite, NotNegative
from cogrip.devices.simulated.hands import ImpedanceSettings
from cogrip.devices.simulated.pose import pose_drive
from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES
from cogrip.protocol.laws.rotations import between, exp


class WaypointSettings(ImpedanceSettings, frozen=True, kw_only=True):
    """Query keys of `waypoints`: times, rising, and the pose at each along each axis; an axis that is not given rests."""

    times_s: tuple[NotNegative, ...]
    x_m: tuple[Finite, ...] = ()
    y_m: tuple[Finite, ...] = ()
    z_m: tuple[Finite, ...] = ()
    rx_rad: tuple[Finite, ...] = ()
    ry_rad: tuple[Finite, ...] = ()
    rz_rad: tuple[Finite, ...] = ()


class WaypointHand:
    """See `Hand`."""

    def __init__(self, settings: WaypointSettings, axes: int) -> None:
        self.stiffness_npm, self.damping_nspm = settings.hand_stiffness_npm, settings.hand_damping_nspm
        self._times = times = settings.times_s
        if any(late <= early for early, late in pairwise(times)):
            raise DeviceError(
                f"hand=waypoints: times_s={','.join(map(str, times))} do not rise; give each later than the last"
            )
        courses = []
        for axis, key in enumerate(("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")):
            course: Row = getattr(settings, key)
            if course and axis >= axes:
                raise DeviceError(f"hand=waypoints: {key} is given, but the device has {axes} axes; leave it out")
            if course and len(course) != len(times):
                raise DeviceError(
                    f"hand=waypoints: {key} has {len(course)} places for {len(times)} times; give {len(times)}"
                )
            courses.append(course or (0.0,) * len(times))
        self._places = list(zip(*courses[:axes], strict=True))
        self._rate_hz = 1
        self._start_at((0.0,) * axes)

    def _start_at(self, home: Row) -> None:
        """Set the place at each time; then, for each stroke, places and strokes by axis, the strokes, and its time."""
        self._home = home
        self._at = [tuple([begin + x for begin, x in zip(home, place, strict=True)]) for place in self._places]
        steps = [tuple([b - a for a, b in zip(here, there, strict=True)]) for here, there in pairwise(self._places)]
        k = self.stiffness_npm
        self._rest = [
            [k * x for x in at] for at in (*self._at[:1], *self._at[-1:])
        ]  # drive before the first time, and after the last
        self._strokes = [
            (list(zip(at, step, strict=True)), step, late - early)
            for at, step, (early, late) in zip(self._at, steps, pairwise(self._times), strict=False)
        ]

    def open(self, rate_hz: int, home_m: Row | None) -> Row:
        """See `Hand.open`."""
        self._rate_hz = rate_hz
        self._start_at(home_m or (0.0,) * len(self._home))
        return self._home

    def _course(self, tick: int) -> tuple[Row, Row]:
        """Return place, or pose, and its rates."""
        now, times = tick / self._rate_hz, self._times
        after = bisect_right(times, now)
        at = self._at[max(0, after - 1)]
        if after in (0, len(times)):
            return at, (0.0,) * len(at)
        pairs, step, stroke_s = self._strokes[after - 1]
        s, w = _stroke((now - times[after - 1]) / stroke_s, stroke_s)
        return tuple([start + s * stroke for start, stroke in pairs]), tuple([w * stroke for stroke in step])

    def intended(self, tick: int) -> tuple[Row, Row]:
        place, rates = self._course(tick)
        if len(place) > PLACES and any(rates[PLACES:]):  # rates of a rotation vector are no angular velocity
            step = between(exp(place[PLACES:]), exp(self._course(tick + 1)[0][PLACES:]))
            rates = rates[:PLACES] + tuple([self._rate_hz * each for each in step])
        return place, rates

    def drive(self, tick: int) -> Sequence[float]:
        if len(self._home) > PLACES:
            return pose_drive(self, tick)
        now, times = tick / self._rate_hz, self._times
        after = bisect_right(times, now)
        if after in (0, len(times)):
            return self._rest[after > 0]
        pairs, _, stroke_s = self._strokes[after - 1]
        s, w = _stroke((now - times[after - 1]) / stroke_s, stroke_s)
        k, b = self.stiffness_npm, self.damping_nspm
        if len(pairs) == PLACES:  # as below, without a loop
            (x, dx), (y, dy), (z, dz) = pairs
            return [k * (x + s * dx) + b * (w * dx), k * (y + s * dy) + b * (w * dy), k * (z + s * dz) + b * (w * dz)]
        return [k * (start + s * stroke) + b * (w * stroke) for start, stroke in pairs]


def _stroke(z: float, stroke_s: float) -> tuple[float, float]:
    """Return the part of a minimum-jerk stroke that is done after the part z of its time, and its rate [1/s]."""
    return z * z * z * (10.0 + z * (6.0 * z - 15.0)), 30.0 * z * z * (1.0 - z) ** 2 / stroke_s
