"""Adaptive levels for thresholds: 1-up 2-down, PEST, QUEST; and the estimate from all answers (`psychometric`).

All rules work on ln x: levels are multiplied and divided. A rule is a function of what was answered, so a study that is
resumed goes on as if it had never been interrupted.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import exp, log
from typing import Annotated, Literal, NamedTuple

import msgspec
import numpy as np

from cogrip.experiments.study.psychometric import (
    DETECTION_SLOPE,
    DISCRIMINATION_SLOPE,
    TARGET,
    UNLIKELY,
    Answered,
    Prior,
    posterior,
)
from cogrip.machine.addition import add_integers

_PEST_WALD = 1.0  # deviation limit W of the sequential test (Taylor and Creelman 1967)
_MOST_PEST_STEPS = 8.0  # largest step of PEST, in first steps
_QUEST_LEVELS = 33  # number of levels from least to most, among which QUEST chooses
_FIRST_REVERSALS = 4  # number of first reversals, in which a track comes near: they are left out of the mean
_LEAST_REVERSALS = 2  # least number of reversals of which a mean is told
_DIGITS = 6  # number of digits of a level
CATCH_EVERY = 4  # usual trials of a block for each catch trial: biases in docs/studies.md are with it
_AT_BOUND = 0.25  # share of a track's answers at a bound above which the track sits there

Method = Literal["1-up-2-down", "pest", "quest"]
Positive = Annotated[float, msgspec.Meta(gt=0.0)]


class Staircase(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """[blocks.staircase]. key: the setting that has `reference` in one interval, and reference + level in the other.

    start, least, most: levels, in the unit of the key; step: first factor from one level to the next. A track ends after
    `trials`, and before where it had `reversals` (1-up 2-down), or where steps are below `least_step` (PEST).
    question: a choice of two whose answer is right where it names the interval with the larger value.
    slope, lapse: of the observers, where they are known; fitted where nothing is said.
    catch_every: each so many trials of the block one has the largest level; its answer moves no track, and tells of lapses
    in the estimate; 0: none has.
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
    slope: Annotated[float, msgspec.Meta(gt=0.0, le=20.0)] | None = None
    lapse: Annotated[float, msgspec.Meta(ge=0.0, le=0.2)] | None = None
    catch_every: Annotated[int, msgspec.Meta(ge=0, le=10_000)] = CATCH_EVERY
    question: str

    @property
    def prior(self) -> Prior:
        """Knowledge before any answer: a difference from nothing is detected, from something discriminated."""
        usual = DISCRIMINATION_SLOPE if self.reference else DETECTION_SLOPE
        return Prior(self.least, self.most, usual, self.slope, self.lapse)


class Estimate(NamedTuple):
    """A threshold, its interval, its standard error as a share of it, the share of right answers, and their number.

    reversals  geometric mean of the levels at which tracks turned, without the first ones; None where too few did. It lies
               above the threshold of an observer who is flat or lapses
    warnings   why it may be none: the answers do not fit, or a track sat at a bound
    """

    threshold: float
    low: float
    high: float
    relative_error: float
    slope: float
    lapse: float
    correct: float
    trials: int
    reversals: float | None
    warnings: tuple[str, ...]


def next_level(rule: Staircase, answered: Sequence[Answered]) -> float | None:
    """Return the level of a track's next trial, None where the track is over."""
    if len(answered) >= rule.trials:
        return None
    level = _RULES[rule.method](rule, answered)
    return None if level is None else float(f"{min(rule.most, max(rule.least, level)):.{_DIGITS}g}")


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
    """Present the level whose answer tells most about the threshold (QUEST: Watson and Pelli 1983; QUEST+: Watson 2017)."""
    if not answered:
        return rule.start
    levels = np.geomspace(rule.least, rule.most, _QUEST_LEVELS)
    return float(levels[posterior(rule.prior, answered).most_telling(levels)])


_RULES: dict[Method, Callable[[Staircase, Sequence[Answered]], float | None]] = {
    "1-up-2-down": _up_down,
    "pest": _pest,
    "quest": _quest,
}


def estimate(rule: Staircase, tracks: Sequence[Sequence[Answered]], caught: Sequence[Answered] = ()) -> Estimate:
    """Return the estimate from the answers of all tracks of an observer, whatever the method.

    caught: answers of catch trials, which tell lapses from a flat slope
    """
    answered = [each for track in tracks for each in track]
    fit = posterior(rule.prior, [*answered, *caught]).fit()
    right = add_integers(correct for _, correct in answered) / len(answered) if answered else 0.0
    turned = [level for track in tracks for level in _reversals(track)[_FIRST_REVERSALS:]]
    mean = float(np.exp(np.mean(np.log(turned)))) if len(turned) >= _LEAST_REVERSALS else None
    warnings = [_at_bound(rule, answered)]
    if fit.misfit is not None and fit.misfit < UNLIKELY:
        warnings.append(f"answers do not fit any one threshold, slope and lapse rate (p = {fit.misfit:.2g})")
    return Estimate(
        fit.threshold, fit.low, fit.high, fit.error, fit.slope, fit.lapse, right, len(answered), mean,
        tuple(filter(None, warnings)),
    )  # fmt: skip


def _reversals(track: Sequence[Answered]) -> list[float]:
    """Return the levels at which a track turned."""
    found, last = [], 0.0
    for (level, _), (after, _) in pairwise(track):
        if after != level:
            move = 1.0 if after > level else -1.0
            if last and move != last:
                found.append(level)
            last = move
    return found


def _at_bound(rule: Staircase, answered: Sequence[Answered]) -> str:
    """Return that the answers are about a bound, and not about a threshold; "" where they are not."""
    for bound, words, beyond in ((rule.most, "most", "above"), (rule.least, "least", "below")):
        share = add_integers(level == bound for level, _ in answered) / max(1, len(answered))
        if share > _AT_BOUND:
            return f"{100.0 * share:.0f} % of the answers were given at {words} = {bound:g}: the threshold may be {beyond} it"
    return ""


def uncaught(rule: Staircase) -> str:
    """Return what a threshold without catch trials is worth, "" where there are some, or where lapses are known."""
    if rule.catch_every or rule.lapse is not None:
        return ""
    return (
        "no catch trials: lapses and a flat slope look alike, and 200 answers told thresholds of rehearsed observers from 11 % "
        f"too low to 9 % too high (docs/studies.md); staircase.catch_every = {CATCH_EVERY} tells them apart"
    )


def unfit_staircase(rule: Staircase) -> str:
    """Return why a staircase cannot be run, "" if it can."""
    if not rule.least <= rule.start <= rule.most:
        return f"start = {rule.start:g} is not from least = {rule.least:g} to most = {rule.most:g}; set them in order"
    if rule.least_step > rule.step:
        return f"least_step = {rule.least_step:g} is above step = {rule.step:g}; set it lower"
    return ""
