"""The psychometric function of an observer, and what answers say of it: threshold, slope and lapses, each with its doubt.

symbols: x level, a difference from the reference, > 0; T threshold: the level at which a share `TARGET` of answers is right
where nobody lapses; beta slope; gamma guessing rate; lambda lapse rate.

Fitted is a Weibull function (Watson and Pelli 1983), c so that p(T) = TARGET with lambda = 0:

    p(x) = gamma + (1 - gamma - lambda) (1 - exp(-c (x / T)^beta)),   c = ln((1 - gamma) / (1 - TARGET))

The posterior of (ln T, ln beta, lambda) is computed on a grid: flat in ln T, and in lambda up to 10 %; log-normal about the
usual slope. A fixed slope that is wrong moves T and makes its interval too narrow, so none is assumed (Wichmann and Hill 2001).
"""

from collections.abc import Sequence
from functools import lru_cache
from math import exp, log, sqrt
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

TARGET = sqrt(0.5)  # share of right answers to which 1-up 2-down converges: p^2 = 1/2 (Levitt 1971)
GUESSING = 0.5  # probability of guessing right one of two intervals
DETECTION_SLOPE = 3.5  # slope of the detection of a difference from nothing (Watson and Pelli 1983)
DISCRIMINATION_SLOPE = 2.0
"""Slope of discrimination: between 1.3, of an observer whose d' grows with the difference, and that of detection."""
SLOPE_DOUBT = 1.3  # standard deviation of ln beta before any answer: less pulls flat observers towards the usual slope
INTERVAL = 0.95  # probability of the interval that is told
UNLIKELY = 0.01  # least `Fit.misfit` of answers that fit

_THRESHOLDS = 161
_SLOPES: NDArray[np.float64] = np.geomspace(0.6, 8.0, 14)
_LAPSES: NDArray[np.float64] = np.linspace(0.0, 0.1, 9)
_SMALLEST = 1e-9  # least probability of any answer
_C = log((1.0 - GUESSING) / (1.0 - TARGET))
_NORMAL = NormalDist()
_Z = _NORMAL.inv_cdf(TARGET)

Answered = tuple[float, bool]  # level of a stimulus, and whether the answer was right
Array = NDArray[Any]


class Prior(NamedTuple):
    """Knowledge before any answer. least, most: levels; slope, lapse: a number holds it fixed, None has it fitted."""

    least: float
    most: float
    usual_slope: float
    slope: float | None = None
    lapse: float | None = None


class Fit(NamedTuple):
    """The posterior in numbers. threshold: its median; low, high: the interval of T with probability INTERVAL.

    error   deviation of ln T
    misfit  share of observers like the fitted one whose answers would be further from it; None for too few answers to tell
    """

    threshold: float
    low: float
    high: float
    error: float
    slope: float
    lapse: float
    misfit: float | None


def weibull(level: float, threshold: float, slope: float, lapse: float = 0.0) -> float:
    """Return p(x) of the fitted function."""
    return GUESSING + (1.0 - GUESSING - lapse) * (1.0 - exp(-_C * (level / threshold) ** slope))


def gaussian(level: float, threshold: float, lapse: float = 0.0, power: float = 1.0) -> float:
    """Return p(x) of an observer whose d' grows with the difference to a power (Green and Swets 1966): not the fitted one."""
    return GUESSING + (1.0 - lapse / (1.0 - GUESSING)) * (_NORMAL.cdf(_Z * (level / threshold) ** power) - GUESSING)


