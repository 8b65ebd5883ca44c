"""Tests of a whole comparison: equal numbers from any executor, its files, its table."""

import json
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from cogrip.experiments.experiment import Measure, Result
from cogrip.experiments.folder import CELLS, TABLE, ExperimentFolder, FolderError
from cogrip.experiments.methods.measures import COLUMNS
from cogrip.experiments.methods.method import METHODS, methods_of
from cogrip.experiments.methods.query import prepare
from cogrip.experiments.methods.report import LATEX, MARKDOWN, PEOPLE, PLOTS, REPORT, render, write_outcome
from cogrip.experiments.methods.table import TABLE as COLUMNS_SHOWN
from cogrip.experiments.methods.table import gather, markdown, notes, of_probes, shown, spread, tone, unstable, verdict
from cogrip.experiments.runner import run_experiment
from cogrip.experiments.worker_pool import LocalWorkers
from cogrip.machine.stop import Stop
from cogrip.protocol.settings.room import resolve
from cogrip.results.reading.folder import SUMMARY
from cogrip.results.verdict.compared_methods import failed_methods, failed_of_ours, failure_sentence

from tests.experiments.compared_methods import TWO, InProcess, row_of, rows_of, small
from tests.sim.session_measures import allowed

pytestmark = pytest.mark.usefixtures("felt_once", "blank")


# A whole comparison


