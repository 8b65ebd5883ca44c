"""Velocity of a device that gives positions alone (theory section 3.6), and the impedance a device carries.

symbols: b impedance [N s/m], m apparent mass [kg], q one count [m], T tick [s], L age of a sample [ticks], mu memory,
s = 1 - mu, rho memory of the hand's force, F force that the motors hold [N], F_q the largest jump of the force that one
count may make [N]

A damper of an estimate that knows positions alone acts l = L + (1 + mu) / (1 - mu) ticks late, the hold counted, and gives
energy to whatever swings: a line whose far end is free rings on it. `MotionObserver` knows the force of the motors as well, so
it is late only to what the hand does. Bounds:

    lag     b < m / (l T)               no more than there is: being late takes b l T from the mass
    noise   b < F_q T / (s^2 q)         one count moves the estimate by s^2 q / T

The lag bound is that of positions alone: what the observer gains on it is margin for a record whose mass is wrong.
docs/velocity.md has the comparison that chose this estimator, its stability, and how far sessions really go.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, inf, pi, sqrt
from typing import Literal

from cogrip.devices.device import Capability
from cogrip.protocol.axes import PLACES, POSE_AXES

MEMORY, LEAST_MEMORY = 0.6, 0.5
MEMORY_TICK_S = 1.0 / 1024.0
"""Tick at which the memory is MEMORY; a shorter tick takes a larger one."""
WANTED_NSPM = 20.0
"""Impedance that a device should carry, if it can: the paper's."""
NOISE_N = 0.175
"""F_q: a hand does not tell forces apart that differ by less than 7 %, from 2.5 N on (Pang, Tan and Durlach 1991)."""

NOTHING = (0.0,) * POSE_AXES

Bound = Literal["lag", "noise", "record"]


HAND_HZ = 10.0
"""Rate below which the observer tells the hand's force from its estimate: hands turn at 12 Hz at most, lines ring above."""


def observer_gains(memory: float, hand_memory: float) -> tuple[float, float, float]:
    """Return alpha, beta and gamma, with which the error of a `MotionObserver` has the poles mu, mu and rho.

    beta is for displacements of one tick, gamma for those of a tick times T: (1 - mu)^2 and 0 where rho = 1.
    """
    gamma = (1.0 - hand_memory) * (1.0 - memory) ** 2
    alpha = 1.0 - memory * memory * hand_memory
    return alpha, 2.0 - 2.0 * memory - hand_memory + memory * memory * hand_memory - 0.5 * gamma, gamma


def hand_memory(tick_s: float) -> float:
    """Return rho, the memory of the hand's force."""
    return exp(-2.0 * pi * HAND_HZ * tick_s)


class MotionObserver:
    """Observer of an arm of known mass: places z that are read, and the force F that its motors held meanwhile.

    Per axis, x and v its place and velocity, a what the hand adds to its acceleration, c = a - F / m, e = z - x before:

        x <- x + T v + T^2 c / 2 + alpha e        v <- v + T c + beta e / T        a <- a + gamma e / T^2

    Samples are L ticks old, so x and v are of then; the velocity that it returns is taken on to now by a and the F since.

    memory       mu; more is quieter, and later to what the hand does (`memory_for`)
    masses_kg    m of each axis; none: positions alone, a critically damped alpha-beta filter
    """

    __slots__ = (
        "_accelerations", "_alpha", "_begun", "_beta_rate", "_estimate_m", "_forces", "_gamma_rate", "_impulse", "_late_ticks",
        "_newest", "_per_mass", "_tick_s", "_velocity",
    )  # fmt: skip

    def __init__(
        self, axes: int, tick_s: float, memory: float = MEMORY, masses_kg: Sequence[float] = (), latency_ticks: int = 0
    ) -> None:
        alpha, beta, gamma = observer_gains(memory, hand_memory(tick_s) if masses_kg else 1.0)
        self._alpha, self._beta_rate, self._gamma_rate = alpha, beta / tick_s, gamma / (tick_s * tick_s)
        self._tick_s = tick_s
        self._per_mass = list(NOTHING)
        for axis, mass in enumerate(masses_kg):
            self._per_mass[axis] = 1.0 / mass
        self._late_ticks = latency_ticks if masses_kg else 0
        self._forces: deque[Sequence[float]] = deque(
            [(0.0,) * axes] * self._late_ticks
        )  # of the last L ticks, oldest first
        self._estimate_m, self._accelerations = list(NOTHING), list(NOTHING)
        self._impulse = list(NOTHING)  # sum of F over the ticks whose displacement the next sample shows [N ticks]
        self._begun = False
        self._velocity = [0.0] * axes  # at the newest sample, and now
        self._newest = self._velocity if not self._late_ticks else [0.0] * axes

    def hold(self, force_n: Sequence[float], ticks: int) -> None:
        """Enter the force [N] that the motors have held for the last ticks, whether a sample has come or not."""
        if self._late_ticks:
            for _ in range(ticks):
                self._forces.append(force_n)
                self._push(self._forces.popleft(), 1)
        else:
            self._push(force_n, ticks)

    def _push(self, force_n: Sequence[float], ticks: int) -> None:
        impulse = self._impulse
        if len(self._velocity) == PLACES:  # as below, without a loop
            x, y, z = force_n
            impulse[0] += ticks * x
            impulse[1] += ticks * y
            impulse[2] += ticks * z
            return
        for axis in range(len(self._velocity)):
            impulse[axis] += ticks * force_n[axis]

    def update(self, position_m: Sequence[float], ticks: int = 1) -> list[float]:
        """Return the velocity [m/s], shape (axes,), after `ticks` ticks at the position [m] read now. The list is reused."""
        estimate, velocity, push, impulse = self._estimate_m, self._velocity, self._accelerations, self._impulse
        if not self._begun:
            if len(position_m) != len(velocity):
                raise ValueError(f"a position of {len(position_m)} axes, and there are {len(velocity)}")
            self._begun = True
            for axis in range(len(velocity)):
                estimate[axis] = position_m[axis]
                impulse[axis] = 0.0
            return self._now()
        step_s = self._tick_s * ticks
        alpha, beta_rate, gamma_rate = self._alpha, self._beta_rate / ticks, self._gamma_rate / (ticks * ticks)
        per_mass, tick_s = self._per_mass, self._tick_s
        for axis in range(len(velocity)):
            gained = step_s * push[axis] - tick_s * impulse[axis] * per_mass[axis]
            predicted = estimate[axis] + step_s * (velocity[axis] + 0.5 * gained)
            error = position_m[axis] - predicted
            estimate[axis] = predicted + alpha * error
            velocity[axis] += gained + beta_rate * error
            push[axis] += gamma_rate * error
            impulse[axis] = 0.0
        return self._now()

    def _now(self) -> list[float]:
        """Return the velocity that the newest sample's has become by now, by the forces since."""
        velocity, newest = self._velocity, self._newest
        if self._late_ticks:
            for axis in range(len(velocity)):
                force_n = 0.0
                for held_n in self._forces:
                    force_n += held_n[axis]
                gained = self._late_ticks * self._accelerations[axis] - force_n * self._per_mass[axis]
                newest[axis] = velocity[axis] + self._tick_s * gained
        return newest

    def reset(self) -> None:
        """Reset, because the last sample could not be used."""
        self._begun = False
        for axis in range(len(self._velocity)):
            self._velocity[axis] = self._accelerations[axis] = 0.0


