"""`sim:phantom6`, `sim:freeflyer`: machines with a place and an orientation, in a hand that turns as well as moves.

The place is that of `sim:phantom` or of a free mass. The orientation R of a body of inertia I, the same about every axis, is
turned by the hand's impedance and by the device's torque tau, both held over a tick T; r = log(R_int R^-1) rotation vector from
it to the intended orientation, omega angular velocity, omega_int the intended one, all in the world's frame; K_r [N m], B_r
[N m s] rotational stiffness and damping of the hand; b_d [N m s], c [N m] damping and friction of the body:

    omega' = (omega + T/I (K_r r + B_r omega_int - tau)) / (1 + (T b_d + T B_r + T^2 K_r) / I)          R' = exp(T omega') R

an implicit step, stable for any K_r and B_r. The device's work in a tick is tau T omega' exactly. Friction takes up to T c / I
of omega'. `sim:phantom6` reads R in whole counts of resolution_rad, its motors saturate at peak_torque_nm.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import cos, floor, hypot, inf, sin
from typing import Annotated, Literal

from msgspec import Meta

from cogrip.devices.device import Capability, Rotation, Sample
from cogrip.devices.settings import Finite, NotNegative, Positive
from cogrip.devices.simulated.hands import Hand, ImpedanceSettings
from cogrip.devices.simulated.ideal import IdealPlant, IdealSettings
from cogrip.devices.simulated.ideal import capability as ideal_record
from cogrip.devices.simulated.phantom import PhantomPlant, PhantomSettings
from cogrip.devices.simulated.phantom import capability as phantom_record
from cogrip.devices.simulated.simulated_device import Plant
from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES, POSE_AXES
from cogrip.protocol.laws.rotations import UNTURNED, between, exp, log, product

SLEW_NMPS = 30.0
SPEED_RADPS = 20.0  # over-speed of rotation; a wrist turns by 60 degrees in 0.1 s at 10 rad/s
ADVISED_AT_HZ = 1024


class FreeflyerSettings(IdealSettings, frozen=True, kw_only=True):
    """Query keys of `sim:freeflyer`: of a free mass, of a body that turns, and of the wrist that turns it."""

    inertia_kgm2: Positive = 1e-4
    rotational_damping_nms: NotNegative = 0.0
    rotational_friction_nm: NotNegative = 0.0
    resolution_rad: NotNegative = 0.0
    peak_torque_nm: Positive = 10.0
    wrist_stiffness_nmprad: NotNegative = 1.0
    wrist_damping_nms: NotNegative = 0.02


class Phantom6Settings(PhantomSettings, frozen=True, kw_only=True):
    """Query keys of `sim:phantom6`, a Phantom Premium with six axes of force: 0.19 N m in the data sheet."""

    inertia_kgm2: Positive = 1e-4
    rotational_damping_nms: NotNegative = 0.0
    rotational_friction_nm: NotNegative = 0.001
    resolution_rad: NotNegative = 1.4e-4
    peak_torque_nm: Positive = 0.19
    wrist_stiffness_nmprad: NotNegative = 1.0
    wrist_damping_nms: NotNegative = 0.02


Turning = FreeflyerSettings | Phantom6Settings


def _named(record: Capability, model: str, settings: Turning, continuous_nm: float, axes: int) -> Capability:
    """Return the record under the name of this machine, of six axes with that of its rotation."""
    if axes < POSE_AXES:
        return replace(record, model=model)
    turning = Rotation(
        peak_torque_nm=settings.peak_torque_nm, continuous_torque_nm=min(continuous_nm, settings.peak_torque_nm),
        damping_nms=0.5 * settings.inertia_kgm2 * ADVISED_AT_HZ, slew_nmps=SLEW_NMPS, speed_radps=SPEED_RADPS,
        resolution_rad=settings.resolution_rad, apparent_inertia_kgm2=settings.inertia_kgm2,
        own_damping_nms=settings.rotational_damping_nms, own_friction_nm=settings.rotational_friction_nm,
    )  # fmt: skip
    return replace(record, model=model, axes=axes, rotation=turning)


def freeflyer(settings: FreeflyerSettings, axes: int) -> Capability:
    """Return the record of a body that flies free."""
    record = ideal_record(settings, min(axes, PLACES))
    return _named(record, "freeflyer", settings, settings.peak_torque_nm, axes)


def phantom6(settings: Phantom6Settings, axes: int) -> Capability:
    """Return the record of the arm; 0.05 N m for ever."""
    record = phantom_record(settings, min(axes, PLACES))
    return _named(record, "phantom6", settings, 0.05, axes)


def freeflyer_plant(settings: FreeflyerSettings, axes: int) -> Plant:
    """Return the plant of a body that flies free."""
    places = IdealPlant(settings, min(axes, PLACES))
    return PosePlant(places, settings) if axes == POSE_AXES else places


def phantom6_plant(settings: Phantom6Settings, axes: int) -> Plant:
    """Return the plant of the arm."""
    places = PhantomPlant(settings, min(axes, PLACES))
    return PosePlant(places, settings) if axes == POSE_AXES else places


class PosePlant:
    """A plant of places and the body that turns with it. See `Plant`; a drive has 3 forces [N] and, behind them, the intended
    rotation vector [rad] and angular velocity [rad/s]."""

    def __init__(self, places: Plant, settings: Turning) -> None:
        self._places = places
        self._settings = settings
        self._orientation = UNTURNED
        self._omega: Row = (0.0, 0.0, 0.0)
        self._show()

    def _show(self) -> None:
        self.position_m = [*self._places.position_m, *log(self._orientation)]
        self.velocity_mps = [*self._places.velocity_mps, *self._omega]

    def open(self, rate_hz: int, stiffness_npm: float, damping_nspm: float, start_m: Sequence[float]) -> None:
        self._places.open(rate_hz, stiffness_npm, damping_nspm, start_m[:PLACES])
        self._tick_s = 1.0 / rate_hz
        self._wrist = self._settings.wrist_stiffness_nmprad, self._settings.wrist_damping_nms
        self._orientation, self._omega = exp(start_m[PLACES:]), (0.0, 0.0, 0.0)
        self._show()

    def release(self) -> None:
        """See `Plant.release`."""
        self._places.release()
        self._wrist = 0.0, 0.0

    def step(self, drive_n: Sequence[float], force_n: Sequence[float]) -> None:
        self._places.step(drive_n[:PLACES], force_n[:PLACES])
        s, tick_s, wanted = self._settings, self._tick_s, drive_n[2 * PLACES :]
        k, b = self._wrist
        off = between(self._orientation, exp(drive_n[PLACES : 2 * PLACES]))
        gain = tick_s / s.inertia_kgm2
        scale = 1.0 / (1.0 + gain * (s.rotational_damping_nms + b + tick_s * k))
        torque = force_n[PLACES:]
        most = hypot(*torque)
        if most > s.peak_torque_nm:
            torque = [s.peak_torque_nm / most * part for part in torque]
        omega = [
            scale * (at + gain * (k * r + b * to - tau))
            for at, r, to, tau in zip(self._omega, off, wanted, torque, strict=True)
        ]
        if s.rotational_friction_nm:
            speed, taken = hypot(*omega), scale * gain * s.rotational_friction_nm
            omega = [0.0 if speed <= taken else (1.0 - taken / speed) * each for each in omega]
        self._omega = omega[0], omega[1], omega[2]
        self._orientation = _unit(product(exp([tick_s * each for each in omega]), self._orientation))
        self._show()

    def sense(self) -> Sample:
        """Return the machine's own sample of the place, with the orientation in whole counts."""
        place, count = self._places.sense(), self._settings.resolution_rad
        turned: Row = tuple(self.position_m[PLACES:])
        if count:
            turned = tuple([floor(each / count + 0.5) * count for each in turned])
        velocity = None if place.velocity_mps is None else place.velocity_mps + self._omega
        return Sample(place.position_m + turned, velocity)