class Known(InProcess):
    """Workers that tell again what was found in another folder: a session has one result."""

    def __init__(self, path: Path) -> None:
        folder = ExperimentFolder(path, small())
        folder.close()
        self._found = folder.finished

    def run(self, measure: Measure, jobs: Sequence[Any], batch: int = 1) -> Iterator[Result]:
        return (self._found[job.case] for job in jobs)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Compare two methods on a clean link and another, with two seeds, in this process."""
    path = tmp_path_factory.mktemp("whole") / "out"
    asked = small()
    folder = ExperimentFolder(path, asked)
    assert run_experiment(asked, folder, InProcess()).computed == asked.cases
    write_outcome(path, asked, folder.finished)
    return path


def test_ours_creates_no_more_than_its_devices_leak_and_a_seed_changes_the_numbers(whole: Path) -> None:
    rows = rows_of(whole / TABLE)
    assert [row["error"] for row in rows] == [""] * 8
    waves = [row for row in rows if row["method"] == "wave"]
    assert len({row["error_clean_n"] for row in waves if row["network"] == "wifi"}) == 2
    for row in waves:
        assert row["passive"] == "true"
        assert float(row["margin_mj"]) >= -1e3 * allowed("line_margin_j") - 1e-9
        assert float(row["created_mj"]) <= float(row["leak_mj"]) + 1e-9


def test_the_files_of_a_comparison(whole: Path) -> None:
    assert {path.name for path in whole.iterdir()} == {
        "comparison.json", CELLS, TABLE, SUMMARY, MARKDOWN, LATEX, REPORT, PLOTS, PEOPLE,
    }  # fmt: skip
    drawn = {path.name for path in (whole / PLOTS).iterdir()}
    names = {"stability", "traces", "forces", "coherence", "errors", "felt"}
    assert drawn == {f"{name}.{suffix}" for name in names for suffix in ("png", "svg")}
    page = (whole / REPORT).read_text()
    assert page.count("data:image/png;base64,") == len(names)
    assert "http" not in page.replace("http-equiv", "")
    summary = json.loads((whole / SUMMARY).read_text())
    assert [(row["network"], row["method"], row["runs"]) for row in summary["rows"]] == [
        ("clean", "wave", 2), ("clean", "coupling", 2), ("wifi", "wave", 2), ("wifi", "coupling", 2),
    ]  # fmt: skip
    assert summary["asked"]["networks"]["wifi"]["up"]["jitter_ms"] > 0.0
    assert summary["asked"]["networks"]["clean"]["up"]["jitter_ms"] == 0.0


def test_everybodys_felt_stiffness_is_a_line(whole: Path) -> None:
    """The first seed is the only one here with a felt stiffness."""
    rows = rows_of(whole / PEOPLE)
    keys = [(row["seed"], row["method"], row["network"], row["person"]) for row in rows]
    assert keys == list(product("1", ("wave", "coupling"), ("clean", "wifi"), "ab"))
    summary = json.loads((whole / SUMMARY).read_text())
    wave = next(row for row in summary["rows"] if (row["network"], row["method"]) == ("wifi", "wave"))
    assert [person["person"] for person in wave["felt"]] == ["a", "b"]
    for person, line in zip(wave["felt"], rows[2:4], strict=True):
        assert person["felt_npm"]["median"] == pytest.approx(float(line["felt_npm"]), rel=1e-9)
        compliance = 1.0 / float(line["felt_npm"]) - 1.0 / float(line["asked_npm"])
        assert float(line["added_mm_per_n"]) == pytest.approx(1e3 * compliance, rel=1e-6)


def test_a_recorded_hand_that_has_changed_makes_another_comparison(tmp_path: Path) -> None:
    hand, trace = tmp_path / "hand.csv", tmp_path / "trace.csv"
    hand.write_text("t_s,x_m\n0,0\n1,0.01\n")
    trace.write_text("t_s,delay_ms\n0,5\n1,7\n")
    table = {
        "seconds": 2.0, "link": {"trace": str(trace)},
        "users": [{"name": "a", "hand": f"csv:{hand}&time=t_s&x=x_m"}, {"name": "b"}],
    }  # fmt: skip

    def folder(networks: list[str], seeds: int = 1) -> ExperimentFolder:
        asked = prepare(resolve(table), ["wave"], networks, seeds)
        return ExperimentFolder(tmp_path / "-".join(["out", *networks]), asked)

    for networks in (["own"], ["lan"]):
        folder(networks).close()
        folder(networks).close()
    with pytest.raises(FolderError, match=r"holds another comparison .other seeds"):
        folder(["own"], seeds=3)
    trace.write_text("t_s,delay_ms\n0,5\n1,8\n")
    folder(["lan"]).close()  # nobody asked for the settings' own link
    with pytest.raises(FolderError, match=rf"other files: {trace}\); name another"):
        folder(["own"])
    hand.write_text("t_s,x_m\n0,0\n1,0.02\n")
    with pytest.raises(FolderError, match=rf"other files: {hand}\)"):
        folder(["lan"])
    with pytest.raises(FolderError, match=rf"other files: {hand}, {trace}\)"):
        folder(["own"])


@pytest.mark.long
def test_a_stop_keeps_what_is_finished_and_other_workers_go_on_to_the_same_numbers(whole: Path, tmp_path: Path) -> None:
    stop = Stop()
    folder = ExperimentFolder(tmp_path, asked := small())

    def stop_early(finished: int) -> None:
        if finished:
            stop.reason = "interrupted"

    with LocalWorkers(1, stop) as workers:
        run = run_experiment(asked, folder, workers, stop_early).computed
    assert 0 < run < asked.cases
    summary = gather(asked, folder.finished)
    assert (summary["run"], summary["sessions"]) == (run, asked.cases)
    assert "were not run: it was interrupted" in render(summary, [])
    folder = ExperimentFolder(tmp_path, asked)
    assert len(folder.finished) == run
    assert run_experiment(asked, folder, Known(whole)).computed == asked.cases - run
    assert (tmp_path / TABLE).read_bytes() == (whole / TABLE).read_bytes()


# The table


@pytest.mark.parametrize(
    ("changes", "words", "bad", "marked"),
    [
        ({}, "stable", False, "good"),
        ({"diverged": 20, "diverged_s": {"median": 1.3, "first": 1.1}}, "diverged 20/20 (median 1.3 s)", True, "bad"),
        ({"oscillates": 9}, "oscillates 9/20", False, "bad"),
        ({"oscillates": 10}, "oscillates 10/20", True, "bad"),
        ({"not_passive": 1}, "stable, not passive 1/20", False, "bad"),
        ({"diverged": 2, "diverged_s": {"median": 0.35, "first": 0.35}, "oscillates": 3, "not_passive": 5},
         "diverged 2/20 (median 0.35 s), oscillates 3/20, not passive 5/20", False, "bad"),
        ({"diverged": 1, "diverged_s": {"median": 0.35, "first": 0.35}, "oscillates": 10, "failed": 2},
         "diverged 1/20 at 0.35 s, oscillates 10/20, not run 2", True, "bad"),
        ({"runs": 0}, "–", False, "good"),
        ({"not_passive": 4, "not_felt": 5}, "stable, not passive 4/20, not felt as intended 5/20", False, "bad"),
        ({"not_felt": 5, "failed": 1}, "stable, not felt as intended 5/20, not run 1", False, "warn"),
    ],
)  # fmt: skip
def test_verdicts_in_words(changes: dict[str, Any], words: str, bad: bool, marked: str) -> None:
    """A row is `unstable` where half of the sessions are; one is enough for it to be marked, and for ours to fail."""
    row = row_of(**changes)
    assert verdict(row) == words
    assert unstable(row) == bad
    assert tone(row) == marked
    assert failed_of_ours({"rows": [row_of(), row]}) == [row] * (marked == "bad")


def test_whose_failure_fails_a_comparison() -> None:
    """By what they are: cogrip's own are those that are documented to stay stable and passive on any network."""
    assert {name for name, method in METHODS.items() if method.ours} == {"wave", "tuned", "local", "partner"}
    for name, method in METHODS.items():
        assert method.ours == method.title.startswith("cogrip's ")
        for key in ("diverged", "oscillates", "not_passive"):
            rows = [row_of(), row_of(method=name, **{key: 1}), row_of(method=name, not_felt=1, failed=1)]
            assert failed_of_ours({"rows": rows}) == [rows[1]] * method.ours