class Posterior:
    """Probabilities of the grid's cells after answers.

    logs    ln T of each cell of the grid's first axis
    weight  probabilities, shape (thresholds, slopes, lapses)
    """

    def __init__(self, prior: Prior, answered: Sequence[Answered]) -> None:
        self._prior = prior
        self._slopes = _SLOPES if prior.slope is None else np.array([prior.slope])
        self._lapses = _LAPSES if prior.lapse is None else np.array([prior.lapse])
        self.logs = np.linspace(log(0.25 * prior.least), log(4.0 * prior.most), _THRESHOLDS)
        self._levels, place = np.unique([level for level, _ in answered], return_inverse=True)
        correct = np.array([right for _, right in answered], dtype=float)
        self._right = np.bincount(place, correct, len(self._levels))
        self._asked = np.bincount(place, minlength=len(self._levels))
        doubt = -0.5 * ((np.log(self._slopes) - log(prior.usual_slope)) / SLOPE_DOUBT) ** 2
        p = self.chances(self._levels)
        wrong = self._asked - self._right
        right = (self._right[:, None, None, None] * np.log(p) + wrong[:, None, None, None] * np.log1p(-p)).sum(0)
        found = right + doubt[None, :, None]
        weight = np.exp(found - found.max())
        self.weight: Array = weight / weight.sum()

    def chances(self, levels: Array) -> Array:
        """Return p at each level in each cell, shape (levels, thresholds, slopes, lapses)."""
        power = self._slopes[None, :] * (np.log(levels)[:, None, None] - self.logs[:, None])
        seen = 1.0 - np.exp(-_C * np.exp(np.minimum(power, 20.0)))
        p = GUESSING + (1.0 - GUESSING - self._lapses) * seen[..., None]
        return np.clip(p, _SMALLEST, 1.0 - _SMALLEST)

    def fit(self) -> Fit:
        """Return the posterior's median, interval and means."""
        of_threshold = self.weight.sum((1, 2))
        mean = float(of_threshold @ self.logs)
        error = sqrt(max(0.0, float(of_threshold @ (self.logs - mean) ** 2)))
        below = np.cumsum(of_threshold) - 0.5 * of_threshold  # at the middle of each cell
        tail = 0.5 * (1.0 - INTERVAL)
        threshold, low, high = np.exp(np.interp([0.5, tail, 1.0 - tail], below, self.logs)).tolist()
        slope = exp(float(self.weight.sum((0, 2)) @ np.log(self._slopes)))
        lapse = float(self.weight.sum((0, 1)) @ self._lapses)
        return Fit(threshold, low, high, error, slope, lapse, self._misfit(threshold, slope, lapse))

    def _misfit(self, threshold: float, slope: float, lapse: float) -> float | None:
        """Return how probable a larger chi-square over levels is, by observers like the fitted one, drawn with a seed."""
        often = self._asked >= _ASKED_OFTEN
        if often.sum() < _LEVELS_TO_TELL:
            return None
        asked, right = self._asked[often], self._right[often]
        p = np.array([weibull(level, threshold, slope, lapse) for level in self._levels[often]])
        p = np.clip(p, _SMALLEST, 1.0 - _SMALLEST)
        drawn = np.random.default_rng(1).binomial(asked, p, (_DRAWN, len(p)))
        spread = asked * p * (1.0 - p)
        far = ((drawn - asked * p) ** 2 / spread).sum(1)
        return float((far >= ((right - asked * p) ** 2 / spread).sum()).mean())

    def most_telling(self, levels: Array) -> int:
        """Return which level's answer leaves the least variance of ln T to be expected (Watson 2017, of T alone)."""
        p = self.chances(levels).reshape(len(levels), -1)
        weight = self.weight.reshape(-1)
        logs = np.repeat(self.logs, weight.size // len(self.logs))
        left = 0.0
        for chance in (p, 1.0 - p):
            cells = chance * weight
            total = cells.sum(1)
            left = left + cells @ logs**2 - (cells @ logs) ** 2 / total
        return int(np.argmin(left))


_ASKED_OFTEN, _LEVELS_TO_TELL, _DRAWN = 4, 3, 2000


@lru_cache(maxsize=8)
def _posterior(prior: Prior, answered: tuple[Answered, ...]) -> Posterior:
    return Posterior(prior, answered)


def posterior(prior: Prior, answered: Sequence[Answered]) -> Posterior:
    """Return the posterior after these answers."""
    return _posterior(prior, tuple(answered))
