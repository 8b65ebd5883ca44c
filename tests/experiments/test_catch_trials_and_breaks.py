"""Catch trials of staircases, and timed breaks of blocks."""

from collections.abc import Sequence
from pathlib import Path

import pytest
from msgspec.structs import replace

from cogrip.experiments.study.conductor import Conductor
from cogrip.experiments.study.journal import STUDY, StudyFolder
from cogrip.experiments.study.plan import CATCH, planned
from cogrip.experiments.study.staircase import uncaught
from cogrip.experiments.study.study_file import Study, StudyError
from cogrip.experiments.study.table import caught, thresholds

from tests.experiments.studies import PLAIN, NoSessions, Observers, conducted, parsed


class Resting(Observers):
    """rested: how long they rested, and after how many sessions."""

    def __init__(self, study: Study, sessions: NoSessions) -> None:
        super().__init__(study, sessions)
        self.rested: list[tuple[float, int]] = []

    def rest(self, seconds: float, people: Sequence[str]) -> None:
        self.rested.append((seconds, len(self._sessions.asked)))


@pytest.mark.parametrize("every", [2, 3, 5, 100])
def test_catch_trials_are_of_the_largest_level_and_of_no_track(every: int, tmp_path: Path) -> None:
    """The staircase has as many trials of its own as without them."""
    study = parsed(PLAIN.replace("catch_every = 0", f"catch_every = {every}"))
    outcome, folder = conducted(study, tmp_path / "study")
    assert outcome.complete
    for group in (0, 1):
        mine = [line for line in folder.trials if line.group == group and line.block == "two" and line.over]
        caught_here = [line for line in mine if line.track == CATCH]
        assert [line.place + 1 for line in caught_here] == list(range(every, len(mine) + 1, every))
        assert len(mine) - len(caught_here) == 6
        assert len(mine) + 4 == planned(study, group)
        for line in caught_here:
            assert line.level == 20.0
            assert max(values["coupling.damping_nspm"] for values in line.values) == 30.0
    over = [line for line in folder.trials if line.over]
    assert {each.trials for each in thresholds(study, over).values()} == {6}
    assert sum(asked for _, asked in caught(over).values()) == sum(line.track == CATCH for line in over)


def test_catch_trials_without_any_other_are_refused() -> None:
    with pytest.raises(StudyError, match="catch_every = 1 leaves no trial"):
        parsed(PLAIN.replace("catch_every = 0", "catch_every = 1"))


def test_breaks_are_due_within_a_block_and_not_for_whoever_comes_back(tmp_path: Path) -> None:
    study = parsed(PLAIN.replace("repetitions = 2", "repetitions = 2\nbreak_every = 2\nbreak_s = 30"))
    sessions, folder = NoSessions(), StudyFolder(tmp_path / "study", study, {})
    people = Resting(study, sessions)
    Conductor(study, {}, folder, sessions, people).run([0])
    assert people.rested == [(30.0, 2)]  # of four trials in the block; the next block has its own instructions
    again = StudyFolder(tmp_path / "again", study, {})
    for line in folder.trials[:4]:  # two trials
        again.add_trial(line)
    people = Resting(study, sessions)
    sessions.asked.clear()
    Conductor(study, {}, again, sessions, people).run([0])
    assert people.rested == []


def test_a_break_has_a_length_and_a_place() -> None:
    with pytest.raises(StudyError, match="break_every and break_s go together"):
        parsed(PLAIN.replace("repetitions = 2", "repetitions = 2\nbreak_s = 30"))


def test_a_staircase_has_catch_trials_unless_it_says_that_it_has_none(tmp_path: Path) -> None:
    """Without them the fit is biased; whoever leaves them out, or knows the lapse rate, says so."""
    usual = parsed(PLAIN.replace("catch_every = 0\n", ""))
    _, folder = conducted(usual, tmp_path / "study", groups=[0])
    tracks = [line.track for line in folder.trials if line.block == "two" and line.over]
    assert [place for place, track in enumerate(tracks) if track == CATCH] == [3]
    assert len(tracks) == 7

    rules = [each.staircase for each in (usual.blocks[1], parsed(PLAIN).blocks[1])]
    assert all(rules)
    with_catch, without = rules
    assert with_catch is not None
    assert without is not None
    assert uncaught(with_catch) == ""
    assert "catch_every = 4" in uncaught(without)
    assert uncaught(replace(without, lapse=0.01)) == ""


@pytest.mark.parametrize("told", [True, False])
def test_a_study_that_began_without_catch_trials_goes_on_without(told: bool, tmp_path: Path) -> None:
    """Also where its folder is of before there were any: whoever goes on says so, and is told which key it is."""
    without, usual = parsed(PLAIN), parsed(PLAIN.replace("catch_every = 0\n", ""))
    StudyFolder(tmp_path / "study", without, {}).close()
    if not told:
        file = tmp_path / "study" / STUDY
        file.write_text(file.read_text().replace('"catch_every": 0,', ""))
    with pytest.raises(StudyError, match=r"\(other study\.blocks\.1\.staircase\.catch_every\)"):
        StudyFolder(tmp_path / "study", usual, {})
    StudyFolder(tmp_path / "study", without, {}).close()
