"""What every device is: a capability record, samples in, forces out.

Sign of force, everywhere in cogrip: `force_n` is F of the paper's eq. 9,

    m x'' + b x' = F_hand - F

the force that *loads* the hand. The device pushes the hand with -F; a positive F resists motion in +x.
Power F v flows from the hand into the line (theory.md section 1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import msgspec


class DeviceError(Exception):
    """A device, or an address that asks for one, is at fault. The text names thing, value, bound and cure."""


@dataclass(frozen=True, slots=True)
class Capability:
    """What a device can do; safety reads it before any force flows.

    family, model       names for people
    axes                how many axes this device was made with
    workspace_m         (low, high) per axis [m], shape (axes,)
    peak_force_n        largest force per axis, briefly [N]
    continuous_force_n  largest force per axis, for ever [N]
    stiffness_npm       largest advised stiffness [N/m], may be inf
    damping_nspm        largest advised damping [N s/m], may be inf
    slew_nps            steepest advised force [N/s], may be inf
    speed_mps           over-speed limit [m/s], may be inf
    resolution_m        smallest step of a position reading [m], 0: exact
    apparent_mass_kg    what the hand feels of the device [kg]
    rate_hz             highest loop rate [Hz]
    gives_velocity      whether samples carry a velocity
    latency_ticks       how many ticks old a sample is when it is read, where nothing goes wrong
    own_damping_nspm    damping of the mechanism itself [N s/m]: at least so much, 0 where it is not known
    own_friction_n      friction of the mechanism itself [N]: at least so much, 0 where it is not known
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

    def first(self, axes: int) -> Capability:
        """The record of the first `axes` axes alone."""
        return replace(self, axes=axes, workspace_m=self.workspace_m[:axes])


class Sample(msgspec.Struct, frozen=True, gc=False):
    """One reading: position [m] and, where the device knows it, velocity [m/s], each of shape (axes,).

    It was taken `age_ticks` ticks before the tick it is read at: a device that answers a request is asked at one tick, with
    the force that begins then, and read at the next.
    """

    position_m: tuple[float, ...]
    velocity_mps: tuple[float, ...] | None
    age_ticks: int = 0


class Device(Protocol):
    """A force-feedback device, or whatever stands in for one. Making it touches no hardware and no file.

    Call per tick: `read(tick)` once, then `write(force_n)` once. All calls come from one thread.
    """

    @property
    def capability(self) -> Capability:
        """The record; available before `open`.

        Where the address leaves open what the device is, the device is asked: raises DeviceError.
        """
        ...

    @property
    def counts(self) -> Mapping[str, int]:
        """What went wrong and was dealt with, by name: replies missed, garbage skipped, currents limited."""
        ...

    def open(self, rate_hz: int) -> None:
        """Acquire the device for a loop of `rate_hz` ticks a second.

        Raises DeviceError when it is open already, cannot be had, or is slower than `rate_hz`.
        """
        ...

    def read(self, tick: int) -> Sample | None:
        """The newest sample at `tick`, or None when there is nothing new since the last call.

        `tick` is the integer index of the loop's tick, due at t0 + tick * 10**9 // rate_hz nanoseconds. It never falls;
        it may jump after an overrun. Raises DeviceError when not open or when the device is lost.
        """
        ...

    def write(self, force_n: Sequence[float]) -> Sequence[float] | None:
        """Hold `force_n` [N], shape (axes,), until the next write. It is F of P eq. 9 (see above): the hand gets -F.

        Returns the force that acts where that is another one: its motors cannot give more, or it could not be told yet.
        Raises DeviceError when not open, when the number of axes differs, or when a force is not finite.
        """
        ...

    def close(self) -> None:
        """Write zero force and let go. Closing twice, or before opening, does nothing."""
        ...
