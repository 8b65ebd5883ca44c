"""Trials of a group: which one comes next, from what was answered so far.

`next_trial` is a function of the journal alone: a study that is resumed has the trials that it would have had.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from random import Random
from typing import Any, NamedTuple

from cogrip.experiments.study.orders import ordered
from cogrip.experiments.study.psychometric import Answered
from cogrip.experiments.study.staircase import Staircase, next_level
from cogrip.experiments.study.study_file import Block, Study

CATCH = "catch"
"""Track of catch trials: whoever attends finds their level, so that a wrong answer tells of a lapse, and no track has it."""
_SEEDS = 2**31  # number of seeds from which sessions draw


class Done(NamedTuple):
    """A trial that is over, as the plan needs it. correct: of a staircase's answer, None where there is none."""

    block: str
    place: int
    track: str = ""
    level: float | None = None
    correct: bool | None = None


class Presentation(NamedTuple):
    """One session of a trial: the keys that it sets beyond the study's, and its seed."""

    changes: Mapping[str, Any]
    seed: int


class Trial(NamedTuple):
    """One trial. number: in the group, from 1; place: in its block, from 0; right: choice of the right answer, from 0."""

    group: int
    number: int
    block: Block
    place: int
    condition: str
    repetition: int
    presentations: tuple[Presentation, ...]
    track: str = ""
    level: float | None = None
    right: int | None = None

    def same_as(self, done: Done) -> bool:
        return (done.block, done.place) == (self.block.name, self.place)


def next_trial(study: Study, group: int, done: Sequence[Done]) -> Trial | None:
    """Return the first trial of the group that is not done, None once all are."""
    before = 0
    for block in study.blocks:
        mine = [each for each in done if each.block == block.name]
        trial = _of_staircases(study, group, block, mine) if block.staircase else _of_order(study, group, block, mine)
        if trial is not None:
            return trial._replace(number=before + len(mine) + 1)
        before += len(mine)
    return None


def planned(study: Study, group: int) -> int:
    """Return how many trials a group has; of staircases at most."""
    total = 0
    for block in study.blocks:
        count = len(study.conditions_of(block)) * block.repetitions
        own = count * (block.staircase.trials if block.staircase else 1)
        every = block.staircase.catch_every if block.staircase else 0
        total += own + ((own - 1) // (every - 1) if every > 1 else 0)
    return total


def _of_order(study: Study, group: int, block: Block, done: Sequence[Done]) -> Trial | None:
    places = {each.place for each in done}
    random = Random(f"{study.seed}/{group}/{block.name}/order")
    order = ordered(block.order, study.conditions_of(block), block.repetitions, group, random)
    for place, (condition, repetition) in enumerate(order):
        if place not in places:
            shown = Presentation(study.changes(condition), _seed(study, group, block, place, 0))
            return Trial(group, 0, block, place, condition, repetition, (shown,))
    return None


def _of_staircases(study: Study, group: int, block: Block, done: Sequence[Done]) -> Trial | None:
    """Return a trial of one of the tracks that are not over, by chance: people cannot foresee the level."""
    rule = block.staircase
    assert rule is not None
    place = len(done)
    random = Random(f"{study.seed}/{group}/{block.name}/{place}")
    open_tracks = list(_open(study, block, rule, done))
    if not open_tracks:
        return None
    condition, repetition, level = random.choice(open_tracks)
    track = _track(condition, repetition)
    if rule.catch_every and (place + 1) % rule.catch_every == 0:
        track, level = CATCH, rule.most
    larger = random.randrange(2)  # interval with the larger value
    values = [rule.reference, rule.reference]
    values[larger] += level
    shown = tuple(
        Presentation({**study.changes(condition), rule.key: value}, _seed(study, group, block, place, interval))
        for interval, value in enumerate(values)
    )
    return Trial(group, 0, block, place, condition, repetition, shown, track, level, larger)


def _open(study: Study, block: Block, rule: Staircase, done: Sequence[Done]) -> Iterator[tuple[str, int, float]]:
    answered = tracks(done)
    for condition in study.conditions_of(block):
        for repetition in range(block.repetitions):
            level = next_level(rule, answered[_track(condition, repetition)])
            if level is not None:
                yield condition, repetition, level


def _track(condition: str, repetition: int) -> str:
    return f"{condition}#{repetition + 1}"


def tracks(done: Sequence[Done]) -> defaultdict[str, list[Answered]]:
    """Return what was answered in each track, in order. A trial that was abandoned is not an answer."""
    found: defaultdict[str, list[Answered]] = defaultdict(list)
    for each in done:
        if each.level is not None and each.correct is not None:
            found[each.track].append((each.level, each.correct))
    return found


def _seed(study: Study, group: int, block: Block, place: int, interval: int) -> int:
    return Random(f"{study.seed}/{group}/{block.name}/{place}/{interval}/session").randrange(_SEEDS)
