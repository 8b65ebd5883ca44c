"""The studies that come with cogrip: each runs unattended with simulated participants, and gives the answer that is known."""

from collections.abc import Callable, Sequence
from math import log, log2, pi
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from msgspec.structs import replace

from cogrip.analysis.feel.feel import held, impedance
from cogrip.analysis.linear.linear_session import linear_session
from cogrip.experiments.study.figures import axis_of, by_condition, by_seat, draw, interval
from cogrip.experiments.study.journal import TrialLine
from cogrip.experiments.study.plan import CATCH
from cogrip.experiments.study.spread import varied
from cogrip.experiments.study.staircase import estimate
from cogrip.experiments.study.table import Row, StudyTable, read_table, thresholds
from cogrip.results.measures.registry import BY_NAME
from cogrip.results.reading.records import open_run

from tests.experiments.studies import run_in_laboratory, shipped
from tests.extent import long

LAG_S, DISTANCE_M = 0.2, 0.04  # of fitts.toml
HAND_NSPM, COURSE_HZ = 20.0, 1.0  # of delay.toml


@pytest.mark.long
def test_threshold_of_simulated_observers_is_estimated_within_a_fifth_by_what_they_feel(tmp_path: Path) -> None:
    """The whole study, four observers of 60 N/m, 400 trials with their sessions in virtual time."""
    study = shipped("stiffness")
    folder = run_in_laboratory(study, tmp_path / "study", range(4))
    rule = study.blocks[0].staircase
    assert rule is not None
    lines: list[TrialLine] = [line for line in folder.trials if line.status == "finished"]
    answers, easy = (
        [
            (line.level, line.correct)
            for line in lines
            if line.level is not None and line.correct is not None and (line.track == CATCH) is catch
        ]
        for catch in (False, True)
    )
    found = estimate(rule, [answers], easy)
    assert found.trials == 400
    assert len(easy) == 4 * 33
    assert found.threshold == pytest.approx(study.simulated.threshold, rel=0.2)  # 12 % are the spread of 400 answers
    each = thresholds(study, lines)
    assert len(each) == 4
    assert all(0.6 < one.correct < 0.85 for one in each.values()), "two right answers in a row half of the time"
    for row in read_table(tmp_path / "study").rows:
        assert row["felt_stiffness_npm"] == pytest.approx(row["coupling.stiffness_npm"], rel=0.03)


@pytest.mark.long
def test_two_people_follow_fitts_law_with_the_slope_of_their_hands(tmp_path: Path) -> None:
    """Visual guidance of first order with a lag of LAG_S takes LAG_S ln 2 more for each bit."""
    study = shipped("fitts")
    study = replace(study, blocks=(study.blocks[0], replace(study.blocks[1], repetitions=1)))
    run_in_laboratory(study, tmp_path / "study", range(2))
    table = read_table(tmp_path / "study")
    assert not table.notes
    assert {row["ended"] for row in table.rows} == {"goal"}
    everybodys = by_condition(table.rows, BY_NAME["completion_s"])
    times = {name: interval(list(each.values()))[0] for name, each in everybodys.items()}
    bits = [log2(DISTANCE_M / study.goal_of(study.changes(name)).within_m) for name in times]  # type: ignore[operator]
    assert sorted(f"{round(each)} bits" for each in bits) == sorted(times), "names say how difficult each is"
    slope, _ = np.polyfit(bits, list(times.values()), 1)
    assert slope == pytest.approx(LAG_S * log(2.0), rel=0.1)
    assert all(len(set(each.values())) > 1 for each in everybodys.values())
    leads = {row["participant"]: row["lead_s"] for row in table.rows}
    assert leads["P01"] > 0.01 > -0.01 > leads["P02"], "P02 begins later"
    assert all(1 <= row["answer_together"] <= 7 for row in table.rows if not row["practice"])
    assert all("answer_load" not in row for row in table.rows if row["practice"])
    assert {row["practice"] for row in table.rows} == {0, 1}


@pytest.mark.parametrize("delays", [("0 ms", "80 ms"), long(("0 ms", "20 ms", "40 ms", "80 ms"))])
def test_delay_changes_what_a_hand_feels_as_the_linear_model_says(delays: tuple[str, ...], tmp_path: Path) -> None:
    """Mean force over mean speed of a sine is |Z| at its frequency, of the model that knows nothing of sessions."""
    study = shipped("delay")
    study = replace(study, blocks=(replace(study.blocks[0], conditions=delays),))
    run_in_laboratory(study, tmp_path / "study")
    table = read_table(tmp_path / "study")
    mine = {row["condition"]: row for row in table.rows if row["participant"] == "P01"}
    errors = [mine[name]["tracking_rms_m"] for name in delays]
    assert errors == sorted(errors), "the longer the delay, the worse they follow"
    assert errors[-1] > 1.5 * errors[0]
    for name, row in mine.items():
        settings = open_run(tmp_path / "study" / "runs" / str(row["run"])).settings()
        assert settings is not None
        words = dict(word.split("=") for word in settings.users[1].hand.split("&")[1:])
        stiffness_npm = float(words["hand_stiffness_npm"])
        assert stiffness_npm != 20.0, "each simulated hand is drawn"
        session = held(linear_session(settings), 0, stiffness_npm, HAND_NSPM)
        said = abs(impedance(session, 0, np.array([2.0 * pi * COURSE_HZ]))[0])
        assert row["mean_force_n"] / (row["path_m"] / settings.seconds) == pytest.approx(said, rel=0.03), name


