"""A live study: a server and clients for every session, keys at a terminal, and a kill in the midst of it."""

import csv
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

from cogrip.sim.experiments.study.journal import read_answers, read_trials

from tests.free_ports import free_port
from tests.live.held_arms import Spoken

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


def test_live_trial_survives_a_kill_and_ends_by_key(start: Callable[..., Spoken], tmp_path: Path) -> None:
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

    again = start(*command, stdin=subprocess.PIPE)
    again.hear("Press against the wall")
    again.tell("")
    again.hear("P01: Enter when you are ready")
    again.tell("")
    again.hear("everybody holds on")
    again.tell("e")
    again.hear("How sure")
    again.tell("8")
    again.hear("'8' is no answer here; give 1 to 7")
    again.tell("5")
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
