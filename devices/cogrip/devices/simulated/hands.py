"""Simulated hands: an intended motion behind an impedance, or a pure force.

    F_hand = K_h (x_int - x) + B_h (v_int - v) + F_push

symbols, per axis: F_hand force of the hand on the device [N]; x_int [m], v_int [m/s] intended motion; K_h [N/m], B_h [N s/m]
the hand's impedance; F_push force that is added to it [N]; x [m], v [m/s] the device. A plant keeps K_h x and B_h v on its own
side and takes the rest as the hand's `drive` of a tick, K_h x_int + B_h v_int + F_push [N].

Time on the hand's clock is tick / rate_hz. `direction` is used as given, not normalised: amplitude and force along
axis i are multiplied by direction[i]; missing components are 0.
"""

from collections.abc import Callable, Sequence
from math import cos, exp, floor, inf, pi, sin, sqrt
from random import Random
from typing import Annotated, Any, Protocol, TypeAlias

import msgspec
from msgspec import Meta

from cogrip.devices.settings import Finite, NotNegative, Positive, fit_axes
from cogrip.machine.rows import Row

Course: TypeAlias = Callable[[float], tuple[float, float]]
"""time [s] -> displacement [m] and velocity [m/s] along a direction"""


class Hand(Protocol):
    """The simulated person who holds the device."""

    @property
    def stiffness_npm(self) -> float:
        """K_h [N/m]."""

    @property
    def damping_nspm(self) -> float:
        """B_h [N s/m]."""

    def open(self, rate_hz: int, home_m: Row | None) -> Row:
        """Begin again for ticks of 1/rate_hz around `home_m` (None: 0, or the hand's choice). Gives the start [m]."""

    def intended(self, tick: int) -> tuple[Row, Row]:
        """Intended position [m] and velocity [m/s] at `tick`."""

    def drive(self, tick: int) -> Sequence[float]:
        """K_h x_int + B_h v_int + F_push at `tick` [N], shape (axes,)."""


class ImpedanceSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Query keys of every hand that intends a motion; alone, those of `hold`. let_go_s: nobody holds on from then on."""

    hand_stiffness_npm: NotNegative = 300.0
    hand_damping_nspm: NotNegative = 5.0
    let_go_s: Annotated[float, Meta(ge=0.0)] = inf


class ReachSettings(ImpedanceSettings, frozen=True, kw_only=True):
    """Query keys of `reach`. stroke_s: one way; rest_s: after each. stop_s: from then on it rests (see `reach_course`)."""

    amplitude_m: Finite = 0.03
    stroke_s: Positive = 0.8
    rest_s: NotNegative = 0.0
    delay_s: NotNegative = 0.0
    stop_s: Annotated[float, Meta(ge=0.0)] = inf
    direction: tuple[Finite, ...] = (1.0,)


class ApproachSettings(ImpedanceSettings, frozen=True, kw_only=True):
    """Query keys of `approach`. lag_s: in which what is left of the way shrinks to 1/e of it."""

    amplitude_m: Finite = 0.03
    lag_s: Positive = 0.2
    delay_s: NotNegative = 0.0
    direction: tuple[Finite, ...] = (1.0,)


class TremorSettings(ReachSettings, frozen=True, kw_only=True):
    """Query keys of `tremor`: a reach (amplitude_m 0: a hold) plus a tremor of root mean square `tremor_m`."""

    amplitude_m: Finite = 0.0
    tremor_m: NotNegative = 0.0005
    seed: int = 0


class SineSettings(ImpedanceSettings, frozen=True, kw_only=True):
    """Query keys of `sine`. ramp_s: time in which the amplitude grows from 0. offset_m: where it swings about, from home."""

    amplitude_m: Finite = 0.005
    frequency_hz: Positive = 1.0
    ramp_s: NotNegative = 0.5
    offset_m: Finite = 0.0
    direction: tuple[Finite, ...] = (1.0,)


class PushSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Query keys of `push`: force_n along the direction, from start_s on."""

    force_n: Finite = 1.0
    start_s: NotNegative = 0.0
    direction: tuple[Finite, ...] = (1.0,)


class DirectedHand:
    """An impedance whose intended motion runs along one direction from home."""

    def __init__(self, settings: ImpedanceSettings, course: Course, direction: Row) -> None:
        self.stiffness_npm = settings.hand_stiffness_npm
        self.damping_nspm = settings.hand_damping_nspm
        self._course = course
        self._direction = direction
        self._home: Row = (0.0,) * len(direction)
        self._rate_hz = 1

    def open(self, rate_hz: int, home_m: Row | None) -> Row:
        """See `Hand.open`. Device and hand start at home, also where the course begins off it (tremor)."""
        self._rate_hz = rate_hz
        self._home = home_m or (0.0,) * len(self._direction)
        self._base = [(self.stiffness_npm * x, d) for x, d in zip(self._home, self._direction, strict=True)]
        return self._home

    def along(self, tick: int) -> tuple[float, float]:
        """Return place [m] and speed [m/s] along the direction."""
        return self._course(tick / self._rate_hz)

    def intended(self, tick: int) -> tuple[Row, Row]:
        s, w = self._course(tick / self._rate_hz)
        position = tuple(x + d * s for x, d in zip(self._home, self._direction, strict=True))
        return position, tuple(d * w for d in self._direction)

    def drive(self, tick: int) -> Sequence[float]:
        s, w = self._course(tick / self._rate_hz)
        f = self.stiffness_npm * s + self.damping_nspm * w
        return [base + d * f for base, d in self._base]


