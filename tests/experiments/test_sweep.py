"""Tests of sweeps: grids, measures, folders, and what a kill, an interrupt or a dead worker costs."""

import json
import multiprocessing
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.cli.main import main
from cogrip.experiments.experiment import Measure, Result, run_case
from cogrip.experiments.folder import CELLS, TABLE, ExperimentFolder, FolderError
from cogrip.experiments.runner import run_experiment
from cogrip.experiments.sweep.grid import Axis, Grid, GridError, parse_axis
from cogrip.experiments.sweep.measures import LIFTED, MeasureError, expanded, read
from cogrip.experiments.sweep.picture import draw_measure
from cogrip.experiments.sweep.query import MANIFEST, SweepJob, measure_case, prepare
from cogrip.experiments.worker_pool import LocalWorkers
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.results.plots.style import NotDrawnError
from cogrip.results.writing.laboratory_run import run_laboratory

from tests.experiments.compared_methods import InProcess, rows_of

TWO: dict[str, Any] = {"name": "two", "seconds": 0.2, "users": [{"name": "a"}, {"name": "b"}]}
RADIUS = "lifted.spectral_radius"


@given(st.floats(1e-3, 1e6), st.floats(1e-3, 1e6), st.integers(2, 60), st.booleans())
def test_a_span_has_its_ends_its_count_and_even_steps(first: float, last: float, count: int, log: bool) -> None:
    if abs(first - last) < 1e-3 * first:
        return
    axis = parse_axis(f"key={first!r}:{last!r}:{count}{'log' if log else ''}")
    assert axis.values[0] == first
    assert axis.values[-1] == last
    assert len(axis.values) == count
    assert axis.log == log
    pairs = list(zip(axis.values, axis.values[1:], strict=False))
    steps = [b / a for a, b in pairs] if log else [b - a for a, b in pairs]
    assert max(steps) - min(steps) <= 1e-6 * max(abs(step) for step in steps)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("seed=1:4:4", (1, 2, 3, 4)),
        ("k=1:2:3", (1.0, 1.5, 2.0)),
        ("k=5:5:1", (5,)),
        ("link.loss=0,0.05,0.2", (0, 0.05, 0.2)),
        ("coupling.kind=wave,coupling", ("wave", "coupling")),
        ("coupling.compensate=true,false", (True, False)),
        ("users.0.device=sim:ideal?mass_kg=0.1,sim:phantom", ("sim:ideal?mass_kg=0.1", "sim:phantom")),
        ("users.0.hand = reach&amplitude_m=0.02", ("reach&amplitude_m=0.02",)),
    ],
)
def test_values_as_they_are_written(text: str, values: tuple[Any, ...]) -> None:
    axis = parse_axis(text)
    assert axis.values == values
    assert [type(value) for value in axis.values] == [type(value) for value in values]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("stiffness", "write it as key="),
        ("k=", "write it as key="),
        ("k=1:2", "three parts"),
        ("k=1:2:0", "at least 2"),
        ("k=1:2:1", "at least 2"),
        ("k=3:3:2", "no 2 different"),
        ("k=0:2:3log", "above 0"),
        ("k=-1:2:3log", "above 0"),
        ("k=1:inf:3", "finite"),
        ("k=a:b:3", "is no span"),
        ("k=1,,2", "missing"),
        ("k=1,2,1", "stands twice"),
    ],
)
def test_axes_that_cannot_be_varied(text: str, words: str) -> None:
    with pytest.raises(GridError, match=words):
        parse_axis(text)


@given(st.lists(st.integers(1, 5), min_size=1, max_size=4))
def test_every_combination_is_one_case(sizes: list[int]) -> None:
    grid = Grid({}, [Axis(f"k{number}", tuple(range(size))) for number, size in enumerate(sizes)])
    seen = {tuple(grid.values(case).values()) for case in grid}
    assert len(seen) == grid.cases
    assert all(list(grid.values(case)) == [axis.key for axis in grid.axes] for case in grid)


@pytest.mark.parametrize(
    ("axes", "words"),
    [
        ([], "nothing to vary"),
        ([Axis("seed", (1,)), Axis("seed", (2,))], "stands twice"),
        ([Axis("seed", tuple(range(1000))), Axis("seconds", tuple(range(1, 102)))], "more than 100000"),
    ],
)
def test_impossible_grids(axes: list[Axis], words: str) -> None:
    with pytest.raises(GridError, match=words):
        Grid(TWO, axes)


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        ("coupling.stifness_npm=1,2", "case 0 .* did you mean coupling.stiffness_npm"),
        ("coupling.stiffness_npm=10,-1", "case 1 .*expects a number of at least 0, in N/m"),
        ("users.2.stiffness_npm=10", "no user number 2"),
        ("coupling.kind=wave,waves", "case 1 .*coupling.kind"),
    ],
)
def test_every_case_is_checked_before_any_is_run(vary: str, words: str) -> None:
    with pytest.raises(GridError, match=words):
        prepare(resolve(TWO), [parse_axis(vary)], [RADIUS])


