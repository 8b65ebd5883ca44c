"""The interface of every device: a capability record, samples in, forces out.

Sign of force, everywhere in cogrip: `force_n` is F of the paper's eq. 9,

    m x'' + b x' = F_hand - F

the force that *loads* the hand; m and b are mass and damping of the device, x its position, F_hand the force of the hand on it.
The device pushes the hand with -F; a positive F resists motion in +x.
Power F v flows from the hand into the line (theory.md section 1).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any, Protocol

import msgspec

from cogrip.devices.sample import Sample as Sample  # for drivers: part of the interface
from cogrip.protocol.axes import GRIP_AXES, POSE_AXES
from cogrip.protocol.settings.rates import LEAST_DEVICE_HZ
from cogrip.protocol.wire.handle import MOST_BUTTONS

MOST_SLOPE_NPS = 1000.0
"""Largest slope of any force, whatever the record says: 2000 N/m met at 0.5 m/s (docs/security.md)."""
LARGEST = 1e6  # largest number in a record: what is above is no bound
GRAVITY_MPS2 = 9.81
MOST_HANDLE_KG = 5.0
SLEW_NPS = 1000.0  # slope limit where a maker states none: what the client lets through anyway (docs/devices.md)
SPEED_MPS = 2.0  # over-speed where a maker states none: a reach across 0.25 m in 0.25 s peaks at 1.9 m/s (minimum jerk)
IDEAL_SPEED_MPS = 4.0  # over-speed of a device without a mechanism: a reach of 1 m in 0.47 s
IDEAL_STIFFNESS_NPM = 20_000.0  # the stiffest spring that the passive scheme is tried with (docs/paper.md)
IDEAL_DAMPING_NSPM = 50.0


class DeviceError(Exception):
    """A device, or an address that asks for one, is at fault. The text names thing, value, bound and cure."""


@contextmanager
def defects_named(name: str, verb: str) -> Iterator[None]:
    """Make a DeviceError, with the driver's name, of whatever else its `verb` raises inside."""
    try:
        yield
    except DeviceError:
        raise
    except Exception as error:
        raise defect(name, verb, error) from error


def defect(name: str, verb: str, error: Exception) -> DeviceError:
    """Return what is said of a driver, known by `name`, whose `verb` raised something else than DeviceError."""
    text = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return DeviceError(f"{name}: {text} in {verb}; its driver has a defect: correct it, or tell its author")


@dataclass(frozen=True, slots=True)
class Rotation:
    """Record of the axes that turn, of a device that gives poses and takes wrenches. Symbols as in `Capability`.

    peak_torque_nm, continuous_torque_nm   largest torque, briefly and for ever [N m]
    damping_nms                            largest advised damping [N m s]
    slew_nmps                              steepest torque [N m/s]
    speed_radps                            over-speed limit [rad/s]
    resolution_rad                         smallest step of an orientation reading [rad], 0: exact
    apparent_inertia_kgm2                  what the hand feels of the device [kg m^2]
    own_damping_nms, own_friction_nm       of the mechanism itself [N m s, N m], 0 where they are not known

    Every limit is a finite number above 0: raises DeviceError for any other.
    """

    peak_torque_nm: float
    continuous_torque_nm: float
    damping_nms: float
    slew_nmps: float
    speed_radps: float
    resolution_rad: float
    apparent_inertia_kgm2: float
    own_damping_nms: float = 0.0
    own_friction_nm: float = 0.0

    def __post_init__(self) -> None:
        for name in (
            "peak_torque_nm", "continuous_torque_nm", "damping_nms", "slew_nmps", "speed_radps", "apparent_inertia_kgm2",
        ):  # fmt: skip
            if not 0.0 < getattr(self, name) <= LARGEST:  # False for nan
                raise DeviceError(f"{name} = {getattr(self, name):g} is no limit: state a number above 0")
        if self.continuous_torque_nm > self.peak_torque_nm or not 0.0 <= self.resolution_rad <= LARGEST:
            raise DeviceError("continuous_torque_nm is above peak_torque_nm, or resolution_rad is not 0 or above")


@dataclass(frozen=True, slots=True)
class Gripper:
    """Record of a gripper with force, whose opening is the fourth axis. Symbols as in `Capability`, of this axis.

    Its range is `Capability.grip_m`. Every limit is a finite number above 0: raises DeviceError for any other.
    """

    peak_force_n: float
    continuous_force_n: float
    damping_nspm: float
    slew_nps: float
    speed_mps: float
    resolution_m: float
    apparent_mass_kg: float
    own_damping_nspm: float = 0.0
    own_friction_n: float = 0.0

    def __post_init__(self) -> None:
        for name in ("peak_force_n", "continuous_force_n", "damping_nspm", "slew_nps", "speed_mps", "apparent_mass_kg"):
            if not 0.0 < getattr(self, name) <= LARGEST:  # False for nan
                raise DeviceError(f"gripper: {name} = {getattr(self, name):g} is no limit: state a number above 0")
        if self.continuous_force_n > self.peak_force_n or not 0.0 <= self.resolution_m <= LARGEST:
            raise DeviceError("gripper: continuous_force_n is above peak_force_n, or resolution_m is not 0 or above")


