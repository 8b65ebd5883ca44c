"""Estimators compared on one device, and which of them is to be had.

delay   the shift of the true velocity that the estimate is nearest to, least squares, with a sample's own age
noise   what then is left of the error
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cogrip.analysis.linear.state_space import Array
from cogrip.client.hand.velocity import WANTED_NSPM, MotionObserver, memory_for
from cogrip.devices.arm.models import MODELS
from cogrip.devices.device import Capability
from cogrip.devices.openhaptics.models import RECORDS
from cogrip.devices.registry import describe

from tests.bench.velocity_trial.estimators import AdaptiveWindow, Estimator, FollowingAlphaBeta
from tests.bench.velocity_trial.hands import Motion

MEMORIES = (0.0, 0.4, 0.5, 0.6, 0.7, 0.8)
WINDOWS = (8, 16)
MARGIN = 1.25  # times WANTED_NSPM that a session should stay quiet to
SHARE = 0.9  # of the largest that any estimator carries, where none carries that much
SLOW_MPS = 0.010
RARE = 1e-3  # share of the time that the noise is above its "peak"
_SETTLE = 64  # ticks of a motion that do not count
_LONGEST = 40  # ticks that a delay is looked for in

Make = Callable[[], Estimator]


def devices() -> dict[str, Capability]:
    """Every device there is that gives no velocity, by name; of those that are alike in mass, count and age, the first."""
    listed = [listing.capability for listing in describe(axes=1) if listing.capability.family == "sim"]
    others = [listing.capability for listing in describe(axes=2) if listing.capability.family != "sim"]
    known = [*listed, *(model.record for model in MODELS.values()), *RECORDS.values(), *others]
    found: dict[tuple[float, ...], Capability] = {}
    for record in known:
        if not record.gives_velocity:
            found.setdefault((record.apparent_mass_kg, record.resolution_m, record.latency_ticks), record)
    return {f"{record.family}:{record.model}": record for record in found.values()}


def estimators(record: Capability, tick_s: float) -> dict[str, Make]:
    """Name -> maker, for one axis: alpha-beta with each memory, and the others; "client" is what runs with this device."""
    q, own = record.resolution_m, memory_for(record, tick_s)
    found: dict[str, Make] = {"client": lambda: MotionObserver(1, tick_s, own)}
    for memory in MEMORIES:
        found[f"memory {memory:g}"] = lambda memory=memory: MotionObserver(1, tick_s, memory)  # type: ignore[misc]
    for most in WINDOWS:
        found[f"window {most}"] = lambda most=most: AdaptiveWindow(1, tick_s, q, most)  # type: ignore[misc]
    found["following"] = lambda: FollowingAlphaBeta(1, tick_s, q)
    return found


@dataclass(frozen=True, slots=True)
class Found:
    """One estimator on one device. Speeds [m/s]; `largest_nspm` is the largest b of a session that stays quiet."""

    estimator: str
    error_mps: float  # rms, against the true velocity now
    delay_s: float
    slow_mps: float  # rms of the noise below SLOW_MPS, rests included
    noise_mps: float  # rms
    peak_mps: float  # exceeded RARE of the time
    largest_nspm: float

    def force_n(self, speed_mps: float) -> float:
        """Return the force of a speed at the impedance that is wanted [N]."""
        return WANTED_NSPM * speed_mps


def estimate(motion: Motion, make: Make, resolution_m: float, late: int) -> Array:
    """Return the estimate at each tick of a motion seen in whole counts, `late` ticks old."""
    estimator = make()
    place = motion.position_m - motion.position_m[0]
    if resolution_m:
        place = np.floor(place / resolution_m + 0.5) * resolution_m
    values = [0.0] * late + place.tolist()
    return np.array([estimator.update((value,))[0] for value in values[: len(place)]])


def compare(
    record: Capability, motions: Sequence[Motion], tick_s: float, largest: Callable[[Capability, Make], float]
) -> list[Found]:
    """Every estimator on one device; `largest` says what b it carries."""
    return [
        measure(name, record, make, motions, tick_s, largest(record, make))
        for name, make in estimators(record, tick_s).items()
    ]


def measure(
    name: str, record: Capability, make: Make, motions: Sequence[Motion], tick_s: float, largest_nspm: float
) -> Found:
    """One estimator on all motions of one device."""
    pairs = [
        (estimate(motion, make, record.resolution_m, record.latency_ticks), motion.velocity_mps) for motion in motions
    ]
    delay = _delay(pairs)
    now = np.concatenate([(found - true)[_SETTLE:] for found, true in pairs])
    noise, slow = [], []
    for found, true in pairs:
        grid = np.arange(len(true))
        then = np.interp(grid - delay, grid, true)
        rest = (found - then)[_SETTLE:]
        noise.append(rest)
        slow.append(rest[np.abs(then[_SETTLE:]) < SLOW_MPS])
    all_noise = np.concatenate(noise)
    peak = float(np.quantile(np.abs(all_noise), 1.0 - RARE))
    return Found(
        name, _rms(now), delay * tick_s, _rms(np.concatenate(slow)), _rms(all_noise), peak, largest_nspm
    )  # fmt: skip


def _delay(pairs: Sequence[tuple[Array, Array]]) -> float:
    """In ticks, between them by the parabola through the least square and its neighbours."""
    squares = np.zeros(_LONGEST + 1)
    for found, true in pairs:
        end = len(true) - 1
        for number, shift in enumerate(range(-1, _LONGEST)):
            squares[number] += float(((found[_SETTLE:end] - true[_SETTLE - shift : end - shift]) ** 2).sum())
    best = int(np.clip(np.argmin(squares), 1, _LONGEST - 1))
    before, least, after = squares[best - 1 : best + 2]
    return best - 1 + 0.5 * float(before - after) / float(before - 2.0 * least + after)


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean())) if values.size else 0.0


def chosen(found: Sequence[Found]) -> Found:
    """The least noise among those that stay quiet to MARGIN times the impedance that is wanted; where none does, among those

    that stay quiet to SHARE of what the best does.
    """
    enough = min(MARGIN * WANTED_NSPM, SHARE * max(one.largest_nspm for one in found))
    return min((one for one in found if one.largest_nspm >= enough), key=lambda one: one.noise_mps)