def test_measures_by_path_by_star_and_by_name(summary: dict[str, Any]) -> None:
    columns = expanded(["passive", "users.*.peak_force_n", "users.0.position_m.0", RADIUS], summary)
    assert columns == ("passive", "users.0.peak_force_n", "users.1.peak_force_n", "users.0.position_m.0", RADIUS)
    assert read(summary, "passive") is True
    assert read(summary, "users.1.nothing") is None
    assert read({"a": [float("nan")]}, "a.0") is None


@pytest.mark.parametrize(
    ("measure", "words"),
    [
        ("pasive", "did you mean passive"),
        ("users.0.energy", "did you mean users.0.energy.up_margin_j"),
        ("users.7.peak_force_n", "did you mean users"),
        ("lifted.spectral", "did you mean lifted.spectral_radius"),
    ],
)
def test_unknown_measures(summary: dict[str, Any], measure: str, words: str) -> None:
    with pytest.raises(MeasureError, match=words):
        expanded([measure], summary)


def sweep_of(
    settings: Settings, folder: Path, *vary: str, measures: Sequence[str] = ("passive", "users.0.peak_force_n")
) -> Any:
    sweep = prepare(settings, [parse_axis(text) for text in vary], measures)
    return sweep, ExperimentFolder(folder, sweep)


def test_a_case_is_its_session(tmp_path: Path) -> None:
    vary = "coupling.stiffness_npm=100:1000:2log", "link.loss=0,0.2"
    report = run_experiment(*sweep_of(resolve(TWO), tmp_path, *vary), InProcess())
    assert (report.cases, report.computed, report.kept, report.failed) == (4, 4, 0, {})
    rows = rows_of(tmp_path / TABLE)
    assert [row["cell"] for row in rows] == ["0", "1", "2", "3"]
    assert [(row["coupling.stiffness_npm"], row["link.loss"]) for row in rows][:2] == [("100", "0"), ("100", "0.2")]
    alone = run_laboratory(resolve(TWO, {"coupling.stiffness_npm": 1000.0, "link.loss": 0.2})).summary
    assert float(rows[3]["users.0.peak_force_n"]) == pytest.approx(alone["users"][0]["peak_force_n"], rel=1e-9)
    asked = json.loads((tmp_path / MANIFEST).read_text())
    assert asked["vary"][1] == {"key": "link.loss", "values": [0, 0.2], "log": False}
    assert asked["settings"]["name"] == "two"


def test_lifted_measures_need_no_session(tmp_path: Path) -> None:
    settings = resolve({**TWO, "seconds": 1e5})  # a session of this would never end
    run_experiment(
        *sweep_of(settings, tmp_path, "coupling.stiffness_npm=100,2000", measures=tuple(LIFTED)), InProcess()
    )
    rows = rows_of(tmp_path / TABLE)
    assert rows[0]["lifted.stable"] == "true"
    assert float(rows[1]["lifted.felt_stiffness_npm"]) == pytest.approx(1.0 / (1.0 / 2000.0 + 7.8125e-3 / 40.0))


def test_a_case_that_fails_is_kept_as_failed_and_run_again(tmp_path: Path) -> None:
    class Failing(InProcess):
        def run(self, measure: Measure, jobs: Sequence[SweepJob], batch: int = 1) -> Iterator[Result]:
            for job in jobs:
                yield Result(job.case, {}, "broken") if job.case == 1 else run_case(measure, job)

    report = run_experiment(*sweep_of(resolve(TWO), tmp_path, "seed=1:3:3", measures=[RADIUS]), Failing())
    assert report.failed == {"broken": 1}
    assert rows_of(tmp_path / TABLE)[1]["error"] == "broken"
    report = run_experiment(*sweep_of(resolve(TWO), tmp_path, "seed=1:3:3", measures=[RADIUS]), InProcess())
    assert (report.kept, report.computed, report.failed) == (2, 1, {})


def test_an_error_inside_a_case_is_its_result() -> None:
    result = run_case(measure_case, SweepJob(0, {"users": [{"name": "a", "device": "sim:nothing"}]}, {}, ("passive",)))
    assert result.error.startswith("DeviceError")


def test_a_torn_last_line_is_no_case(tmp_path: Path) -> None:
    run_experiment(*sweep_of(resolve(TWO), tmp_path, "seed=1:4:4", measures=[RADIUS]), InProcess())
    path = tmp_path / CELLS
    whole = path.read_text()
    path.write_text(whole[:-20])
    report = run_experiment(*sweep_of(resolve(TWO), tmp_path, "seed=1:4:4", measures=[RADIUS]), InProcess())
    assert (report.kept, report.computed) == (3, 1)
    assert path.read_text() == whole


@pytest.mark.parametrize("what", ["other", "foreign", "file"])
def test_a_foreign_folder_is_not_touched(tmp_path: Path, what: str) -> None:
    path = tmp_path / "folder"
    if what == "other":
        run_experiment(*sweep_of(resolve(TWO), path, "seed=1:2:2", measures=[RADIUS]), InProcess())
    elif what == "foreign":
        path.mkdir()
        (path / "thesis.txt").write_text("years of work")
    else:
        path.write_text("years of work")
    before = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    words = "another sweep .other vary." if what == "other" else "no sweep's folder"
    with pytest.raises(FolderError, match=words):
        sweep_of(resolve(TWO), path, "seed=1:3:3", measures=[RADIUS])
    assert {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()} == before