def test_the_sentence_names_what_failed() -> None:
    partner, lte = row_of(method="partner", diverged=2), row_of("lte", "partner", not_passive=1)
    assert failure_sentence([partner]) == "partner on wan diverged"
    assert failure_sentence([partner, lte]) == "partner on wan, partner on lte diverged or was not passive"
    assert failed_methods([partner, lte]) == "partner"
    assert failed_methods([row_of(oscillates=1), partner]) == "wave, partner"


def test_gathered_rows_say_whose_method_they_are_of() -> None:
    said = {}
    for kind in ("cube", "wall"):
        settings = resolve({**TWO, "object": {"kind": kind}})
        asked = prepare(settings, methods_of(settings), ("wifi",), 1)
        said |= {row["method"]: row["ours"] for row in gather(asked, {})["rows"]}
    assert said == {name: method.ours for name, method in METHODS.items()}


@pytest.mark.parametrize(
    ("method", "changes", "marked"),
    [
        ("coupling", {"not_passive": 1}, "bad"), ("tdpa", {"oscillates": 1}, "bad"), ("wave", {"not_felt": 1}, "warn"),
        ("tuned", {}, "good"),
    ],
)  # fmt: skip
def test_a_page_marks_the_table_and_the_list_alike(
    whole: Path, method: str, changes: dict[str, Any], marked: str
) -> None:
    summary = json.loads((whole / SUMMARY).read_text())
    summary["asked"]["methods"] = {method: {}}
    page = render({**summary, "rows": [row_of(method=method, **changes)]}, [])
    assert f'<td class="text {marked}">' in page
    assert f"<li class={marked}>" in page


