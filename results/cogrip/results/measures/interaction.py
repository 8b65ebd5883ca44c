"""Measures of what people do to each other (docs/measures.md). Each takes a run's columns and a person's number."""

import numpy as np

from cogrip.machine.addition import add_floats
from cogrip.results.measures.columns import Array, RunColumns
from cogrip.results.measures.motion import smooth

MOST_LAG_S = 0.5


def interaction_mean_n(run: RunColumns, person: int) -> float | None:
    """Mean over time of the interaction force."""
    force = interaction_force(run)
    return None if force is None else float(force.mean())


def interaction_peak_n(run: RunColumns, person: int) -> float | None:
    """Largest interaction force."""
    force = interaction_force(run)
    return None if force is None else float(force.max())


def interaction_force(run: RunColumns) -> Array | None:
    """Return (sum_i |f_i| - |sum_i f_i|) / 2 for each frame [N], f_i what person i pulls with; None for one person.

    What people pull against each other cancels in the sum, moves nothing, and so does no work. Along one axis it is the
    smaller of what pulls either way: 0 where one does nothing, or where all pull alike.
    """
    if len(run.people) < 2:
        return None
    pulls = np.stack([person.pull_n for person in run.people])
    together = np.linalg.norm(pulls.sum(axis=0), axis=1)
    return np.asarray(0.5 * (np.linalg.norm(pulls, axis=2).sum(axis=0) - together))


def synchrony(run: RunColumns, person: int) -> float | None:
    """Largest cross-correlation of this hand's velocity with another's within MOST_LAG_S; the mean over all others."""
    return _mean([peak for peak, _ in _with_others(run, person)])


def lead_s(run: RunColumns, person: int) -> float | None:
    """Lag at which that is largest: above 0 where this person moves first; the mean over all others."""
    return _mean([lag for _, lag in _with_others(run, person)])


def _mean(values: list[float]) -> float | None:
    return add_floats(values) / len(values) if values else None


def _with_others(run: RunColumns, person: int) -> list[tuple[float, float]]:
    mine = _velocity(run, person)
    found = [correlate(mine, _velocity(run, other), run.rate_hz) for other in range(len(run.people)) if other != person]
    return [each for each in found if each is not None]


def _velocity(run: RunColumns, person: int) -> Array:
    """Return a hand's velocity at the frames of the room, shape (n - 1, a) [m/s]."""
    hand = run.people[person]
    position = smooth(hand.position_m, hand.rate_hz)
    at = np.stack([np.interp(run.time_s, hand.time_s, column) for column in position.T], axis=1)
    return np.diff(at, axis=0) * run.rate_hz


def correlate(first: Array, second: Array, rate_hz: float) -> tuple[float, float] | None:
    """Return (r, lag [s]) of the largest r(lag) = sum_t first(t) second(t + lag) / sqrt(sum first^2 sum second^2).

    Sums are over the rows that both have at that lag, means taken off; between frames a parabola is laid through the largest
    three. Lags go to a quarter of what there is at most. None where one does not move.
    """
    n = len(first)
    most = min(round(MOST_LAG_S * rate_hz), n // 4)
    first, second = first - first.mean(axis=0), second - second.mean(axis=0)
    lags = range(-most, most + 1)
    found = np.zeros(len(lags))
    for place, lag in enumerate(lags):
        a, b = first[max(0, -lag) : n - max(0, lag)], second[max(0, lag) : n - max(0, -lag)]
        size = float(np.sqrt(np.sum(a * a) * np.sum(b * b)))
        if size > 0.0:
            found[place] = float(np.sum(a * b)) / size
    if not found.any():
        return None
    best = int(found.argmax())
    shift = 0.0
    if 0 < best < len(found) - 1:
        before, here, after = found[best - 1 : best + 2]
        bend = before - 2.0 * here + after
        shift = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    return float(found[best]), float(best - most + shift) / rate_hz
