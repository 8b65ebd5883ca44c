"""`dev.py bench thresholds`: bias and coverage of thresholds, of observers that the fit does not assume."""

from collections.abc import Callable, Sequence
from math import exp, expm1, log
from random import Random
from statistics import NormalDist, fmean, pstdev
from typing import Annotated

from cyclopts import Parameter

from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.tables import plain_table
from cogrip.experiments.study.psychometric import GUESSING, TARGET, Answered, gaussian
from cogrip.experiments.study.staircase import Estimate, Method, Staircase, estimate, next_level

TRUE = 60.0
RULE = Staircase(key="k", reference=600.0, start=200.0, least=10.0, most=600.0, question="q")
_NORMAL = NormalDist()
_Z, _ODDS = _NORMAL.inv_cdf(TARGET), log(TARGET / (1.0 - TARGET))
_C = log((1.0 - GUESSING) / (1.0 - TARGET))
# Slopes of p over ln x at the threshold, of exponents of 1: by them exponents are chosen that are as steep there as a Weibull.
_WEIBULL = (1.0 - GUESSING) * _C * exp(-_C)
_GAUSSIAN = _NORMAL.pdf(_Z) * _Z
_LOGISTIC = TARGET * (1.0 - TARGET) * _ODDS

Observer = Callable[[float], float]
"""level -> probability of a right answer"""


def gaussian_observer(slope: float, lapse: float) -> Observer:
    """Return an observer with Gaussian noise, as steep at the threshold as a Weibull function of this slope."""
    power = slope * _WEIBULL / _GAUSSIAN
    return lambda level: gaussian(level, TRUE, lapse, power)


def logistic_observer(slope: float, lapse: float) -> Observer:
    """Return an observer who chooses with logistic noise (Luce 1959), as steep at the threshold as such a Weibull."""
    power = slope * _WEIBULL / _LOGISTIC

    def chance(level: float) -> float:
        seen = 1.0 / (1.0 + exp(-_ODDS * (level / TRUE) ** power))
        return GUESSING + (1.0 - lapse / (1.0 - GUESSING)) * (seen - GUESSING)

    return chance


FAMILIES = {"gaussian": gaussian_observer, "logistic": logistic_observer}


def observed(rule: Staircase, observer: Observer, seed: str, answers: int) -> Estimate:
    """Return the estimate of one observer, after so many answers in tracks and the catch trials between them."""
    random, tracks, caught = Random(seed), [list[Answered]()], list[Answered]()
    given = 0
    while given < answers:
        level = next_level(rule, tracks[-1])
        if level is None:
            tracks.append([])
            continue
        tracks[-1].append((level, random.random() < observer(level)))
        given += 1
        if rule.catch_every and (given + len(caught) + 1) % rule.catch_every == 0:
            caught.append((rule.most, random.random() < observer(rule.most)))
    return estimate(rule, tracks, caught)


def bench_thresholds(
    *,
    seeds: int = 200,
    answers: int = 200,
    track: int = 50,
    method: Method = "1-up-2-down",
    catch_every: int = 4,
    slopes: Annotated[Sequence[float], Parameter(consume_multiple=True)] = (1.0, 1.3, 2.0, 3.5, 4.0),
    lapses: Annotated[Sequence[float], Parameter(consume_multiple=True)] = (0.0, 0.02, 0.05),
) -> int:
    """Estimate thresholds of observers whose function is not the fitted one. Exit code 1 where a bias is above 5 %.

    Or where an interval of 95 % holds fewer than 90 % of the thresholds.
    """
    rule = Staircase(
        method=method, key="k", reference=RULE.reference, start=RULE.start, least=RULE.least, most=RULE.most,
        trials=track, question="q", catch_every=catch_every,
    )  # fmt: skip
    rows, well = [], True
    for name, family in FAMILIES.items():
        for slope in slopes:
            for lapse in lapses:
                observer = family(slope, lapse)
                found = [observed(rule, observer, f"{name}/{slope}/{lapse}/{seed}", answers) for seed in range(seeds)]
                logs = [log(each.threshold / TRUE) for each in found]
                turns = [log(each.reversals / TRUE) for each in found if each.reversals is not None]
                bias = expm1(fmean(logs))
                held = fmean(each.low <= TRUE <= each.high for each in found)
                kept = abs(bias) <= 0.05 and held >= 0.9
                well &= kept
                rows.append(
                    (
                        name, f"{slope:g}", f"{100 * lapse:g} %", f"{100 * bias:+.1f} %", f"{100 * pstdev(logs):.0f} %",
                        f"{100 * held:.0f} %", f"{100 * expm1(fmean(turns)):+.1f} %" if turns else "-", "" if kept else "!",
                    )
                )  # fmt: skip
    make_console().print(
        plain_table(("observer", "slope", "lapses", "bias", "spread", "95 % holds", "reversals", ""), rows, left=1)
    )
    return 0 if well else 1
