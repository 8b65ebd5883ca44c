"""The example that makes a trace of a recorded run: played, the trace does what the network did."""

import runpy
from pathlib import Path

import pytest

from cogrip.protocol.settings import resolve
from cogrip.sim.runs.laboratory_run import run_laboratory
from cogrip.sim.session.delay_trace import read_trace
from cogrip.sim.session.link import LinkEmulator

from tests.sim.test_link import MS, Profile

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "record_a_trace.py"
FRAME_NS = 7_812_500


LINK = {"delay_ms": 31.25, "loss": 0.3, "burst_frames": 3.0}
EXAMPLE_MAIN = runpy.run_path(str(EXAMPLE))["main"]


@pytest.mark.parametrize(("kind", "direction"), [("wave", "up"), ("wave", "down"), ("tdpa", "up"), ("tdpa", "down")])
def test_a_recorded_network_can_be_played(tmp_path, capsys, kind: str, direction: str) -> None:
    run_laboratory(resolve({"seconds": 1.0, "seed": 4, "link": LINK, "coupling": {"kind": kind}}), tmp_path)
    assert EXAMPLE_MAIN([str(tmp_path), "anna", direction]) == 0
    told = capsys.readouterr().out
    (tmp_path / "trace.csv").write_text(told)
    delays = [row.partition(",")[2] for row in told.splitlines()[1:]]
    assert set(delays) == {"", "31.250"}
    assert 10 < delays.count("") < 100
    assert 100 < len(delays) <= 124, "of 128 frames the last four were under way when the session ended"
    assert delays[-1], "nothing follows the newest that came"
    link = LinkEmulator(Profile(), "", trace=read_trace(tmp_path / "trace.csv"))
    for number in range(len(delays)):
        link.send(number.to_bytes(1, "big"), 5 + number * FRAME_NS)
    came = []
    while (next_ns := link.next_ns) is not None:
        for payload in link.due(next_ns):
            came.append(payload[0])
            assert next_ns == 5 + payload[0] * FRAME_NS + 31.25 * MS
    assert came == [number for number, delay in enumerate(delays) if delay]


def test_what_it_cannot_make_a_trace_of(tmp_path, capsys) -> None:
    run = tmp_path / "run"
    run.mkdir()
    run_laboratory(resolve({"seconds": 0.1, "link": {"delay_ms": 500.0}}), run)
    for arguments, words in (
        ([], "usage: record_a_trace.py RUN PERSON up|down"),
        ([str(run), "anna"], "usage"),
        ([str(run), "anna", "left"], "'left' is no way: up is from the client to the server"),
        ([str(run), "zoe", "up"], "no recording of 'zoe'; there is: anna\n"),
        ([str(run), "anna", "up"], "nothing of anna up arrived"),
        ([str(tmp_path / "none"), "anna", "up"], "none"),
    ):
        assert EXAMPLE_MAIN(arguments) == 2
        told = capsys.readouterr()
        assert words in told.err
        assert not told.out
    (run / "server.mcap").unlink()
    assert EXAMPLE_MAIN([str(run), "anna", "up"]) == 2
    assert "no recording of the server; bring both together by `cogrip merge`" in capsys.readouterr().err
