"""The example for Rerun, run on a recording, and its file read by Rerun's own program."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.view.recorded_runs import recorded_run

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "rerun_a_run.py"
LIMIT_S = 120.0


@pytest.mark.long
def test_rerun_reads_what_the_example_writes(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    run, file = recorded_run(tmp_path / "run", 0.5), tmp_path / "run.rrd"

    def python(*arguments: object) -> str:
        command = [sys.executable, *map(str, arguments)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False, cwd=tmp_path)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    python(EXAMPLE, run, file)
    python("-m", "rerun", "rrd", "verify", file)
    said = python("-m", "rerun", "rrd", "print", file)
    paths = {*re.findall(r"/[\w/]+", said)}
    for name in ("anna", "ben"):
        assert {f"/{kind}/{name}" for kind in ("hands", "forces", "force_n", "rtt_ms")} <= paths
    assert "/object" in paths