@dataclass(frozen=True, slots=True)
class Capability:
    """Capability record of a device; safety reads it before any force flows.

    family, model       names for people
    axes                how many axes this device was made with: 1 to 3 places; 6, a place and an orientation; 4, a place and
                        the opening of a gripper with force
    workspace_m         (low, high) per place [m], shape (min(axes, 3),)
    peak_force_n        largest force per axis, briefly [N]
    continuous_force_n  largest force per axis, for ever [N]
    stiffness_npm       largest advised stiffness [N/m]
    damping_nspm        largest advised damping [N s/m]
    slew_nps            steepest force [N/s]
    speed_mps           over-speed limit [m/s]
    resolution_m        smallest step of a position reading [m], 0: exact
    apparent_mass_kg    what the hand feels of the device [kg]
    rate_hz             highest loop rate [Hz]
    gives_velocity      whether samples carry a velocity
    latency_ticks       how many ticks old a sample is when it is read, where nothing goes wrong
    own_damping_nspm    damping of the mechanism itself [N s/m]: at least so much, 0 where it is not known
    own_friction_n      friction of the mechanism itself [N]: at least so much, 0 where it is not known
    rotation            record of the axes that turn; None where there are none
    buttons             how many buttons it has, 0 to 32
    gives_orientation   whether samples carry an orientation
    grip_m              (closed, open) of its gripper [m]; None where it has none
    handle_mass_kg      mass whose weight the hand carries on the third axis, and nobody else [kg]; 0 where it is not known
    gripper             record of the gripper's axis, where it has force; None where there is none

    Every limit is a finite number above 0: raises DeviceError for any other.
    """

    family: str
    model: str
    axes: int
    workspace_m: tuple[tuple[float, float], ...]
    peak_force_n: float
    continuous_force_n: float
    stiffness_npm: float
    damping_nspm: float
    slew_nps: float
    speed_mps: float
    resolution_m: float
    apparent_mass_kg: float
    rate_hz: int
    gives_velocity: bool
    latency_ticks: int = 0
    own_damping_nspm: float = 0.0
    own_friction_n: float = 0.0
    rotation: Rotation | None = None
    buttons: int = 0
    gives_orientation: bool = False
    grip_m: tuple[float, float] | None = None
    handle_mass_kg: float = 0.0
    gripper: Gripper | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.axes <= POSE_AXES:
            raise self._error(f"axes = {self.axes}: a device has 1 to {POSE_AXES}; state 1 to 3, 4 or 6")
        for name in ("peak_force_n", "continuous_force_n", *_FORMERLY_UNBOUNDED, "apparent_mass_kg"):
            value = getattr(self, name)
            if not 0.0 < value <= LARGEST:  # False for nan
                raise self._error(f"{name} = {value:g} is no limit: state a number above 0, at most {LARGEST:g}")
        if self.continuous_force_n > self.peak_force_n:
            raise self._error(
                f"continuous_force_n = {self.continuous_force_n:g} is above peak_force_n = {self.peak_force_n:g}: lower it"
            )
        if not 0.0 <= self.resolution_m <= LARGEST:
            raise self._error(f"resolution_m = {self.resolution_m:g} is not 0 (exact) or a number above")
        if not 0.0 <= self.handle_mass_kg <= MOST_HANDLE_KG:
            raise self._error(f"handle_mass_kg = {self.handle_mass_kg:g} is out of 0 to {MOST_HANDLE_KG:g}")
        if not 0 <= self.buttons <= MOST_BUTTONS:
            raise self._error(f"buttons = {self.buttons} is out of 0 to {MOST_BUTTONS}")
        if (self.gripper is not None) != (self.axes == GRIP_AXES) or (self.gripper and self.grip_m is None):
            raise self._error(
                f"axes = {self.axes}: {GRIP_AXES} axes need a gripper's record and grip_m, others have no such record"
            )
        ranges = [("workspace_m", *bounds) for bounds in self.workspace_m]
        for name, low, high in ranges + [("grip_m", *bounds) for bounds in [self.grip_m] if bounds]:
            if not (isfinite(low) and isfinite(high) and low < high):
                raise self._error(f"{name} has ({low:g}, {high:g}): state finite metres, the lower one first")

    def _error(self, what: str) -> DeviceError:
        return DeviceError(f"record of {self.family}:{self.model}: {what}")

    @classmethod
    def recorded(cls, table: Mapping[str, Any]) -> Capability:
        """The record that a recording holds. In early ones a bound may be infinite: it becomes the one given today.

        Raises ValueError for anything else that is no record.
        """
        named = {name: ours for name, ours in _FORMERLY_UNBOUNDED.items() if table.get(name) == float("inf")}
        try:
            return msgspec.convert({**table, **named}, cls)
        except DeviceError as error:
            raise ValueError(str(error)) from None

    @property
    def claims(self) -> dict[str, Any]:
        """Return what a hello says of the device, by parameter of `session.make_hello`."""
        turning = self.rotation
        force_n, speed_mps = self.peak_force_n, self.speed_mps
        if own := self.gripper:  # the larger of both
            force_n, speed_mps = max(force_n, own.peak_force_n), max(speed_mps, own.speed_mps)
        return {
            "axes": self.axes, "rate_hz": float(self.rate_hz), "force_n": force_n, "speed_mps": speed_mps,
            "torque_nm": turning.peak_torque_nm if turning else 0.0, "speed_radps": turning.speed_radps if turning else 0.0,
        }  # fmt: skip

    def first(self, axes: int) -> Capability:
        """The record of the first `axes` axes alone."""
        if axes == self.axes:
            return self
        return replace(self, axes=axes, workspace_m=self.workspace_m[:axes], rotation=None, gripper=None)