class PushHand:
    """A constant force without impedance: it intends no place."""

    stiffness_npm = 0.0
    damping_nspm = 0.0

    def __init__(self, settings: PushSettings, axes: int) -> None:
        self._start_s = settings.start_s
        self._zero: Row = (0.0,) * axes
        self.force_n: Row = tuple(settings.force_n * d for d in fit_axes(settings.direction, axes, "direction"))
        self._home = self._zero
        self._rate_hz = 1

    def open(self, rate_hz: int, home_m: Row | None) -> Row:
        self._rate_hz = rate_hz
        self._home = home_m or self._zero
        return self._home

    def intended(self, tick: int) -> tuple[Row, Row]:
        """The start, at rest; nothing pulls there."""
        return self._home, self._zero

    def drive(self, tick: int) -> Sequence[float]:
        """The force from the first tick at or after start_s on [N]."""
        return self.force_n if tick >= self._start_s * self._rate_hz else self._zero


def directed(course_of: Callable[[Any], Course]) -> Callable[[Any, int], DirectedHand]:
    """Return the maker of hands, called (settings, axes), whose motion is `course_of(settings)` along their direction."""

    def make(settings: Any, axes: int) -> DirectedHand:
        return DirectedHand(settings, course_of(settings), fit_axes(settings.direction, axes, "direction"))

    return make


def make_hold(settings: ImpedanceSettings, axes: int) -> Hand:
    """A hand that stays at home."""
    return DirectedHand(settings, _rest, (0.0,) * axes)


def sine_course(settings: SineSettings) -> Course:
    """g(t) (offset_m + amplitude_m sin(2 pi frequency_hz t)) with g a smooth step, 3 z^2 - 2 z^3 over z = t / ramp_s <= 1."""
    amplitude, omega = settings.amplitude_m, 2.0 * pi * settings.frequency_hz
    ramp, offset = settings.ramp_s, settings.offset_m

    def course(time_s: float) -> tuple[float, float]:
        s = offset + amplitude * sin(omega * time_s)
        w = amplitude * omega * cos(omega * time_s)
        if time_s >= ramp:
            return s, w
        z = max(0.0, time_s / ramp)
        grown = z * z * (3.0 - 2.0 * z)
        return grown * s, grown * w + 6.0 * z * (1.0 - z) / ramp * s

    return course


def reach_course(settings: ReachSettings) -> Course:
    """Minimum-jerk strokes 0 -> amplitude_m -> 0 -> ..., each stroke_s long and rest_s after the last, the first at delay_s.

    s(z) = 10 z^3 - 15 z^4 + 6 z^5, z = time into the stroke / stroke_s (Flash and Hogan 1985). A stroke that would not
    be over by stop_s is not begun: from stop_s on the hand rests, at home after an even number of strokes, else at the
    far end.
    """
    amplitude, stroke, delay = settings.amplitude_m, settings.stroke_s, settings.delay_s
    period = stroke + settings.rest_s
    strokes = max(0.0, (settings.stop_s - delay + settings.rest_s) / period)
    if strokes != inf:
        strokes = floor(strokes + 1e-9)
    end = amplitude if strokes % 2 == 1 else 0.0
    speed = 30.0 * amplitude / stroke
    part = stroke / period

    return lambda time_s: _stroke_at((time_s - delay) / period, strokes, part, amplitude, speed, end)


def _stroke_at(
    z: float, strokes: float, part: float, amplitude: float, speed: float, end: float
) -> tuple[float, float]:
    """Return place [m] and speed [m/s] after z periods, of which a stroke takes `part`."""
    if z <= 0.0:
        return 0.0, 0.0
    if z >= strokes:
        return end, 0.0
    n = int(z)
    z = min(1.0, (z - n) / part)
    zz = z * z
    s = amplitude * zz * z * (10.0 + z * (6.0 * z - 15.0))
    w = speed * zz * (1.0 - z) ** 2
    return (amplitude - s, -w) if n & 1 else (s, w)


def approach_course(settings: ApproachSettings) -> Course:
    """amplitude_m (1 - exp(-(t - delay_s) / lag_s)): each moment as fast as far away, as visual guidance of first order.

    It is within w / 2 of its end after delay_s + lag_s ln(2 amplitude_m / w): Fitts's law with a slope of lag_s ln 2 a bit
    (Crossman and Goodeve 1983).
    """
    amplitude, lag, delay = settings.amplitude_m, settings.lag_s, settings.delay_s

    def course(time_s: float) -> tuple[float, float]:
        if time_s <= delay:
            return 0.0, 0.0
        left = amplitude * exp((delay - time_s) / lag)
        return amplitude - left, left / lag

    return course


def tremor_course(settings: TremorSettings) -> Course:
    """The reach plus five sines of equal amplitude, one at random in each fifth of 8 to 12 Hz, phases at random too.

    Their root mean square over long times is tremor_m: amplitude of each = tremor_m sqrt(2 / 5). Physiological tremor
    lies at 8 to 12 Hz. The same seed gives the same tremor at every rate.
    """
    count, low_hz, high_hz = 5, 8.0, 12.0
    random = Random(settings.seed)
    amplitude = settings.tremor_m * sqrt(2.0 / count)
    band = (high_hz - low_hz) / count
    waves = [(2.0 * pi * (low_hz + band * (i + random.random())), 2.0 * pi * random.random()) for i in range(count)]
    reach = reach_course(settings) if settings.amplitude_m else _rest

    def course(time_s: float) -> tuple[float, float]:
        s, w = reach(time_s)
        sines = cosines = 0.0
        for omega, phase in waves:
            angle = omega * time_s + phase
            sines += sin(angle)
            cosines += omega * cos(angle)
        return s + amplitude * sines, w + amplitude * cosines

    return course


def _rest(time_s: float) -> tuple[float, float]:
    return 0.0, 0.0
