"""Phases of a trial: their times, cues and markers, hands that begin with one, measures of each, and what is refused."""

import tomllib
from collections.abc import Sequence
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.experiments.study.phases import MOST_PHASES, Phase, PhaseWatch, Spell, spells, unfit_phases
from cogrip.experiments.study.study_file import Study, StudyError, read_study
from cogrip.experiments.study.table import read_table
from cogrip.protocol.texts import MARK_BYTES
from cogrip.results.measures.columns import read_columns
from cogrip.results.measures.motion import mean_force_n, path_m
from cogrip.results.reading.records import open_run
from cogrip.results.replay.verify import verify

from tests.experiments.studies import parsed, run_in_laboratory

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "studies" / "prepare_and_push.toml"
RUN = "01-001-pushes-1"
PREPARE, PUSH = {"name": "prepare", "seconds": 1.0}, {"name": "push", "seconds": 1.5, "cue": "Push now"}
REST = {"name": "rest"}


def example(*phases: dict[str, Any], **changes: Any) -> Study:
    """Return the example with other phases."""
    table = tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))
    if phases:
        table["blocks"][0]["phases"] = list(phases)
    table["session"] |= changes
    return parsed("", **table)


@given(
    st.lists(st.floats(0.1, 5.0), min_size=1, max_size=6),
    st.lists(st.floats(0.0, 30.0), max_size=20).map(sorted),
)
def test_each_phase_begins_once_when_those_before_it_are_over(seconds: list[float], looks: list[float]) -> None:
    phases = [Phase(f"p{number}", each) for number, each in enumerate(seconds)]
    begins = [sum(seconds[:number]) for number in range(len(seconds))]
    watch, begun = PhaseWatch(phases), list[Phase]()
    for look_s in looks:
        begun += watch.look(look_s)
        assert all(begin_s <= look_s + 1e-5 for begin_s, _ in zip(begins, begun, strict=False))
        assert watch.next_s > look_s
        assert watch.next_s == pytest.approx(begins[len(begun)] if len(begun) < len(phases) else inf)
    assert begun == phases[: len(begun)]


def test_spells_are_from_one_marker_to_the_next_and_to_the_end_of_the_trial() -> None:
    markers = [
        (-1.0, "phase 01-001-other-1 a"),
        (0.0, f"begin {RUN}"),
        (0.0, f"phase {RUN} a b"),
        (0.5, "anna m"),
        (1.0, f"phase {RUN} c"),
    ]
    assert spells(RUN, markers, 2.5) == [Spell("a b", 0.0, 1.0), Spell("c", 1.0, 2.5)]
    assert spells(RUN, [], 2.5) == []


def test_a_rehearsal_marks_each_phase_and_lets_hands_begin_with_theirs(tmp_path: Path) -> None:
    """The example of the page, whole: markers on their step, a hand that holds still before, and measures of each phase."""
    study = example()
    run_in_laboratory(study, tmp_path / "study")
    folder = tmp_path / "study" / "runs" / RUN
    run = open_run(folder)
    wanted = [
        (0.0, f"begin {RUN}"), (0.0, f"phase {RUN} prepare"), (1.0, f"phase {RUN} push"), (2.5, f"phase {RUN} rest"),
        (3.0, f"end {RUN} time"),
    ]  # fmt: skip
    assert run.markers() == [(pytest.approx(time_s, abs=1e-9), text) for time_s, text in wanted]
    told = [each.record.text for each in run.clients["P01"].records("event")]
    assert [text for text in told if "phase" in text] == [f"marker: {text}" for _, text in wanted if "phase" in text]
    assert all(verify(end.recording).exact for end in (run.server, *run.clients.values()) if end)

    whole = read_columns(folder)
    before, during = whole.part(0.0, 1.0), whole.part(1.0, 2.5)
    assert np.abs(before.people[0].position_m).max() < 1e-9
    assert np.abs(during.people[0].position_m).max() > 0.002

    table = read_table(tmp_path / "study")
    mine = [row for row in table.phases if row["run"] == RUN]
    assert [(row["phase"], row["phase_begin_s"], row["phase_end_s"]) for row in mine] == [
        ("prepare", 0.0, 1.0), ("push", 1.0, 2.5), ("rest", 2.5, pytest.approx(3.0)),
    ]  # fmt: skip
    assert mine[0]["path_m"] == pytest.approx(0.0, abs=1e-9)
    assert mine[1]["mean_force_n"] > mine[2]["mean_force_n"] > 0.01
    (row,) = [row for row in table.rows if row["run"] == RUN]
    lasts = [each["phase_end_s"] - each["phase_begin_s"] for each in mine]
    mean = sum(last * each["mean_force_n"] for last, each in zip(lasts, mine, strict=True)) / sum(lasts)
    assert row["mean_force_n"] == pytest.approx(mean, rel=1e-3), "phases are the whole trial"


