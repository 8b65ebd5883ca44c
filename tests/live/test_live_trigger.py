"""A live server with a trigger line on a pseudo-terminal: each marker is a byte there, and the recording has when."""

import csv
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


STUDY = """
name = "by codes"
participants = ["P01"]
[session]
seconds = 1.0
object.kind = "wall"
[[session.users]]
device = "sim:ideal"
hand = "push"
[triggers]
begin = 10
"phase push" = 21
end = 99
[[blocks]]
name = "walls"
[[blocks.phases]]
name = "prepare"
seconds = 0.3
[[blocks.phases]]
name = "push"
"""


def test_events_of_a_study_are_the_codes_of_its_file_and_stand_in_its_bids(
    start: Callable[..., Spoken], tmp_path: Path
) -> None:
    ours, theirs, path = open_pseudo_terminal()
    file, folder = tmp_path / "study.toml", tmp_path / "study"
    file.write_text(STUDY)
    live = ("--live", "--port", free_port(), "--out", folder, "--trigger", f"byte:{path}")
    study = start("study", file, *live, stdin=subprocess.PIPE)
    study.hear("Press Enter|press Enter|Enter")
    study.tell("")
    assert study.end() == 0, study.said
    found = b""
    while select.select([ours], [], [], 0.0)[0]:
        found += os.read(ours, 64)
    assert [code for code in found if code] == [10, 21, 99]
    for end in (ours, theirs):
        os.close(end)
    exported = start("export", folder, "--to", "bids")
    assert exported.end() == 0, exported.said
    (events,) = (folder / "bids").glob("sub-01/motion/*_events.tsv")
    with events.open(newline="") as lines:
        rows = {row["trial_type"]: row for row in csv.DictReader(lines, delimiter="\t")}
    assert {name: row["value"] for name, row in rows.items()} == {
        "base": "10", "prepare": "n/a", "push": "21", "end": "99",
    }  # fmt: skip
    assert all(float(rows[name]["trigger_latency"]) > 0.0 for name in ("base", "push", "end"))