def _unit(q: Sequence[float]) -> tuple[float, float, float, float]:
    size = hypot(*q)
    return q[0] / size, q[1] / size, q[2] / size, q[3] / size


class UnturnedHand:
    """A hand of places on a machine that turns: it keeps its orientation."""

    def __init__(self, hand: Hand) -> None:
        self._hand = hand
        self.stiffness_npm, self.damping_nspm = hand.stiffness_npm, hand.damping_nspm

    def open(self, rate_hz: int, home_m: Row | None) -> Row:
        """See `Hand.open`. A start has a place and a rotation vector."""
        return self._hand.open(rate_hz, home_m[:PLACES] if home_m else None) + (0.0,) * PLACES

    def intended(self, tick: int) -> tuple[Row, Row]:
        """Intended pose [m, rad] and its rates."""
        still = (0.0,) * PLACES
        place, velocity = self._hand.intended(tick)
        return (*place, *still), (*velocity, *still)

    def drive(self, tick: int) -> Sequence[float]:
        return (*self._hand.drive(tick), *(0.0,) * (2 * PLACES))


class CrankSettings(ImpedanceSettings, frozen=True, kw_only=True):
    """Query keys of `crank`: speed_radps about `axis` from start_s to stop_s, reached and left in ramp_s."""

    radius_m: NotNegative = 0.0
    phase_rad: Finite = 0.0
    speed_radps: Finite = 1.0
    start_s: NotNegative = 0.0
    ramp_s: Positive = 1.0
    stop_s: Annotated[float, Meta(ge=0.0)] = inf
    axis: Literal["x", "y", "z"] = "z"