_FORMERLY_UNBOUNDED = {
    "stiffness_npm": IDEAL_STIFFNESS_NPM,
    "damping_nspm": IDEAL_DAMPING_NSPM,
    "slew_nps": SLEW_NPS,
    "speed_mps": IDEAL_SPEED_MPS,
}
"""Limits that could be infinite in early recordings -> what stands there instead as they are read."""


def encoder_record(
    family: str, model: str, workspace_m: tuple[tuple[float, float], ...], force_n: tuple[float, float],
    limits: tuple[float, float], numbers: tuple[float, float], *, rate_hz: int, speed_mps: float = SPEED_MPS,
    latency_ticks: int = 0,
) -> Capability:  # fmt: skip
    """The record of a device whose encoders give positions alone; nobody states its slope.

    force_n: (peak, continuous); limits: (stiffness [N/m], damping [N s/m]); numbers: (resolution [m], apparent mass [kg])
    """
    return Capability(
        family, model, len(workspace_m), workspace_m, *force_n, *limits, SLEW_NPS, speed_mps, *numbers, rate_hz,
        gives_velocity=False, latency_ticks=latency_ticks,
    )  # fmt: skip


def at_most(record: Capability, peak_force_n: float | None) -> Capability:
    """The record with no more force than `peak_force_n` [N]; None: as it is."""
    peak = record.peak_force_n if peak_force_n is None else min(peak_force_n, record.peak_force_n)
    return replace(record, peak_force_n=peak, continuous_force_n=min(peak, record.continuous_force_n))


def check_rate(rate_hz: int, record: Capability, where: str) -> None:
    """Raises DeviceError for a loop rate that this device is too slow for, or at which a force is held for too long."""
    if not LEAST_DEVICE_HZ <= rate_hz <= record.rate_hz:
        raise DeviceError(
            f"{where}: rate_hz={rate_hz} is out of {LEAST_DEVICE_HZ} to {record.rate_hz}; set rates.device_hz between them"
        )


class Device(Protocol):
    """A force-feedback device, or whatever stands in for one. Making it touches no hardware and no file.

    Call per tick: `read(tick)` once, then `write(force_n)` once. All calls come from one thread.
    """

    @property
    def capability(self) -> Capability:
        """The record; available before `open`.

        Where the address leaves open what the device is, the device is asked: raises DeviceError.
        """

    @property
    def counts(self) -> Mapping[str, int]:
        """Errors that were handled, counted by name: replies missed, garbage skipped, currents limited."""

    def open(self, rate_hz: int) -> None:
        """Acquire the device for a loop of `rate_hz` ticks a second.

        Raises DeviceError when it is open already, cannot be had, or `check_rate` refuses `rate_hz`.
        """

    def read(self, tick: int) -> Sample | None:
        """The newest sample at `tick`, or None when there is nothing new since the last call.

        `tick` is the integer index of the loop's tick, due at t0 + tick * 10**9 // rate_hz nanoseconds. It never falls;
        it may jump after an overrun. Raises DeviceError when not open or when the device is lost.
        """

    def write(self, force_n: Sequence[float]) -> Sequence[float] | None:
        """Hold `force_n` [N], shape (axes,), until the next write. It is F of P eq. 9 (see above): the hand gets -F.

        Of six axes the last three are a torque [N m]; of four the last is the force that loads fingers as they open [N].

        Returns the force that acts where that is another one: its motors cannot give more, or it could not be told yet.
        Raises DeviceError when not open, when the number of axes differs, or when a force is not finite.
        """

    def close(self) -> None:
        """Write zero force and let go. Closing twice, or before opening, does nothing."""
