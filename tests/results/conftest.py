"""Fixtures of a finished run."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cogrip.protocol.settings.room import resolve
from cogrip.results.writing.laboratory_run import run_laboratory

from tests.results.reported_runs import SETTINGS, blank_pictures


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
def blank() -> Iterator[None]:
    """Make empty pictures, where only their number and names are asked for."""
    with blank_pictures():
        yield
