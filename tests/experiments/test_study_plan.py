"""Orders, staircases and the state machine of a trial."""

from collections import Counter
from collections.abc import Callable
from itertools import pairwise
from math import log, sqrt
from random import Random

import pytest
from msgspec.structs import replace

from cogrip.experiments.study.orders import ordered, unfilled, williams
from cogrip.experiments.study.plan import Done, next_trial, planned
from cogrip.experiments.study.psychometric import TARGET, Answered, gaussian, weibull
from cogrip.experiments.study.questions import AnswerError, Question, items_of
from cogrip.experiments.study.staircase import Method, Staircase, estimate, next_level, unfit_staircase
from cogrip.experiments.study.trial import TRANSITIONS, TrialError, TrialEvent, TrialState

from tests.experiments.studies import PLAIN, parsed
from tests.extent import every, long

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


@pytest.mark.parametrize(("n", "repetitions", "groups"), [(3, 2, 3), (4, 1, 4), (2, 1, 4), (5, 5, 2)])
def test_groups_and_repetitions_take_every_row_of_a_square_equally_often(n: int, repetitions: int, groups: int) -> None:
    orders = [ordered("latin", range(n), repetitions, group, Random(1)) for group in range(groups)]
    taken = Counter(
        tuple(item for item, at in order if at == repetition) for order in orders for repetition in range(repetitions)
    )
    assert len(taken) == len(williams(n))
    assert len(set(taken.values())) == 1
    assert unfilled(n, repetitions, groups) == ""
    assert f"{groups} groups would balance it" not in unfilled(n, repetitions, groups + 1)


def test_a_square_that_the_participants_do_not_fill_is_said() -> None:
    assert unfilled(3, 1, 4) == "its Latin square has 6 rows, and 4 are taken: 6 groups would balance it"


def test_orders_hold_every_condition_in_every_repetition() -> None:
    for order in ("fixed", "random", "latin"):
        found = ordered(order, "abcd", 3, 1, Random(1))
        assert sorted(found) == [(item, repetition) for item in "abcd" for repetition in range(3)]
    assert ordered("fixed", "abc", 1, 5, Random(1)) == [("a", 0), ("b", 0), ("c", 0)]
    assert ordered("random", "abcdefgh", 1, 0, Random(1)) == ordered("random", "abcdefgh", 1, 0, Random(1))
    assert ordered("random", "abcdefgh", 1, 0, Random(1)) != ordered("random", "abcdefgh", 1, 0, Random(2))


Observer = Callable[[float], float]  # probability of a right answer at a level
TRUE = 60.0


def observer(slope: float | None, lapse: float, threshold: float = TRUE) -> Observer:
    """Return an observer: of a Weibull function, or where the slope is None one that no fit assumes."""
    if slope is None:
        return lambda level: gaussian(level, threshold, lapse)
    return lambda level: weibull(level, threshold, slope, lapse)


@pytest.mark.parametrize("slope", [None, 1.0, 3.5])
def test_psychometric_functions_pass_their_target_at_the_threshold(slope: float | None) -> None:
    assert observer(slope, 0.0)(TRUE) == pytest.approx(TARGET)
    assert observer(slope, 0.0)(0.0) == 0.5
    assert observer(slope, 0.02)(1e6) == pytest.approx(0.98)
    assert pytest.approx(0.5) == TARGET**2, "two right answers in a row are as probable as not: 1-up 2-down stays"


def run_track(rule: Staircase, answers: Observer, seed: int) -> list[Answered]:
    random, answered = Random(seed), list[Answered]()
    while (level := next_level(rule, answered)) is not None:
        assert rule.least <= level <= rule.most
        answered.append((level, random.random() < answers(level)))
    return answered


OBSERVERS = [(None, 0.0), (None, 0.05), (1.3, 0.02), (2.0, 0.0), (2.0, 0.05), (3.5, 0.0), (4.0, 0.05)]


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("method", "slope", "lapse"), every(7, [(m, *o) for m in ("1-up-2-down", "pest") for o in OBSERVERS])
)
def test_thresholds_of_observers_that_were_not_made_from_the_fit(
    method: Method, slope: float | None, lapse: float
) -> None:
    """Take 30 observers, 200 answers each: the mean is near, and the interval has the threshold as often as told."""
    rule = replace(RULE, method=method, trials=50)
    found = []
    for seed in range(30):
        tracks: list[list[Answered]] = []
        while sum(map(len, tracks)) < 200:
            tracks.append(run_track(rule, observer(slope, lapse), 1000 * seed + len(tracks)))
        found.append(estimate(rule, tracks))
    bias = sum(log(each.threshold / TRUE) for each in found) / len(found)
    spread = sqrt(sum((log(each.threshold / TRUE) - bias) ** 2 for each in found) / len(found))
    assert abs(bias) < 0.07 + 2.0 * spread / sqrt(len(found)), (
        "0.07 of the estimate, and twice the error of 30 observers"
    )
    assert sum(each.low <= TRUE <= each.high for each in found) >= 26
    assert sum(bool(each.warnings) for each in found) <= 3


