"""The example that makes a trace of a recorded run: played, the trace does what the network did."""

import contextlib
import io
import runpy
import sys
from pathlib import Path

import pytest

from cogrip.protocol.settings import resolve
from cogrip.sim.delay_trace import read_trace
from cogrip.sim.lab_run import run_laboratory
from cogrip.sim.link import LinkEmulator

from tests.sim.test_link import MS, Profile

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "record_a_trace.py"
FRAME_NS = 7_812_500


@pytest.mark.parametrize("way", ["up", "down"])
def test_a_recorded_network_can_be_played(tmp_path, monkeypatch, way: str) -> None:
    run_laboratory(
        resolve({"seconds": 1.0, "seed": 4, "link": {"delay_ms": 31.25, "loss": 0.3, "burst_frames": 3.0}}), tmp_path
    )
    monkeypatch.setattr(sys, "argv", ["example", str(tmp_path), "anna", way])
    with contextlib.redirect_stdout(io.StringIO()) as told:
        runpy.run_path(str(EXAMPLE), run_name="__main__")
    (tmp_path / "trace.csv").write_text(told.getvalue())
    rows = told.getvalue().splitlines()[1:]
    # the last four frames were under way when the session ended; nothing tells them from lost ones
    delays = [row.partition(",")[2] for row in rows][:-4]
    assert set(delays) == {"", "31.250"}
    assert 10 < delays.count("") < 100
    link = LinkEmulator(Profile(), "", trace=read_trace(tmp_path / "trace.csv"))
    for number in range(len(delays)):
        link.send(number.to_bytes(1, "big"), 5 + number * FRAME_NS)
    came = []
    while (next_ns := link.next_ns) is not None:
        for payload in link.due(next_ns):
            came.append(payload[0])
            assert next_ns == 5 + payload[0] * FRAME_NS + 31.25 * MS
    assert came == [number for number, delay in enumerate(delays) if delay]