def test_simulated_people_differ_by_seed_and_by_what_the_study_says(tmp_path: Path) -> None:
    study = shipped("fitts")
    settings = [study.settings_of({}, people, {}, 7) for people in study.groups()]
    spread = study.simulated.spread
    hands = [user.hand for each in settings for user in varied(each, spread, study.seed).users]
    assert len(set(hands)) == 8, "each has a hand of their own"
    assert hands == [user.hand for each in settings for user in varied(each, spread, study.seed).users], "and keeps it"
    assert hands[0] != varied(settings[0], spread, study.seed + 1).users[0].hand
    assert hands[0] != varied(replace(settings[0], seed=8), spread, study.seed).users[0].hand, "trials differ a little"
    assert all(hand.startswith("approach&amplitude_m=0.04&lag_s=0.2&delay_s=") for hand in hands)
    assert varied(settings[0], {}, study.seed) == settings[0]


def figure_of(
    name: str, value: Callable[[int, int], float], study_name: str = "delay", groups: Sequence[int] = (1, 2, 3, 4)
) -> Figure:
    """Draw a measure of groups of two, each row's value by group and seat."""
    study = shipped(study_name)
    rows: list[Row] = [
        {"group": group, "seat": seat, "condition": condition, "practice": 0, name: value(group, seat)}
        for group in groups
        for seat in (0, 1)
        for condition in study.conditions
    ]
    return draw(study, BY_NAME[name], by_seat(StudyTable(study, [], rows, [], []), BY_NAME[name]))


def test_figures_name_groups_and_what_is_below_the_axis_and_do_not_pool_seats() -> None:
    figure = figure_of("mean_force_n", lambda group, seat: group + 100.0 * seat)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "group 1: P01, P02", "group 2: P03, P04", "group 3: P05, P06", "group 4: P07, P08", "mean, 95 % confidence",
    ]  # fmt: skip
    assert [panel.get_title(loc="left") for panel in figure.axes] == ["seat 0", "seat 1"]
    assert [panel.get_xlabel() for panel in figure.axes] == ["delay each way"] * 2
    assert [panel.containers[0].lines[0].get_ydata()[0] for panel in figure.axes] == [2.5, 102.5]
    (panel,) = figure_of("lead_s", lambda group, seat: 0.1 * group * (1 - 2 * seat)).axes
    assert panel.containers[0].lines[0].get_ydata()[0] == pytest.approx(0.25), "of both seats it would be 0"
    (panel,) = figure_of("completion_s", lambda group, seat: 1.0, "fitts").axes
    assert panel.get_title(loc="left") == ""


def test_axis_without_words_says_what_conditions_set() -> None:
    assert axis_of(shipped("fitts", axis="")) == "condition: goal.within_m"
    assert axis_of(shipped("stiffness")) == "condition"


def test_intervals_are_those_of_student() -> None:
    mean, half = interval([1.0, 2.0, 3.0])
    assert (mean, half) == (2.0, pytest.approx(4.30265 / 3**0.5, rel=1e-5))
    assert interval([4.0]) == (4.0, None), "of a single value nothing is known"


def test_one_group_has_no_interval() -> None:
    figure = figure_of("mean_force_n", lambda group, seat: 2.0, groups=(2,))
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "group 2: P03, P04",
        "one value, no interval",
    ]
    for panel in figure.axes:
        assert all(len(bar.lines[2]) == 0 for bar in panel.containers), "no error bar of no width"
        assert [bar.lines[0].get_ydata()[0] for bar in panel.containers] == [2.0] * len(panel.containers)


def test_conditions_take_each_participant_once_and_no_practice() -> None:
    def row(participant: str, seat: int, value: float | None, practice: int = 0) -> dict[str, object]:
        return {
            "group": 1, "participant": participant, "seat": seat, "condition": "a", "practice": practice,
            "path_m": value, "completion_s": value,
        }  # fmt: skip

    rows = [row("P01", 0, 1.0), row("P01", 0, 3.0), row("P02", 1, 5.0), row("P02", 1, None), row("P01", 0, 99.0, 1)]
    assert by_condition(rows, BY_NAME["path_m"]) == {"a": {1: 2.0}}
    assert by_condition(rows, BY_NAME["path_m"], seat=1) == {"a": {1: 5.0}}, "seats are not pooled"
