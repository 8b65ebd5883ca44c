"""The impedance that an estimator carries in a session of the actual cores, with the encoders' counts in the loop."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf, sqrt

from cogrip.client.hand.velocity import NOISE_N
from cogrip.client.inputs import DeviceOpened
from cogrip.devices.device import Capability, Sample
from cogrip.devices.simulated.simulated_device import Plant, SimulatedDevice
from cogrip.protocol.settings.room import resolve
from cogrip.sim.laboratory import Laboratory

from tests.bench.velocity_trial.estimators import Estimator

MakeEstimator = Callable[[], Estimator]

LOOSE = "hold&hand_stiffness_npm=50&hand_damping_nspm=0.5"
"""A hand that hardly damps: what a session does not damp by itself is seen."""
_PUSH_MPS = 0.05
_SECONDS, _LAST_S = 3.0, 0.5
_LEAST_NSPM, _MOST_NSPM = 2.0, 128.0


class EstimatingPlant:
    """A machine whose samples are `late` ticks old and carry the velocity that `estimator` makes of them."""

    def __init__(self, plant: Plant, estimator: Estimator, late: int) -> None:
        self.plant = plant
        self._estimator = estimator
        self._positions = deque([plant.sense().position_m] * (late + 1), maxlen=late + 1)
        self._late = late

    @property
    def position_m(self) -> list[float]:
        return self.plant.position_m

    @position_m.setter
    def position_m(self, position_m: list[float]) -> None:
        self.plant.position_m = position_m

    @property
    def velocity_mps(self) -> list[float]:
        return self.plant.velocity_mps

    @velocity_mps.setter
    def velocity_mps(self, velocity_mps: list[float]) -> None:
        self.plant.velocity_mps = velocity_mps

    def open(self, rate_hz: int, stiffness_npm: float, damping_nspm: float, start_m: Sequence[float]) -> None:
        self.plant.open(rate_hz, stiffness_npm, damping_nspm, start_m)

    def release(self) -> None:
        self.plant.release()

    def step(self, drive_n: Sequence[float], force_n: Sequence[float]) -> None:
        self.plant.step(drive_n, force_n)

    def sense(self) -> Sample:
        self._positions.append(self.plant.sense().position_m)
        old = self._positions[0]
        return Sample(old, tuple(self._estimator.update(old)), self._late)


def comes_to_rest(
    record: Capability, make: MakeEstimator, impedance_nspm: float, *, hand: str = LOOSE, frames: int = 1
) -> bool:
    """Return True if two such devices on one cube, pushed once, have forces within NOISE_N, rms, after _SECONDS."""
    device = f"sim:phantom?friction_n=0&resolution_m={record.resolution_m!r}&peak_force_n={record.peak_force_n!r}"
    users = [
        {"name": name, "device": device, "hand": hand, "device_mass_kg": record.apparent_mass_kg} for name in ("a", "b")
    ]
    table = {"seconds": _SECONDS, "coupling": {"impedance_nspm": impedance_nspm}, "users": users}
    settings = resolve(table, {"link.delay_ms": frames * 1000.0 / 128})
    laboratory = Laboratory(settings, bare=True)
    for person, sign in zip(laboratory.people, (1.0, -0.4), strict=True):
        assert isinstance(person.device, SimulatedDevice)
        plant = EstimatingPlant(person.device.plant, make(), record.latency_ticks)
        plant.velocity_mps[0] = sign * _PUSH_MPS
        person.device.plant = plant
        opened = replace(person.core.capability, latency_ticks=record.latency_ticks)
        person.core.handle(DeviceOpened(opened), person.core.now_ns)
    last = round((_SECONDS - _LAST_S) * settings.rates.device_hz)
    forces: list[list[float]] = [[], []]

    def watch(lab: Laboratory) -> None:
        if lab.tick >= last:
            for person, seen in zip(lab.people, forces, strict=True):
                seen.append(person.core.force_n[0])

    laboratory.run(watch)
    if laboratory.incident or any(person.core.safety.state != "live" for person in laboratory.people):
        return False  # a force that a fault took is no rest
    return max(_deviation(seen) for seen in forces) < NOISE_N


def _deviation(values: Sequence[float]) -> float:
    if not values:
        return inf
    mean = sum(values) / len(values)
    return sqrt(sum((value - mean) ** 2 for value in values) / len(values))


def largest_quiet(record: Capability, make: MakeEstimator, *, hand: str = LOOSE, frames: int = 1) -> float:
    """The end of the quiet stretch of b [N s/m] that begins at _LEAST_NSPM, to a few per cent; 0 if there is none."""

    def quiet(b: float) -> bool:
        return comes_to_rest(record, make, b, hand=hand, frames=frames)

    low, high = 0.0, _LEAST_NSPM
    while high <= _MOST_NSPM and quiet(high):
        low, high = high, high * sqrt(2.0)
    if low == 0.0 or high > _MOST_NSPM:
        return low
    for _ in range(4):
        middle = sqrt(low * high)
        low, high = (middle, high) if quiet(middle) else (low, middle)
    return low
