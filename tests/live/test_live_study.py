"""A live study: a server and clients for every session, keys at a terminal, and a kill in the midst of it."""

import csv
import json
import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path

import pytest
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from cogrip.experiments.study.journal import read_answers, read_trials
from cogrip.results.reading.records import End, RunRecords, open_run

from tests.free_ports import free_port
from tests.live.held_arms import LIMIT_S, Spoken
from tests.stalls import MACHINE_STALLED

MOST_GAP_S = 0.05  # between two turns of a loop, where the watchdog lets go after 100 ms

STUDY = """
name = "by hand"
participants = ["P01"]
instructions = "Press against the wall."
end = "operator"
[session]
seconds = 1.0
object.kind = "wall"
[[session.users]]
device = "sim:ideal"
hand = "push"
[questions.sure]
kind = "likert"
text = "How sure?"
[[blocks]]
name = "walls"
ask = ["sure"]
"""


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def ends_of(run: RunRecords) -> list[tuple[End, str]]:
    """Return the recordings of P01 and of the server, each with the kind of its loop's records."""
    assert run.server is not None
    return [(run.clients["P01"], "tick"), (run.server, "step")]


def longest_gap_s(end: End, kind: str) -> float:
    """Return the longest time between two turns of a loop: a turn tells its own lateness after those that it skipped."""
    times_s = [each.time_s for each in end.records(kind)]
    return max(after - before for before, after in pairwise(times_s))


def page_of(address: str, stack: ExitStack) -> ClientConnection:
    """Open the socket of a participant's page, until `stack` is closed."""
    place, token = address.removeprefix("http://").split("/#")
    page = stack.enter_context(connect(f"ws://{place}/socket", subprotocols=[Subprotocol("cogrip.view.v1")]))
    page.send(json.dumps({"type": "hello", "token": token}))
    return page


def prompt(page: ClientConnection, text: str, problem: str = "") -> int:
    """Wait for a prompt, and return its number."""
    while True:
        said = page.recv(timeout=LIMIT_S)
        message = json.loads(said) if isinstance(said, str) else {}
        found = message.get("prompt") if message.get("type") == "panel" else None
        if found and found["text"] == text and problem in found["problem"]:
            return int(found["number"])


BUTTONS = STUDY.replace('end = "operator"', 'end = "time"\nstart = "button"').replace(
    'hand = "push"', 'hand = "reach&amplitude_m=0.01&press=2@1.0+0.2"'
)


def test_trial_begins_with_a_button_of_the_device(start: Callable[..., Spoken], tmp_path: Path) -> None:
    file, folder = tmp_path / "study.toml", tmp_path / "study"
    file.write_text(BUTTONS)
    study = start("study", file, "--live", "--port", free_port(), "--out", folder, stdin=subprocess.PIPE)
    study.tell("")  # the instructions
    study.hear("press a button of your device")
    study.hear("P01 is ready")
    study.hear("How sure")
    study.tell("4")
    assert study.end() == 0, study.said
    (line,) = [line for line in read_trials(folder) if line.status == "finished"]
    run = open_run(folder / "runs" / line.runs[0])
    assert [text for _, text in run.markers()] == [f"begin {line.runs[0]}", f"end {line.runs[0]} time"]
    if max(longest_gap_s(*each) for each in ends_of(run)) > MOST_GAP_S:  # then the watchdog is right to let go
        pytest.skip(f"{MACHINE_STALLED} from a loop")
    states = [each.record.state for each in run.clients["P01"].records("tick")]
    began = states.index("live", states.index("clutched"))
    assert set(states[:began]) <= {"idle", "calibrating", "armed", "live", "clutched"}
    assert "clutched" not in states[began:]