@pytest.mark.parametrize("trials", [30, long(60)])
def test_quest_comes_near_in_few_trials(trials: int) -> None:
    rule = replace(RULE, method="quest", trials=trials)
    found = [estimate(rule, [run_track(rule, observer(None, 0.0), seed)]) for seed in range(4)]
    assert sum(each.low <= TRUE <= each.high for each in found) >= 3
    levels = {level for level, _ in run_track(rule, observer(None, 0.0), 1)}
    assert len(levels) > 3, "slope and lapses are asked for as well"


def test_a_track_at_its_bound_tells_no_threshold() -> None:
    found = estimate(RULE, [run_track(RULE, observer(2.0, 0.0, threshold=1500.0), seed) for seed in range(3)])
    assert "most = 600: the threshold may be above it" in found.warnings[0]
    low = replace(RULE, trials=200, step=2.0)
    found = estimate(low, [run_track(low, observer(2.0, 0.0, threshold=2.0), seed) for seed in range(3)])
    assert "least = 10: the threshold may be below it" in found.warnings[0]


def test_answers_that_no_function_fits_are_told() -> None:
    """An observer takes the other button half of the time, at large differences alone."""
    answers = [
        (level, number < right)
        for level, right in ((20.0, 12), (40.0, 30), (80.0, 39), (160.0, 20))
        for number in range(40)
    ]
    assert any("do not fit" in text for text in estimate(RULE, [answers]).warnings)
    fitting = [
        (level, number < right)
        for level, right in ((20.0, 22), (40.0, 25), (80.0, 31), (160.0, 38))
        for number in range(40)
    ]
    assert estimate(RULE, [fitting]).warnings == ()


def test_reversals_are_those_of_the_track() -> None:
    levels = [200.0, 100.0, 150.0, 100.0, 150.0, 100.0, 120.0, 100.0]
    found = estimate(RULE, [[(level, True) for level in levels]])
    assert found.reversals == pytest.approx(sqrt(100.0 * 120.0)), "turns: 100, 150, 100, 150, then 100 and 120"


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
    (latin,) = [block for block in study.blocks if block.order == "latin"]
    again = replace(study, blocks=(replace(latin, repetitions=1),))
    first, second = (next_trial(again, group, []) for group in (0, 1))
    assert first is not None
    assert second is not None
    assert first.condition != second.condition, "groups take the rows of the square in turn"


def test_trial_follows_its_table_and_no_other() -> None:
    for state in ("waiting", "running", "asking", "paused", "finished", "abandoned"):
        for event in TrialEvent:
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
    assert trial.handle(TrialEvent.ENDED) == "waiting", "the second interval"
    assert not trial.ready("P02"), "everybody has to be ready again"
    assert trial.ready("P01")
    assert trial.handle(TrialEvent.ENDED) == "asking"
    assert trial.attempt == 1


@pytest.mark.parametrize("event", [TrialEvent.PAUSE, TrialEvent.REPEAT, TrialEvent.FAILED])
def test_interrupted_session_is_another_attempt_from_the_first_interval_on(event: TrialEvent) -> None:
    trial = TrialState(2, ["P01"])
    trial.ready("P01")
    trial.handle(TrialEvent.ENDED)
    trial.ready("P01")
    trial.handle(event)
    assert (trial.attempt, trial.session) == (2, 0)
    waiting = TrialState(1, ["P01"])
    waiting.handle(TrialEvent.PAUSE)
    assert waiting.handle(TrialEvent.RESUME) == "waiting"
    assert (waiting.attempt, waiting.pauses) == (1, 1), "nothing was lost"


@pytest.mark.parametrize(
    ("choices", "takes", "typed", "answer"),
    [(("first", "second"), "1 first, 2 second", "2", "second"), (("0", "1", "2"), "0, 1, 2", "1", "1")],
)
def test_a_choice_that_reads_as_a_number_is_typed_as_it_stands(
    choices: tuple[str, ...], takes: str, typed: str, answer: str
) -> None:
    (item,) = items_of("count", Question(kind="choice", text="How many?", choices=choices))
    assert item.takes == takes
    assert item.read(typed) == answer
    with pytest.raises(AnswerError, match="is no answer here"):
        item.read("3")
