"""Journal of a study: no trial is lost or run twice, wherever it is cut short."""

import csv
import shutil
from itertools import cycle
from pathlib import Path

import pytest

from cogrip.experiments.study import journal
from cogrip.experiments.study.conductor import TrialEnded
from cogrip.experiments.study.journal import (
    ANSWERS,
    RUNS,
    STUDY,
    TRIALS,
    StudyFolder,
    TrialLine,
    read_answers,
    read_trials,
)
from cogrip.experiments.study.staircase import Estimate
from cogrip.experiments.study.study_file import StudyError
from cogrip.experiments.study.table import StudyTable, thresholds, write_table
from cogrip.experiments.study.trial import TrialEvent
from cogrip.machine.platform import system
from cogrip.results.reading.columns import NUMBER, Column

from tests.experiments.studies import PLAIN, NoSessions, conducted, parsed
from tests.extent import every

STUDY_OF_TWO = parsed(PLAIN)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "study"
    outcome, _ = conducted(STUDY_OF_TWO, path)
    assert outcome == (2 * (4 + 6), 0, 20, True)
    return path


@pytest.fixture
def copy(whole: Path, tmp_path: Path) -> Path:
    """The whole study, to be cut or spoiled."""
    return Path(shutil.copytree(whole, tmp_path / "study"))


def finished(path: Path) -> list[tuple[object, ...]]:
    return [
        (line.group, line.number, line.block, line.place, line.condition, line.level, line.correct)
        for line in read_trials(path)
        if line.status == "finished"
    ]


def answered(path: Path) -> dict[tuple[object, ...], object]:
    """Return the answers that count: those of finished trials, and at the end of blocks."""
    attempts = {
        (line.group, line.block, line.place): line.attempt for line in read_trials(path) if line.status == "finished"
    }
    found = {}
    for line in read_answers(path):
        key = (line.group, line.block, line.place)
        if line.place < 0 or attempts.get(key) == line.attempt:
            full = (*key, line.participant, line.question)
            assert full not in found, "each answer counts once"
            found[full] = line.answer
    return found