@pytest.mark.long
def test_live_trial_survives_a_kill_and_ends_by_key(
    start: Callable[..., Spoken], stack: ExitStack, tmp_path: Path
) -> None:
    file, folder, port = tmp_path / "study.toml", tmp_path / "study", free_port()
    file.write_text(STUDY)
    command = ("study", file, "--live", "--port", port, "--out", folder)
    killed = start(*command, stdin=subprocess.PIPE)
    killed.hear("Press against the wall")
    killed.tell("")
    killed.hear("P01: Enter when you are ready")
    killed.tell("")
    killed.hear("everybody holds on")
    killed.popen.send_signal(signal.SIGKILL)
    killed.popen.wait()
    assert [(line.status, line.attempt) for line in read_trials(folder)] == [("begun", 1)]

    again = start(*command, "--view", stdin=subprocess.PIPE)
    page = page_of(again.hear(r"page of P01: (\S+)")[1], stack)
    again.hear("Press against the wall")
    page.send(json.dumps({"type": "reply", "number": prompt(page, "Go on"), "text": ""}))
    again.hear("P01: Enter when you are ready")
    again.tell("")
    again.hear("everybody holds on")
    again.tell("e")
    again.hear("How sure")
    again.tell("8")
    again.hear("'8' is no answer here; give 1 to 7")
    page.send(json.dumps({"type": "reply", "number": prompt(page, "How sure?", "give 1 to 7"), "text": "5"}))
    again.hear("1 trial finished, 1 of them now")
    assert again.end() == 0, again.said
    last = read_trials(folder)[-1]
    assert (last.status, last.attempt, last.ended) == ("finished", 2, ("operator",))
    assert [(line.participant, line.attempt, line.answer) for line in read_answers(folder)] == [("P01", 2, 5)]
    assert not (folder / "children.json").exists()

    table = start("table", folder, "--to", "csv", stdin=subprocess.DEVNULL)
    assert table.end() == 0, table.said
    with (folder / "table.csv").open(newline="") as lines:
        (row,) = csv.DictReader(lines)
    assert row["run"] == "01-001-walls-2"
    assert float(row["mean_force_n"]) >= 0.0
    assert (row["ended"], row["mode"]) == ("operator", "live")


PHASES = STUDY.replace('end = "operator"', "").replace(
    'name = "walls"\nask',
    """name = "walls"
phases = [{name = "prepare", seconds = 0.4, cue = "Get ready"}, {name = "push", cue = "Push now"}]
ask""",
)


def test_phases_are_cued_at_terminal_and_page_and_marked(
    start: Callable[..., Spoken], stack: ExitStack, tmp_path: Path
) -> None:
    file, folder = tmp_path / "study.toml", tmp_path / "study"
    file.write_text(PHASES)
    study = start("study", file, "--live", "--view", "--port", free_port(), "--out", folder, stdin=subprocess.PIPE)
    page = page_of(study.hear(r"page of P01: (\S+)")[1], stack)
    study.tell("")  # the instructions
    study.hear("P01: Enter when you are ready")
    study.tell("")
    study.hear("everybody holds on")
    study.hear("prepare: Get ready")
    study.hear("push: Push now")
    study.hear("How sure")
    study.tell("4")
    assert study.end() == 0, study.said
    shown = [json.loads(said) for said in iter(page) if isinstance(said, str)]
    cues = [message["cue"] for message in shown if message["type"] == "panel"]
    assert [cue for cue, before in zip(cues, ["", *cues], strict=False) if cue != before] == [
        "Get ready",
        "Push now",
        "",
    ]
    (line,) = [line for line in read_trials(folder) if line.status == "finished"]
    (run,) = line.runs
    wanted = [f"begin {run}", f"phase {run} prepare", f"phase {run} push", f"end {run} time"]
    assert [text for _, text in open_run(folder / "runs" / run).markers()] == wanted

    table = start("table", folder, "--to", "csv", stdin=subprocess.DEVNULL)
    assert table.end() == 0, table.said
    with (folder / "table-phases.csv").open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert [row["phase"] for row in rows] == ["prepare", "push"]
    assert rows[0]["phase_end_s"] == rows[1]["phase_begin_s"]
