"""A live server with a trigger line on a pseudo-terminal: each marker is a byte there, and the recording has when."""

import os
import select
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import cogrip.api
from cogrip.devices.io.platform import open_pseudo_terminal
from cogrip.protocol.recording.reader import open_recording
from cogrip.results.reading.folder import SERVER_RECORDING
from cogrip.results.reading.records import open_run
from cogrip.results.replay.verify import verify

from tests.free_ports import free_port
from tests.live.held_arms import LIMIT_S, Spoken


def test_marker_is_a_byte_on_the_line_and_its_time_is_recorded(start: Callable[..., Spoken], tmp_path: Path) -> None:
    ours, theirs, path = open_pseudo_terminal()
    state, run = tmp_path / "state", tmp_path / "run"
    run.mkdir()
    where = ("--port", free_port(), "--state", state)
    server = start("serve", "demo", *where, "--into", run, "--trigger", f"byte:{path}", stdin=subprocess.PIPE)
    server.hear("listening on")
    for text in ("lamp on", "lamp off"):
        marked = start("mark", text, *where[2:], "--port", where[1])
        assert marked.end() == 0, marked.said
    found = b""
    while len(found) < 5:
        assert select.select([ours], [], [], LIMIT_S)[0]
        found += os.read(ours, 16)
    assert list(found) == [0, 1, 0, 2, 0]
    server.hear(r"trigger 2 written \S+ ms ago, \S+ ms after demo: marker: lamp off")
    server.popen.send_signal(signal.SIGINT)
    assert server.end() == 0, server.said
    for end in (ours, theirs):
        os.close(end)
    recorded = open_run(run)
    triggers, markers = recorded.triggers(), recorded.markers()
    assert [(code, text) for _, code, text in triggers] == [(1, "demo: marker: lamp on"), (2, "demo: marker: lamp off")]
    assert [text for _, text in markers] == ["lamp on", "lamp off"]
    assert cogrip.api.open_run(run).triggers == triggers
    for (written_s, *_), (marked_s, _) in zip(triggers, markers, strict=True):
        assert written_s > marked_s
    assert verify(open_recording(run / SERVER_RECORDING)).exact
