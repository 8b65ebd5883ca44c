"""Orders, staircases and the state machine of a trial."""

from collections import Counter
from itertools import pairwise
from math import log, sqrt
from random import Random

import pytest
from msgspec.structs import replace

from cogrip.sim.experiments.study.orders import ordered, williams
from cogrip.sim.experiments.study.plan import Done, next_trial, planned
from cogrip.sim.experiments.study.staircase import (
    TARGET,
    Answered,
    Method,
    Staircase,
    estimate,
    next_level,
    probability,
    unfit_staircase,
)
from cogrip.sim.experiments.study.trial import TRANSITIONS, Event, TrialError, TrialState

from tests.extent import every
from tests.sim.studies import PLAIN, parsed

RULE = Staircase(key="k", reference=600.0, start=200.0, least=10.0, most=600.0, trials=60, question="q")


@pytest.mark.parametrize("n", range(1, 9))
def test_williams_squares_are_balanced_in_place_and_in_order(n: int) -> None:
    rows = williams(n)
    assert len(rows) == (n if n % 2 == 0 or n == 1 else 2 * n)
    assert all(sorted(row) == list(range(n)) for row in rows)
    places = Counter((place, item) for row in rows for place, item in enumerate(row))
    assert set(places.values()) == {len(rows) // n}
    pairs = Counter(pair for row in rows for pair in pairwise(row))
    assert len(pairs) == n * (n - 1)
    assert len(set(pairs.values())) <= 1


def test_orders_hold_every_condition_in_every_repetition() -> None:
    for order in ("fixed", "random", "latin"):
        found = ordered(order, "abcd", 3, 1, Random(1))
        assert sorted(found) == [(item, repetition) for item in "abcd" for repetition in range(3)]
    assert ordered("fixed", "abc", 1, 5, Random(1)) == [("a", 0), ("b", 0), ("c", 0)]
    assert ordered("random", "abcdefgh", 1, 0, Random(1)) == ordered("random", "abcdefgh", 1, 0, Random(1))
    assert ordered("random", "abcdefgh", 1, 0, Random(1)) != ordered("random", "abcdefgh", 1, 0, Random(2))


def test_psychometric_function_passes_its_target_at_the_threshold() -> None:
    assert probability(60.0, 60.0, 3.5) == pytest.approx(TARGET)
    assert probability(0.0, 60.0, 3.5) == 0.5
    assert probability(1e4, 60.0, 3.5, lapse=0.02) == pytest.approx(0.98)
    assert pytest.approx(0.5) == TARGET**2, "two right answers in a row are as probable as not: 1-up 2-down stays"


def run_track(rule: Staircase, threshold: float, seed: int) -> list[Answered]:
    random, answered = Random(seed), list[Answered]()
    while (level := next_level(rule, answered)) is not None:
        assert rule.least <= level <= rule.most
        answered.append((level, random.random() < probability(level, threshold, rule.slope)))
    return answered


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("method", "threshold"), every(8, [(m, t) for t in (20.0, 60.0, 250.0) for m in ("1-up-2-down", "pest", "quest")])
)
def test_thresholds_of_known_observers_are_estimated_within_a_tenth(method: Method, threshold: float) -> None:
    """Take 20 observers, 200 answers each in tracks of 50: the mean is within 5 %, the root mean square 10 %."""
    rule = Staircase(
        method=method, key="k", reference=600.0, start=200.0, least=5.0, most=1000.0, trials=50, lapse=0.0, least_step=1.05,
        question="q",
    )  # fmt: skip
    found = [
        estimate(rule, [each for track in range(4) for each in run_track(rule, threshold, 100 * observer + track)])
        for observer in range(20)
    ]
    errors = [log(each.threshold / threshold) for each in found]
    spread = sqrt(sum(error**2 for error in errors) / len(errors))
    assert abs(sum(errors) / len(errors)) < 0.05
    assert spread < 0.1
    stated = sum(each.relative_error for each in found) / len(found)
    assert 0.6 * spread < stated < 1.7 * spread, "the error that is stated is the one that is made"


