"""Shared fixtures: a recorded run to spoil, an empty folder, the command as its users type it."""

import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from cogrip.cli.main import main
from cogrip.experiments.experiment import Job, Measure, Result, run_cases
from cogrip.experiments.worker_pool import LocalWorkers
from cogrip.protocol.settings.room import resolve
from cogrip.results.writing.laboratory_run import run_laboratory

from tests.bench.__main__ import main as run_bench
from tests.cli.command import Cogrip
from tests.results.reported_runs import blank_pictures

TABLE: dict[str, Any] = {
    "name": "pair",
    "seconds": 0.5,
    "link": {"delay_ms": 10, "loss": 0.1},
    "playout": {"frames": 2},
    "users": [{"name": "anna"}, {"name": "ben", "device": "sim:ideal", "hand": "hold"}],
}


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded")
    run_laboratory(resolve(TABLE), folder)
    return folder


@pytest.fixture
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make an empty folder the current one, and the terminal wide."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "300")
    return tmp_path


@pytest.fixture
def run(recorded: Path, empty_folder: Path) -> Path:
    """Return a copy of the recorded run to spoil, in the current folder."""
    shutil.copytree(recorded, empty_folder / "run")
    return Path("run")


@pytest.fixture(autouse=True, scope="module")
def blank() -> Iterator[None]:
    """Make empty pictures: what they show is tested elsewhere."""
    with blank_pictures():
        yield


@pytest.fixture
def no_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the cases of sweeps and comparisons in this process: a worker takes a second to start."""

    def run(self: LocalWorkers, measure: Measure, jobs: Sequence[Job], batch: int = 1) -> Iterator[Result]:
        yield from run_cases(measure, jobs)

    monkeypatch.setattr(LocalWorkers, "run", run)


@pytest.fixture
def no_probes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compare methods without their felt stiffness, which takes longer than their sessions."""
    monkeypatch.setattr("cogrip.experiments.methods.query.FELT_SEEDS", 0)


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write no reports, which take longer than short sessions."""
    monkeypatch.setattr("cogrip.experiments.methods.report.draw_all", lambda *_: [])
    monkeypatch.setattr("cogrip.results.report.page.write_report", lambda folder: folder / "report.html")
    monkeypatch.setattr("cogrip.results.report.compared.write_comparison", lambda page, *_: (page, [], []))


@pytest.fixture
def cogrip(capsys: pytest.CaptureFixture[str]) -> Cogrip:
    """See `Cogrip`."""
    return Cogrip(main, capsys)


@pytest.fixture
def bench(capsys: pytest.CaptureFixture[str]) -> Cogrip:
    """Run a benchmark as `cogrip` runs a command."""
    return Cogrip(run_bench, capsys)