def test_hands_begin_with_the_trial_where_no_phase_is_theirs(tmp_path: Path) -> None:
    study = parsed("", **tomllib.loads(EXAMPLE.read_text(encoding="utf-8").replace('begins = "push"', "")))
    run_in_laboratory(study, tmp_path / "study")
    assert path_m(read_columns(tmp_path / "study" / "runs" / RUN).part(0.0, 1.0), 0) > 0.002


def test_a_part_of_a_run_is_on_the_clock_of_the_whole(tmp_path: Path) -> None:
    run_in_laboratory(example(), tmp_path / "study")
    whole = read_columns(tmp_path / "study" / "runs" / RUN)
    halves = [whole.part(0.0, 1.6), whole.part(1.6, 99.0)]
    for name in ("time_s", "object_m"):
        assert np.array_equal(np.concatenate([getattr(each, name) for each in halves]), getattr(whole, name))
    for name in ("time_s", "position_m", "force_n", "pull_n"):
        parts = [getattr(each.people[0], name) for each in halves]
        assert np.array_equal(np.concatenate(parts), getattr(whole.people[0], name))
    assert mean_force_n(whole.part(0.0, 99.0), 0) == mean_force_n(whole, 0)
    assert halves[1].people[0].start_m == pytest.approx(whole.people[0].position_m[0])


@pytest.mark.parametrize(
    ("phases", "words"),
    [
        ([PREPARE, {**PREPARE, "seconds": 2.0}], "blocks.pushes: phases: prepare is named twice; give each one name"),
        ([{"seconds": 3.0}], "blocks.0.phases.0: "),
        ([{"name": "", "seconds": 3.0}], "blocks.0.phases.0.name"),
        ([{**PREPARE, "seconds": 0.09}, REST], "blocks.0.phases.0.seconds"),
        ([{**PREPARE, "cue": "x" * 201}, REST], "blocks.0.phases.0.cue"),
        ([{**PREPARE, "text": "now"}, REST], "blocks.0.phases.0.text: there is no such setting"),
        ([PREPARE, PUSH], "they last 2.5 s, and a trial session.seconds = 3; make them alike, or leave out the"),
        ([PREPARE, PUSH, {**REST, "seconds": 0.6}], "they last 3.1 s, and a trial session.seconds = 3"),
        ([{**PREPARE, "seconds": 3.0}, REST], "3 s are over before rest begins"),
        ([REST, PUSH], "rest: seconds is missing; only the last phase goes without"),
        ([PREPARE, REST], "simulated.begins: no block has a phase 'push'; there is: prepare, rest"),
    ],
)  # fmt: skip
def test_phases_that_do_not_fit_are_refused_in_a_line(phases: Sequence[dict[str, Any]], words: str) -> None:
    with pytest.raises(StudyError) as refused:
        example(*phases)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_phases_fit_the_trial_of_each_condition() -> None:
    table = tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))
    assert parsed("", **table, conditions={"short": {"seconds": 3.0}, "same": {"coupling.stiffness_npm": 500.0}})
    with pytest.raises(StudyError, match=r"blocks.pushes: phases with condition long: they last 3 s"):
        parsed("", **table, conditions={"same": {}, "long": {"seconds": 4.0}})


def test_a_marker_has_room_for_names_up_to_its_bound() -> None:
    longest_run = "r" * (MARK_BYTES - len("phase  ") - 3)
    assert unfit_phases([Phase("abc")], 1.0, longest_run) == ""
    assert "abcd: its marker is 1 bytes too long" in unfit_phases([Phase("abcd")], 1.0, longest_run)
    many = [Phase(f"p{number}", 0.1) for number in range(MOST_PHASES + 1)]
    assert unfit_phases(many[:-1], 10.0, "r") == ""
    assert "101 are too many" in unfit_phases(many, 10.1, "r")


def test_a_study_without_phases_has_none(tmp_path: Path) -> None:
    study = read_study({"name": "n", "participants": ["P01"], "blocks": [{"name": "one"}], "session": {"seconds": 0.2}})
    run_in_laboratory(study, tmp_path / "study")
    assert read_table(tmp_path / "study").phases == []
    texts = [text for _, text in open_run(tmp_path / "study" / "runs" / "01-001-one-1").markers()]
    assert texts == ["begin 01-001-one-1", "end 01-001-one-1 time"]