def memory_for(capability: Capability, tick_s: float) -> float:
    """Return the memory of the client's estimator on this device.

    At most MEMORY; less where that keeps WANTED_NSPM inside the lag bound, down to LEAST_MEMORY. In a loop faster than
    MEMORY_TICK_S s is that of MEMORY_TICK_S times sqrt(T / MEMORY_TICK_S): one count is no louder.
    """
    slow_s = max(tick_s, MEMORY_TICK_S)
    lag = capability.apparent_mass_kg / (WANTED_NSPM * slow_s) - capability.latency_ticks
    memory = min(MEMORY, max(LEAST_MEMORY, (lag - 1.0) / (lag + 1.0) if lag > 0.0 else 0.0))
    return memory if tick_s >= MEMORY_TICK_S else 1.0 - (1.0 - memory) * sqrt(tick_s / MEMORY_TICK_S)


def observer_for(capability: Capability, tick_s: float, masses_kg: Sequence[float]) -> MotionObserver | None:
    """Return the observer of a device with these masses on its axes; None where the device gives velocity."""
    if capability.gives_velocity:
        return None
    memory = memory_for(capability, tick_s)
    return MotionObserver(capability.axes, tick_s, memory, masses_kg, capability.latency_ticks)


@dataclass(frozen=True, slots=True)
class Carried:
    """Largest impedance of a device [N s/m], the bound that binds, and the lag of its damper [ticks]."""

    impedance_nspm: float
    bound: Bound
    lag_ticks: float


def lag_ticks(capability: Capability, tick_s: float) -> float:
    """Return by how many ticks a damper acts late, with the hold. A device's own velocity counts as a plain difference."""
    memory = 0.0 if capability.gives_velocity else memory_for(capability, tick_s)
    return capability.latency_ticks + (1.0 + memory) / (1.0 - memory)


def impedance_bounds(capability: Capability, tick_s: float) -> dict[Bound, float]:
    """Return each bound of b [N s/m]; "record" is the damping that the device's record advises."""
    count_mps = (1.0 - memory_for(capability, tick_s)) ** 2 * capability.resolution_m / tick_s
    return {
        "lag": capability.apparent_mass_kg / (tick_s * lag_ticks(capability, tick_s)),
        "noise": inf if capability.gives_velocity or count_mps == 0.0 else NOISE_N / count_mps,
        "record": capability.damping_nspm,
    }


def largest_impedance(capability: Capability, tick_s: float) -> Carried:
    """Return the largest impedance, or damping of virtual coupling, to ask of a device, and what limits it."""
    bounds = impedance_bounds(capability, tick_s)
    bound = min(bounds, key=lambda name: bounds[name])
    return Carried(bounds[bound], bound, lag_ticks(capability, tick_s))
