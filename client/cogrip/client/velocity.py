"""Velocity from encoder positions, for devices that give none (theory section 3.6), and the impedance a device carries.

symbols: b impedance [N s/m], m apparent mass [kg], q one count [m], T tick [s], L age of a sample [ticks], mu memory,
s = 1 - mu, F_q the largest jump of the force that one count may make [N]

A damper of the estimate acts l = L + (1 + mu) / (1 - mu) ticks late, the hold counted. Bounds:

    lag     b < m / (l T)               no more than there is: being late takes b l T from the mass
    noise   b < F_q T / (s^2 q)         one count moves the estimate by s^2 q / T

docs/velocity.md has the comparison that chose this estimator, its stability, and how far sessions really go.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, sqrt
from typing import Literal

from cogrip.devices.device import Capability
from cogrip.protocol.setting_types import PLACES, POSE_AXES

MEMORY, LEAST_MEMORY = 0.6, 0.5
MEMORY_TICK_S = 1.0 / 1024.0
"""Tick that MEMORY is for; shorter ones take more."""
WANTED_NSPM = 20.0
"""Impedance that a device should carry, if it can: the paper's."""
NOISE_N = 0.175
"""F_q: a hand does not tell forces apart that differ by less than 7 %, from 2.5 N on (Pang, Tan and Durlach 1991)."""

NOTHING = (0.0,) * POSE_AXES

Bound = Literal["lag", "noise", "record"]


class AlphaBeta:
    """Critically damped alpha-beta (g-h) filter, one state pair an axis.

    memory: pole mu both errors decay with, alpha = 1 - mu^2, beta = (1 - mu)^2; more is quieter and later (`memory_for`)
    """

    __slots__ = ("_alpha", "_begun", "_beta_rate", "_estimate_m", "_tick_s", "_velocity")

    def __init__(self, axes: int, tick_s: float, memory: float = MEMORY) -> None:
        self._alpha = 1.0 - memory * memory
        self._beta_rate = (1.0 - memory) ** 2 / tick_s
        self._tick_s = tick_s
        self._estimate_m = list(NOTHING)
        self._begun = False
        self._velocity = [0.0] * axes

    def update(self, position_m: Sequence[float], ticks: int = 1) -> list[float]:
        """Return the velocity [m/s], shape (axes,), after `ticks` ticks at the position [m] read now. The list is reused."""
        estimate, velocity = self._estimate_m, self._velocity
        if not self._begun:
            if len(position_m) != len(velocity):
                raise ValueError(f"a position of {len(position_m)} axes, and there are {len(velocity)}")
            self._begun = True
            for axis in range(len(velocity)):
                estimate[axis] = position_m[axis]
            return velocity
        step_s = self._tick_s * ticks
        alpha, beta_rate = self._alpha, self._beta_rate / ticks
        if len(velocity) == PLACES:  # as below, without a loop
            (x, y, z), (vx, vy, vz) = position_m, velocity
            px, py, pz = estimate[0] + step_s * vx, estimate[1] + step_s * vy, estimate[2] + step_s * vz
            x, y, z = x - px, y - py, z - pz
            estimate[0], estimate[1], estimate[2] = px + alpha * x, py + alpha * y, pz + alpha * z
            velocity[0], velocity[1], velocity[2] = vx + beta_rate * x, vy + beta_rate * y, vz + beta_rate * z
            return velocity
        for axis in range(len(velocity)):
            predicted = estimate[axis] + step_s * velocity[axis]
            error = position_m[axis] - predicted
            estimate[axis] = predicted + alpha * error
            velocity[axis] += beta_rate * error
        return velocity

    def reset(self) -> None:
        """Reset, because the last sample could not be used."""
        self._begun = False
        self._velocity = [0.0] * len(self._velocity)


def memory_for(capability: Capability, tick_s: float) -> float:
    """Return the memory of the client's estimator on this device.

    At most MEMORY; less where that keeps WANTED_NSPM inside the lag bound, down to LEAST_MEMORY. In a loop faster than
    MEMORY_TICK_S s is that of MEMORY_TICK_S times sqrt(T / MEMORY_TICK_S): one count is no louder.
    """
    slow_s = max(tick_s, MEMORY_TICK_S)
    lag = capability.apparent_mass_kg / (WANTED_NSPM * slow_s) - capability.latency_ticks
    memory = min(MEMORY, max(LEAST_MEMORY, (lag - 1.0) / (lag + 1.0) if lag > 0.0 else 0.0))
    return memory if tick_s >= MEMORY_TICK_S else 1.0 - (1.0 - memory) * sqrt(tick_s / MEMORY_TICK_S)


def estimator_for(capability: Capability, tick_s: float) -> AlphaBeta | None:
    """Return the estimator for a device; None where the device gives velocity."""
    if capability.gives_velocity:
        return None
    return AlphaBeta(capability.axes, tick_s, memory_for(capability, tick_s))


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
