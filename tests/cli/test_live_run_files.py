"""Files of live sessions: recordings followed as they grow, and summaries left at the end, with warnings of the rest."""

import json
import math
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from rich.console import Console

from cogrip.cli.runs import run_folder as module
from cogrip.cli.runs.run_folder import leave_files
from cogrip.cli.session.live_views import FollowedRun

from tests.cli.spoiled_runs import ANNA, damage


def left(folder: Path, summary: dict[str, Any]) -> str:
    console = Console(width=300, color_system=None)
    with console.capture() as capture:
        leave_files(folder, summary, console, shown=True, report=False)
    return capture.get()


def test_an_account_of_no_numbers_is_written(tmp_path: Path) -> None:
    anna = {"name": "anna", "peak_force_n": math.nan, "position_m": (math.inf, 0.0)}
    left(tmp_path, {"users": [anna], "passive": False})
    [user] = json.loads((tmp_path / "summary.json").read_text(), parse_constant=pytest.fail)["users"]
    assert user == {"name": "anna", "peak_force_n": None, "position_m": [None, 0.0]}


@pytest.mark.parametrize("error", [ValueError("out of range"), OSError(28, "out of range", "summary.json")])
def test_one_rooms_failure_is_said_and_goes_no_further(tmp_path: Path, error: Exception) -> None:
    with patch.object(module, "write_summary", side_effect=error):
        said = left(tmp_path, {"users": []})
    assert "warning: " in said
    assert "out of range" in said


def test_a_damaged_recording_shows_what_came_before_the_damage(run: Path) -> None:
    whole = FollowedRun(run).tick("anna")
    assert whole is not None
    damage(run / ANNA)
    followed = FollowedRun(run)
    for _ in range(2):
        tick = followed.tick("anna")
        assert tick is None or tick.tick < whole.tick