def test_one_up_two_down_moves_as_its_name_says() -> None:
    answered: list[Answered] = []
    for correct in (True, True, True, True, False, False, True, True):
        answered.append((next_level(RULE, answered) or 0.0, correct))
    ratios = [round(after / before, 3) for (before, _), (after, _) in pairwise(answered)]
    down, up = round(1 / 1.5, 3), round(sqrt(1.5), 3)
    assert ratios == [1.0, down, 1.0, down, up, up, 1.0]
    turned = replace(RULE, reversals=2)
    assert next_level(turned, answered) is None


def test_pest_steps_halve_and_double() -> None:
    rule = replace(RULE, method="pest", start=600.0, step=1.5, least_step=1.3)
    answered: list[Answered] = []
    while (level := next_level(rule, answered)) is not None:
        answered.append((level, level > 50.0))
    assert len(answered) < rule.trials, "it ends where steps are small"
    levels = dict.fromkeys(level for level, _ in answered)
    steps = [round(log(after / before) / log(1.5), 3) for before, after in pairwise(levels)]
    assert steps[:4] == [-1.0, -1.0, -2.0, -4.0], "the third of a run doubles, the fourth too"
    assert steps[4] == 2.0, "a reversal halves"


def test_quest_presents_near_its_estimate() -> None:
    rule = replace(RULE, method="quest")
    answered = run_track(rule, 60.0, 3)
    level = next_level(replace(rule, trials=61), answered)
    assert level == pytest.approx(1.3 * estimate(rule, answered).threshold)


def test_staircases_out_of_order_are_refused() -> None:
    assert unfit_staircase(RULE) == ""
    assert "start = 200" in unfit_staircase(replace(RULE, most=199.0))
    assert unfit_staircase(replace(RULE, most=200.0)) == ""


def test_plan_is_a_function_of_what_is_done() -> None:
    study = parsed(PLAIN)
    done: list[Done] = []
    numbers = []
    while (trial := next_trial(study, 0, done)) is not None:
        assert trial == next_trial(study, 0, list(done))
        numbers.append(trial.number)
        if trial.block.name == "two":
            values = [each.changes["coupling.damping_nspm"] for each in trial.presentations]
            assert trial.right == values.index(max(values))
            assert max(values) - min(values) == pytest.approx(trial.level)
        right = None if trial.level is None else True
        done.append(Done(trial.block.name, trial.place, trial.track, trial.level, right))
    assert numbers == list(range(1, planned(study, 0) + 1))
    first, second = (next_trial(study, group, []) for group in (0, 1))
    assert first is not None
    assert second is not None
    assert first.condition != second.condition, "groups take the rows of the square in turn"


def test_trial_follows_its_table_and_no_other() -> None:
    for state in ("waiting", "running", "asking", "paused", "finished", "abandoned"):
        for event in Event:
            trial = TrialState(1, ["P01"])
            trial.state = state  # type: ignore[assignment]
            if (state, event) in TRANSITIONS:
                assert trial.handle(event) == TRANSITIONS[state, event]  # type: ignore[index]
            else:
                with pytest.raises(TrialError, match=state):
                    trial.handle(event)


def test_trial_starts_when_everybody_is_ready_and_not_before() -> None:
    trial = TrialState(2, ["P01", "P02"])
    assert not trial.ready("P01")
    assert not trial.ready("P01")
    assert not trial.ready("somebody else")
    assert trial.ready("P02")
    assert trial.state == "running"
    assert trial.handle(Event.ENDED) == "waiting", "the second interval"
    assert not trial.ready("P02"), "everybody has to be ready again"
    assert trial.ready("P01")
    assert trial.handle(Event.ENDED) == "asking"
    assert trial.attempt == 1


@pytest.mark.parametrize("event", [Event.PAUSE, Event.REPEAT, Event.FAILED])
def test_interrupted_session_is_another_attempt_from_the_first_interval_on(event: Event) -> None:
    trial = TrialState(2, ["P01"])
    trial.ready("P01")
    trial.handle(Event.ENDED)
    trial.ready("P01")
    trial.handle(event)
    assert (trial.attempt, trial.session) == (2, 0)
    waiting = TrialState(1, ["P01"])
    waiting.handle(Event.PAUSE)
    assert waiting.handle(Event.RESUME) == "waiting"
    assert (waiting.attempt, waiting.pauses) == (1, 1), "nothing was lost"
