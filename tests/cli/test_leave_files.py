"""What a session leaves: all that can be written, and words about the rest."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from cogrip.cli.runs import run_files as module
from cogrip.cli.runs.run_files import leave_files


def left(folder: Path, summary: dict[str, Any]) -> str:
    console = Console(width=300, color_system=None)
    with console.capture() as capture:
        leave_files(folder, summary, console, shown=True, report=False)
    return capture.get()


def test_an_account_of_no_numbers_is_written(tmp_path: Path) -> None:
    left(
        tmp_path,
        {"users": [{"name": "anna", "peak_force_n": math.nan, "position_m": (math.inf, 0.0)}], "passive": False},
    )
    [user] = json.loads((tmp_path / "summary.json").read_text(), parse_constant=pytest.fail)["users"]
    assert user == {"name": "anna", "peak_force_n": None, "position_m": [None, 0.0]}


@pytest.mark.parametrize("error", [ValueError("out of range"), OSError(28, "No space left on device", "summary.json")])
def test_one_rooms_failure_is_said_and_goes_no_further(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def write(folder: Path, summary: dict[str, Any]) -> None:
        raise error

    monkeypatch.setattr(module, "write_summary", write)
    said = left(tmp_path, {"users": []})
    assert "warning: " in said
    assert ("out of range" in said) or ("No space left" in said)
