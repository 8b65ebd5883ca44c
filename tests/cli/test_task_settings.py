"""Tasks in settings files: what is refused, and what a session leaves of one."""

import json
from pathlib import Path

import pytest

from cogrip.cli.settings.settings_file import load
from cogrip.cli.terminal.problem import BadInput

from tests.cli.command import Cogrip

pytestmark = pytest.mark.usefixtures("empty_folder")


@pytest.mark.parametrize(
    ("name", "override", "words"),
    [
        ("lift", "task.body=lid", r"object\.file: task\.body = 'lid' is no body .*; its bodies are box, tool of"),
        ("wall", 'task.body=""', r"object\.file: task\.body = '' is no body .*; its bodies are tool of seat 0$"),
        ("demo", "task.lifted_m=0.1", r'\[task\] is for object\.kind = "scene"; set task\.lifted_m'),
        ("lift", "task.lifted_m=-1", r"task\.lifted_m"),
        ("lift", "task.lifts_m=1", r"task\.lifts_m: there is no such setting; did you mean task\.lifted_m\?"),
        ("lift", "task.place_m=[1.0, 2.0]", r"task\.place_m"),
    ],
)
def test_a_task_that_does_not_fit_is_refused(name: str, override: str, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        load(Path(name), [override])


def test_a_task_without_a_goal_is_refused() -> None:
    Path("mine.toml").write_text('[object]\nkind = "scene"\nfile = "lift.xml"\naxes = 3\n[task]\nbody = "box"\n')
    with pytest.raises(BadInput, match=r"\[task\] has no goal; set task\.lifted_m"):
        load(Path("mine.toml"))


@pytest.mark.sample(1)
@pytest.mark.parametrize(("within_m", "result"), [(0.001, "reached after 1."), (1e-9, "not reached")])
def test_a_session_tells_whether_its_task_was_reached(within_m: float, result: str, cogrip: Cogrip) -> None:
    """A task that is not reached is no failure of the session."""
    shorter = ("--set", "seconds=2.2", "--set", f"task.within_m={within_m}")
    out = cogrip.out("lab", "wall", *shorter)
    assert f"Task {result}" in out
    (summary,) = Path("runs").glob("*/summary.json")
    task = json.loads(summary.read_text())["task"]
    assert task["reached"] == (result != "not reached")
    assert task["goals"]["within_m"]["asked"] == within_m
    report = summary.with_name("report.html").read_text()
    assert "task with the tool of seat 0" in report
    assert f"Task {result}" in report
