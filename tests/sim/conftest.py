"""Fixtures of a finished run, and of comparisons."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cogrip.protocol.settings import resolve
from cogrip.sim.experiments.methods import query
from cogrip.sim.runs.laboratory_run import run_laboratory

from tests.sim.reported_runs import SETTINGS, blank_pictures


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two people, a bad link, two seconds."""
    folder = tmp_path_factory.mktemp("run")
    run_laboratory(resolve(SETTINGS), folder)
    return folder


@pytest.fixture
def folder(finished: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(finished, tmp_path / "run"))


@pytest.fixture
def summary(finished: Path) -> dict[str, Any]:
    """The summary of the finished run, to be changed."""
    return dict(json.loads((finished / "summary.json").read_text()))


@pytest.fixture(scope="module")
def felt_once() -> Iterator[None]:
    """Probe the felt stiffness with one seed: it takes longer than a session."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(query, "FELT_SEEDS", 1)
        yield


@pytest.fixture(scope="module")
def blank() -> Iterator[None]:
    """Make empty pictures, where only their number and names are asked for."""
    with blank_pictures():
        yield
