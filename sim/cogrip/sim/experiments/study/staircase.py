"""Adaptive levels for thresholds: 1-up 2-down, PEST, QUEST; and the estimate from all answers.

symbols: x level, a difference from the reference [unit of the key], > 0; T threshold: the level at which a share `TARGET` of
answers is right; beta slope; gamma guessing rate; lambda lapse rate.

Psychometric function (Weibull, Watson and Pelli 1983), c so that p(T) = TARGET where nobody lapses:

    p(x) = gamma + (1 - gamma - lambda) (1 - exp(-c (x / T)^beta)),   c = ln((1 - gamma) / (1 - TARGET))

All rules work on ln x: levels are multiplied and divided. A rule is a function of what was answered, so a study that is
resumed goes on as if it had never been interrupted.
"""

from collections.abc import Callable, Sequence
from math import exp, log, sqrt
from typing import Annotated, Literal, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

TARGET = sqrt(0.5)  # to which 1-up 2-down converges: p^2 = 1/2 (Levitt 1971)
GUESSING = 0.5  # of two intervals
_GRID = 401
_PEST_WALD = 1.0  # deviation limit W of the sequential test (Taylor and Creelman 1967)
_MOST_PEST_STEPS = 8.0  # times the first step
_OPTIMAL = 1.3  # QUEST presents this times the estimate: there beta = 3.5 tells most about T

Answered = tuple[float, bool]  # level, and whether the answer was right
Method = Literal["1-up-2-down", "pest", "quest"]
Positive = Annotated[float, msgspec.Meta(gt=0.0)]


class Staircase(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """[blocks.staircase]. key: the setting that has `reference` in one interval, and reference + level in the other.

    start, least, most: levels, in the unit of the key; step: first factor from one level to the next. A track ends after
    `trials`, and before where it had `reversals` (1-up 2-down), or where steps are below `least_step` (PEST).
    question: a choice of two whose answer is right where it names the interval with the larger value.
    """

    method: Method = "1-up-2-down"
    key: str
    reference: float
    start: Positive
    least: Positive
    most: Positive
    step: Annotated[float, msgspec.Meta(gt=1.0, le=10.0)] = 1.5
    least_step: Annotated[float, msgspec.Meta(gt=1.0, le=10.0)] = 1.1
    trials: Annotated[int, msgspec.Meta(ge=2, le=10_000)] = 60
    reversals: Annotated[int, msgspec.Meta(ge=2, le=1000)] | None = None
    slope: Annotated[float, msgspec.Meta(gt=0.0, le=20.0)] = 3.5
    lapse: Annotated[float, msgspec.Meta(ge=0.0, le=0.2)] = 0.01
    question: str


class Estimate(NamedTuple):
    """A threshold with its standard error as a share of it, the share of right answers, and their number."""

    threshold: float
    relative_error: float
    correct: float
    trials: int


def probability(level: float, threshold: float, slope: float, lapse: float = 0.0, guessing: float = GUESSING) -> float:
    """Return p(x), see above."""
    c = log((1.0 - guessing) / (1.0 - TARGET))
    return guessing + (1.0 - guessing - lapse) * (1.0 - exp(-c * (level / threshold) ** slope))


def next_level(rule: Staircase, answered: Sequence[Answered]) -> float | None:
    """Return the level of a track's next trial, None where the track is over."""
    if len(answered) >= rule.trials:
        return None
    level = _RULES[rule.method](rule, answered)
    return None if level is None else min(rule.most, max(rule.least, level))


def _up_down(rule: Staircase, answered: Sequence[Answered]) -> float | None:
    """Up after a wrong answer, down after two right ones; the step halves (in ln x) at each of the first three reversals."""
    level, right, turns, last = log(rule.start), 0, 0, 0
    step = log(rule.step)
    for _, correct in answered:
        right = right + 1 if correct else 0
        move = 0 if correct and right < 2 else -1 if correct else 1
        if not move:
            continue
        right = 0
        if last and move != last:
            turns += 1
            if turns <= 3:
                step = max(0.5 * step, log(rule.least_step))
        level, last = min(log(rule.most), max(log(rule.least), level + move * step)), move
    return None if rule.reversals is not None and turns >= rule.reversals else exp(level)


def _pest(rule: Staircase, answered: Sequence[Answered]) -> float | None:
    """Change the level where a sequential test says that it is too easy or too hard (Taylor and Creelman 1967).

    Steps halve at a reversal, stay for the second in one direction, double from the fourth on, and at the third unless the
    step before the last reversal came of a doubling.
    """
    level, step, most = log(rule.start), log(rule.step), _MOST_PEST_STEPS * log(rule.step)
    last = same = right = count = 0
    doubled = was_doubled = False
    for _, correct in answered:
        right, count = right + correct, count + 1
        surplus = right - TARGET * count
        if abs(surplus) < _PEST_WALD:
            continue
        move, right, count = -1 if surplus > 0.0 else 1, 0, 0
        if last and move != last:
            step, same, was_doubled, doubled = 0.5 * step, 1, doubled, False
            if step < log(rule.least_step):
                return None
        else:
            same += 1
            doubled = same > 3 or (same == 3 and not was_doubled)
            step = min(most, 2.0 * step) if doubled else step
        level, last = min(log(rule.most), max(log(rule.least), level + move * step)), move
    return exp(level)


def _quest(rule: Staircase, answered: Sequence[Answered]) -> float:
    """Present where an answer tells most about the threshold as it is estimated so far (Watson and Pelli 1983)."""
    return _OPTIMAL * estimate(rule, answered).threshold if answered else rule.start


_RULES: dict[Method, Callable[[Staircase, Sequence[Answered]], float | None]] = {
    "1-up-2-down": _up_down,
    "pest": _pest,
    "quest": _quest,
}


def estimate(rule: Staircase, answered: Sequence[Answered]) -> Estimate:
    """Return the mean of ln T over its likelihood, flat before any answer from least / 4 to 4 most: QUEST's estimate.

    It takes the answers of every method. The error is the likelihood's standard deviation.
    """
    grid: NDArray[np.float64] = np.linspace(log(0.25 * rule.least), log(4.0 * rule.most), _GRID)
    levels = np.log([level for level, _ in answered])
    correct = np.array([correct for _, correct in answered], dtype=bool)
    c = log((1.0 - GUESSING) / (1.0 - TARGET))
    seen = 1.0 - np.exp(-c * np.exp(rule.slope * (levels[:, None] - grid)))
    p = GUESSING + (1.0 - GUESSING - rule.lapse) * seen
    likelihood = np.log(np.maximum(np.where(correct[:, None], p, 1.0 - p), 1e-12)).sum(axis=0)
    weight = np.exp(likelihood - likelihood.max())
    weight /= weight.sum()
    mean = float(weight @ grid)
    deviation = sqrt(max(0.0, float(weight @ (grid - mean) ** 2)))
    right = float(correct.mean()) if answered else 0.0
    return Estimate(exp(mean), deviation, right, len(answered))


def unfit_staircase(rule: Staircase) -> str:
    """Return why a staircase cannot be run, "" if it can."""
    if not rule.least <= rule.start <= rule.most:
        return f"start = {rule.start:g} is not from least = {rule.least:g} to most = {rule.most:g}; set them in order"
    if rule.least_step > rule.step:
        return f"least_step = {rule.least_step:g} is above step = {rule.step:g}; set it lower"
    return ""