@pytest.mark.long
def test_dead_workers_cost_their_cases_a_second_run(tmp_path: Path) -> None:
    """Kill both workers at once, while cases are left that no worker has: their death is noticed however slow this is."""
    sweep, folder = sweep_of(resolve(TWO), tmp_path, "seed=1:8:8")
    with LocalWorkers(2) as workers:

        def kill_both_at_first(finished: int) -> None:
            if finished == 1 and not workers.deaths:
                for worker in multiprocessing.active_children():
                    os.kill(worker.pid or 0, signal.SIGKILL)

        report = run_experiment(sweep, folder, workers, kill_both_at_first)
    assert workers.deaths == 1
    assert (report.computed, report.failed) == (8, {})
    cases = [json.loads(line)["cell"] for line in (tmp_path / CELLS).read_text().splitlines()]
    assert sorted(cases) == list(range(8))


KILLED_AT_THREE = """
import os, signal, sys
from cogrip.cli.main import main
from cogrip.experiments.folder import ExperimentFolder
whole = ExperimentFolder.add
def add(self, *told):
    whole(self, *told)
    if len(self.finished) == 3:
        os.kill(os.getpid(), signal.SIGKILL)
ExperimentFolder.add = add
main(sys.argv[1:])
"""


def test_a_sweep_that_was_killed_goes_on_where_it_was(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The whole parent process by SIGKILL at its third cell; then the same command: no finished cell is run again."""
    config = tmp_path / "two.toml"
    config.write_text('name = "two"\nseconds = 0.1\n[[users]]\nname = "a"\n[[users]]\nname = "b"\n')
    arguments = [
        "sweep", str(config), "--vary", "seed=1:6:6", "--measure", "passive", "--out", str(tmp_path / "out"), "--jobs", "1",
        "--json", "-",
    ]  # fmt: skip
    killed = subprocess.run([sys.executable, "-c", KILLED_AT_THREE, *arguments], capture_output=True)
    assert killed.returncode == -signal.SIGKILL
    cases = tmp_path / "out" / CELLS
    kept = cases.read_text().splitlines(keepends=True)
    assert len(kept) == 3
    assert main(arguments) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["kept"] == 3
    assert answer["computed"] == 6 - 3
    assert cases.read_text().splitlines(keepends=True)[:3] == kept
    assert [row["cell"] for row in rows_of(tmp_path / "out" / TABLE)] == [str(case) for case in range(6)]


@pytest.mark.parametrize(
    ("vary", "panels"),
    [
        (["coupling.stiffness_npm=100:1000:4log"], 1),
        (["coupling.stiffness_npm=100:1000:4log", "coupling.kind=wave,coupling"], 1),
        (["coupling.stiffness_npm=100:1000:4log", "coupling.damping_nspm=5,10", "coupling.kind=wave,coupling"], 2),
    ],
)
def test_a_picture_of_one_two_or_three_settings(tmp_path: Path, vary: list[str], panels: int) -> None:
    sweep, folder = sweep_of(resolve(TWO), tmp_path, *vary, measures=[RADIUS])
    run_experiment(sweep, folder, InProcess())
    figure = draw_measure(sweep.grid, folder.finished, RADIUS)
    shown = [axes for axes in figure.axes if axes.get_visible() and axes.get_xlabel()]
    assert len(shown) == panels


def test_a_measure_without_numbers_is_not_drawn(tmp_path: Path) -> None:
    sweep, folder = sweep_of(resolve(TWO), tmp_path, "seed=1:2:2", measures=["users.0.state"])
    run_experiment(sweep, folder, InProcess())
    with pytest.raises(NotDrawnError, match="no number"):
        draw_measure(sweep.grid, folder.finished, "users.0.state")


def test_the_content_of_files_is_part_of_the_query(tmp_path: Path) -> None:
    first, second = (tmp_path / f"{name}.csv" for name in ("first", "second"))
    for path in (first, second):
        path.write_text("t_s,delay_ms\n0,5\n1,7\n")
    vary = f"link.trace={first},{second}"
    sweep, folder = sweep_of(resolve(TWO), tmp_path / "out", vary, "seed=1:2:2")
    assert run_experiment(sweep, folder, InProcess()).computed == 4
    again, folder = sweep_of(resolve(TWO), tmp_path / "out", vary, "seed=1:2:2")
    folder.close()
    assert len(folder.finished) == 4
    assert again.digest == sweep.digest
    second.write_text("t_s,delay_ms\n0,5\n1,70\n")
    with pytest.raises(FolderError, match=rf"another sweep .other files: {second}."):
        sweep_of(resolve(TWO), tmp_path / "out", vary, "seed=1:2:2")
    assert prepare(resolve(TWO), [parse_axis(vary)], [RADIUS]).files == {}  # no session, no file