@pytest.mark.parametrize("cut", every(5, range(0, 40, 2)))
def test_study_that_was_killed_goes_on_as_if_it_had_not(whole: Path, copy: Path, cut: int) -> None:
    """A kill leaves the lines so far, and a part of one: as they are written, answers come before their trial."""
    lines = (copy / TRIALS).read_bytes().splitlines(keepends=True)
    (copy / TRIALS).write_bytes(b"".join(lines[:cut]) + lines[cut][: len(lines[cut]) // 2])
    over = {(line.group, line.block, line.place) for line in read_trials(copy) if line.over}
    answers = zip((copy / ANSWERS).read_bytes().splitlines(keepends=True), read_answers(whole), strict=True)
    known = [line for line, read in answers if (read.group, read.block, read.place) in over]
    (copy / ANSWERS).write_bytes(b"".join(known) + b'{"group":0,"participant":"P')
    assert conducted(STUDY_OF_TWO, copy)[0].complete
    assert finished(copy) == finished(whole)
    assert answered(copy) == answered(whole)


def test_a_last_line_that_was_cut_anywhere_is_mended(whole: Path, tmp_path: Path) -> None:
    """With and without a line end behind it, as an editor adds one, or zeros, as a loss of power does."""
    content = (whole / TRIALS).read_bytes()
    *before, last = content.splitlines(keepends=True)
    ends = cycle((b"", b"\n", b"\r\n", bytes(20), bytes(20) + b"\n"))
    for kept, behind in zip((*range(1, len(last) - 2, 7), len(last) - 2), ends, strict=False):
        copy = Path(shutil.copytree(whole, tmp_path / "copy"))
        (copy / TRIALS).write_bytes(b"".join(before) + last[:kept] + behind)
        assert len(read_trials(copy)) == len(before)
        folder = StudyFolder(copy, STUDY_OF_TWO, {})
        assert folder.trials == read_trials(whole)[:-1]
        (note,) = folder.notes
        assert note.startswith(f"{copy / TRIALS}: its last line was cut short; it stands in trials.cut")
        assert (copy / TRIALS).read_bytes() == b"".join(before)
        assert (copy / "trials.cut").read_bytes() == last[:kept] + b"\n"
        shutil.rmtree(copy)


@pytest.mark.parametrize("behind", [b"", b"\0\0", b"\n\n", b"\r\n"])
def test_a_last_line_whose_end_alone_is_missing_counts(whole: Path, copy: Path, behind: bytes) -> None:
    content = (copy / TRIALS).read_bytes()
    (copy / TRIALS).write_bytes(content[:-1] + behind)
    assert read_trials(copy) == read_trials(whole)
    folder = StudyFolder(copy, STUDY_OF_TWO, {})
    assert (folder.notes, folder.trials) == ([], read_trials(whole))
    assert (copy / TRIALS).read_bytes() == content


def test_a_broken_line_before_the_last_is_refused_by_its_number(copy: Path) -> None:
    lines = (copy / TRIALS).read_bytes().splitlines(keepends=True)
    (copy / TRIALS).write_bytes(b"".join([lines[0][:30] + b"\n", *lines[1:]]))
    with pytest.raises(
        StudyError, match=r"trials\.jsonl:1: is no line of a study: .* remove it: what it says is then done again"
    ):
        StudyFolder(copy, STUDY_OF_TWO, {})


@pytest.mark.parametrize("left", [(), (f"{STUDY}.part",), (STUDY,)])
def test_study_that_was_killed_as_its_folder_was_made_begins(
    whole: Path, tmp_path: Path, left: tuple[str, ...]
) -> None:
    path = tmp_path / "study"
    path.mkdir()
    for name in left:
        content = (whole / STUDY).read_bytes()
        (path / name).write_bytes(content if name == STUDY else content[:40])
    assert conducted(STUDY_OF_TWO, path)[0].complete
    assert (path / RUNS).is_dir()
    assert finished(path) == finished(whole)


def test_study_makes_its_description_before_all_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with something else in it is no study's, so a kill must not leave one like that."""
    seen: list[list[Path]] = []
    monkeypatch.setattr(journal, "_write", lambda path, query: seen.append(list(path.parent.iterdir())))
    StudyFolder(tmp_path / "study", STUDY_OF_TWO, {})
    assert seen == [[]]


def test_answers_of_a_trial_that_was_killed_while_asking_do_not_count(whole: Path, copy: Path) -> None:
    for name in (TRIALS, ANSWERS):  # begun: its answer is there, and is not finished
        (copy / name).write_bytes((copy / name).read_bytes().splitlines(keepends=True)[0])
    conducted(STUDY_OF_TWO, copy)
    assert finished(copy) == finished(whole)
    assert answered(copy) == answered(whole)
    assert [line.attempt for line in read_trials(copy) if line.place == 0 and line.group == 0][:3] == [1, 2, 2]


def test_question_that_stands_twice_is_asked_once(tmp_path: Path) -> None:
    study = parsed(PLAIN.replace('ask_after = ["load"]', 'ask_after = ["load", "load"]'))
    outcome, folder = conducted(study, tmp_path / "study")
    assert outcome.complete
    asked = [line for line in folder.answers if line.place < 0]
    assert len(asked) == len({(line.participant, line.question) for line in asked}) == 2 * 6
    answered(folder.path)


def test_question_of_a_staircase_is_not_asked_at_the_end_as_well() -> None:
    with pytest.raises(StudyError, match="'wider' is in ask and in ask_after"):
        parsed(PLAIN.replace('conditions = ["a"]', 'conditions = ["a"]\nask_after = ["wider"]'))


@pytest.mark.parametrize("typed", ["=1+1", "+1", "-1", "@x", "\tx", '=HYPERLINK("http://x")\n=2'])
def test_what_people_typed_is_no_formula_in_a_spreadsheet(tmp_path: Path, typed: str) -> None:
    """A spreadsheet shows a text behind an apostrophe as it is. Other answers, and Parquet, stay as they are."""
    study = parsed(PLAIN.replace("[[blocks]]", '[questions.why]\nkind = "text"\ntext = "Why?"\n[[blocks]]', 1))
    columns = [Column("answer_why", "string"), Column("answer_wider", "string"), Column("answer_sure", NUMBER)]
    row = {"answer_why": typed, "answer_wider": "-1", "answer_sure": -1}
    table = StudyTable(study, columns, [row, {}, {"answer_why": "2 = 2"}], [], [])
    write_table(table, "csv", tmp_path / "table.csv")
    with (tmp_path / "table.csv").open(newline="") as file:
        rows = [list(each.values()) for each in csv.DictReader(file)]
    assert rows == [[f"'{typed}", "-1", "-1.0"], ["", "", ""], ["2 = 2", "", ""]]


def test_failed_sessions_are_begun_again_and_three_in_a_row_end_the_day(tmp_path: Path) -> None:
    failed = TrialEnded(TrialEvent.FAILED, "the link was cut")
    outcome, folder = conducted(STUDY_OF_TWO, tmp_path / "twice", NoSessions([failed, failed]), [0])
    assert outcome.complete
    assert [line.reason for line in folder.trials if line.status == "failed"] == ["the link was cut"] * 2
    outcome, folder = conducted(STUDY_OF_TWO, tmp_path / "thrice", NoSessions([failed] * 3), [0])
    assert not outcome.complete
    assert not any(line.over for line in folder.trials)


def test_trial_is_repeated_or_abandoned_by_order(tmp_path: Path) -> None:
    orders = [
        TrialEnded(TrialEvent.REPEAT, "operator"),
        TrialEnded(TrialEvent.ABANDON, "operator"),
        TrialEnded(TrialEvent.PAUSE, "operator"),
    ]
    sessions = NoSessions(orders[:2])
    outcome, folder = conducted(STUDY_OF_TWO, tmp_path / "study", sessions, [0])
    assert (outcome.finished, outcome.abandoned) == (9, 1)
    first = [line for line in folder.trials if line.place == 0 and line.block == "one"]
    assert [(line.status, line.attempt) for line in first] == [("begun", 1), ("begun", 2), ("abandoned", 2)]


def test_another_study_does_not_take_over_a_folder(copy: Path, tmp_path: Path) -> None:
    path = copy
    before = {each: each.read_bytes() for each in path.iterdir() if each.is_file()}
    with pytest.raises(StudyError, match=r"other study\.seed"):
        StudyFolder(path, parsed(PLAIN, seed=2), {})
    assert {each: each.read_bytes() for each in path.iterdir() if each.is_file()} == before
    more = parsed(PLAIN, participants=["P01", "P02", "P03"])
    assert conducted(more, path)[0] == (30, 0, 10, True)
    with pytest.raises(StudyError, match=r"other study\.participants"):
        StudyFolder(path, STUDY_OF_TWO, {})
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(StudyError, match="is no study's folder"):
        StudyFolder(tmp_path, STUDY_OF_TWO, {})
    (path / TRIALS).write_text("nonsense\n")
    with pytest.raises(StudyError, match=r"trials\.jsonl:1"):
        StudyFolder(path, more, {})
    assert (path / STUDY).exists()


def test_study_runs_where_no_folder_can_be_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows refuses it."""

    def refuse(path: Path, flags: int) -> int:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(journal.os, "open", refuse)
    assert conducted(STUDY_OF_TWO, tmp_path / "study", groups=[0])[0].complete


def test_two_processes_do_not_run_one_study(tmp_path: Path) -> None:
    """Each would not see what the other has finished; a descriptor of its own stands for another process."""
    path = tmp_path / "study"
    first = StudyFolder(path, STUDY_OF_TWO, {}, lock=system.lock)
    with pytest.raises(StudyError, match="is in use: another `cogrip study`"):
        StudyFolder(path, STUDY_OF_TWO, {}, lock=system.lock)
    first.close()
    StudyFolder(path, STUDY_OF_TWO, {}, lock=system.lock).close()


def test_thresholds_take_all_tracks_of_a_participant_and_condition(whole: Path) -> None:
    lines: list[TrialLine] = [line for line in read_trials(whole) if line.status == "finished"]
    found = thresholds(STUDY_OF_TWO, lines)
    assert list(found) == [("P01", "two", "a"), ("P02", "two", "a")]
    assert all(isinstance(each, Estimate) and each.trials == 6 for each in found.values())