def test_what_each_method_may_lend_and_is_called_stands_below_the_table() -> None:
    asked = small(("wave", "paper", "coupling", "tdpa"))
    summary = gather(asked, {})
    assert [row["credit_mj"] for row in summary["rows"][:4]] == [80.0, 80.0, 1.0, 1.0]
    said = " ".join(notes(summary))
    assert "wave 80 mJ, paper 80 mJ, coupling 1 mJ, tdpa 1 mJ." in said
    assert "tdpa (time-domain passivity)" in said
    assert "Not felt as intended" in said
    asked = prepare(resolve({**TWO, "playout": {"tank_mj": 2.5}}), ("wave", "tdpa"), ("wifi",), 1)
    assert [row["credit_mj"] for row in gather(asked, {})["rows"][:2]] == [2.5, 1.0]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ({"median": 1.234, "worst": 1.234}, "1.23"),
        ({"median": 0.0123, "worst": 123.4}, "0.012 (123)"),
        ({"median": 9.996, "worst": 10.0}, "10.0"),
        ({"median": 1e-5, "worst": 94349706.0}, "0 (9.4e7)"),
        (None, "–"),
    ],
)
def test_numbers_as_they_are_shown(value: Any, text: str) -> None:
    assert shown(row_of(created_mj=value), COLUMNS_SHOWN[0]) == text


def test_nobody_feels_what_is_unstable() -> None:
    felt = next(column for column in COLUMNS_SHOWN if column.measure == "felt_error_percent")
    value = {"median": -16.25, "worst": -20.0, "n": 3, "of": 5}
    assert shown(row_of(felt_error_percent=value), felt) == "−16.2 (−20.0)"
    assert shown(row_of(felt_error_percent=value, oscillates=20), felt) == "–"
    assert shown(row_of(felt_error_percent={**value, "n": 2}), felt) == "–"
    assert shown(row_of(felt_error_percent={**value, "n": 2, "of": 4}), felt) == "–"


def test_a_felt_stiffness_says_of_how_many_probes_it_is() -> None:
    """It has no worst: the value furthest from 0 would be the best."""
    asked = small(seeds=3)
    people = [
        [{"person": "a", "asked_npm": 1e3, "felt_npm": felt, "error_percent": error, "added_mm_per_n": 1.0}]
        for felt, error in ((500.0, -50.0), (None, None), (900.0, -10.0))
    ]
    columns = {
        **dict.fromkeys(COLUMNS, 1.0), "diverged": False, "oscillates": False, "passive": True, "not_felt": "",
        "reason": "",
    }  # fmt: skip
    results = {
        case: Result(case, {**columns, "felt": felt, "felt_error_percent": felt[0]["error_percent"]})
        for case in range(asked.cases)
        for felt in [people[asked.values(case)["seed"] - asked.seeds[0]]]
    }
    row = gather(asked, results)["rows"][0]
    assert row["felt"][0]["felt_npm"] == {"median": 700.0, "q1": 600.0, "q3": 800.0, "n": 2, "of": 3}
    assert row["felt"][0]["error_percent"]["worst"] == -50.0
    assert (row["felt_error_percent"]["n"], row["felt_error_percent"]["of"]) == (2, 3)
    assert of_probes([None, None]) is None


def test_an_error_inside_a_session_is_counted_as_not_run() -> None:
    asked = small(seeds=1)
    row = gather(asked, {case: Result(case, {}, "ArithmeticError: broken") for case in range(asked.cases)})["rows"][0]
    assert (row["runs"], row["failed"], row["errors"]) == (0, 1, {"ArithmeticError: broken": 1})
    assert verdict(row) == "not run 1"


def test_spread_is_the_median_and_the_furthest_from_nothing() -> None:
    assert spread([1.0, None, -5.0, 3.0]) == {"median": 1.0, "q1": -2.0, "q3": 2.0, "worst": -5.0}
    assert spread([None, 4.0]) == {"median": 4.0, "q1": 4.0, "q3": 4.0, "worst": 4.0}
    assert spread([None, float("nan")]) is None


def test_the_table_in_markdown(whole: Path) -> None:
    summary = json.loads((whole / SUMMARY).read_text())
    rows = [line for line in markdown(summary).splitlines() if line.startswith("|")]
    assert len(rows) == 2 + 4
    assert len({row.count("|") for row in rows}) == 1
