"""What is replayed, made once: read it, do not spoil it."""

from math import sin
from pathlib import Path
from typing import Any

import pytest

from cogrip.protocol.settings import resolve
from cogrip.sim.lab_run import run_laboratory

from tests.devices.replayed_hands import SECONDS


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two people on two axes, one with encoders, one whose device gives velocities."""
    folder = tmp_path_factory.mktemp("run")
    table: dict[str, Any] = {
        "seconds": SECONDS,
        "object": {"axes": 2},
        "link": {"delay_ms": 10},
        "users": [
            {"name": "anna", "hand": "reach&direction=1,0.5"},
            {"name": "ben", "device": "sim:ideal", "hand": "tremor&amplitude_m=0.02&direction=1,-1&seed=4"},
        ],
    }
    run_laboratory(resolve(table), folder)
    return folder


@pytest.fixture(scope="session")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hand every 1/256 s, in millimetres."""
    path = tmp_path_factory.mktemp("table") / "hand.csv"
    rows = [f"{k / 256},{10 * sin(k / 20) + 3},{k % 7}" for k in range(300)]
    path.write_text("\n".join(["t_s,x_mm,y_mm", *rows]) + "\n")
    return path