class CrankHand:
    """A hand that goes round on a circle, and turns as it goes: at a wheel, a crank, a valve (radius_m = 0).

    phi(t), the angle, is the integral of a speed that rises and falls in ramp_s. The centre is radius_m away from home, in the
    direction phase_rad + pi, in the plane across `axis`.
    """

    def __init__(self, settings: CrankSettings, axes: int) -> None:
        self.stiffness_npm, self.damping_nspm = settings.hand_stiffness_npm, settings.hand_damping_nspm
        self._settings = settings
        self._axis = "xyz".index(settings.axis)
        self._home: Row = (0.0,) * axes
        self._rate_hz = 1

    def open(self, rate_hz: int, home_m: Row | None) -> Row:
        """See `Hand.open`."""
        self._rate_hz = rate_hz
        self._home = home_m or self._home
        return self._home

    def _angle(self, time_s: float) -> tuple[float, float]:
        """Return phi [rad] and its rate [rad/s]."""
        s = self._settings

        def risen_s(since_s: float) -> tuple[float, float]:
            """Return the time at full speed that rising for so long is worth, and the part of it that is reached."""
            if since_s <= 0.0:
                return 0.0, 0.0
            if since_s < s.ramp_s:
                return 0.5 * since_s * since_s / s.ramp_s, since_s / s.ramp_s
            return since_s - 0.5 * s.ramp_s, 1.0

        (up_s, up), (down_s, down) = risen_s(time_s - s.start_s), risen_s(time_s - s.stop_s)
        return s.speed_radps * (up_s - down_s), s.speed_radps * (up - down)

    def intended(self, tick: int) -> tuple[Row, Row]:
        """Intended pose [m, rad] and its rates."""
        s = self._settings
        angle, rate = self._angle(tick / self._rate_hz)
        first, second = (self._axis + 1) % PLACES, (self._axis + 2) % PLACES
        place, velocity, turned, turning = ([0.0] * PLACES for _ in range(4))
        now = s.phase_rad + angle
        place[first] = s.radius_m * (cos(now) - cos(s.phase_rad))
        place[second] = s.radius_m * (sin(now) - sin(s.phase_rad))
        velocity[first], velocity[second] = -s.radius_m * rate * sin(now), s.radius_m * rate * cos(now)
        turned[self._axis], turning[self._axis] = angle, rate
        at = [home + by for home, by in zip(self._home[:PLACES], place, strict=True)]
        return (*at, *turned), (*velocity, *turning)

    def drive(self, tick: int) -> Sequence[float]:
        return pose_drive(self, tick)


def pose_drive(hand: Hand, tick: int) -> Sequence[float]:
    """Return what a `PosePlant` takes of a hand's intended pose and rates."""
    pose, rates = hand.intended(tick)
    forces = [
        hand.stiffness_npm * x + hand.damping_nspm * v for x, v in zip(pose[:PLACES], rates[:PLACES], strict=True)
    ]
    return (*forces, *pose[PLACES:], *rates[PLACES:])
