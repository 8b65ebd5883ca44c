"""A live study with its pages: real processes, a real browser, a button of a device, and a kill while a question is open."""

import csv
import signal
import stat
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from cogrip.experiments.study.journal import read_answers, read_trials
from cogrip.results.measures.columns import read_columns

from tests.free_ports import free_port
from tests.live.held_arms import Spoken
from tests.view.browser_page import BrowserPage

STUDY = """
name = "by page"
participants = [["P01", "P02"]]
instructions = "Bring the <b>cube</b> into the target."
end = "operator"
start = "button"
[session]
seconds = 1.0
object.kind = "cube"
coupling.impedance_nspm = 2.0
[[session.users]]
device = "web:pointer"
[[session.users]]
device = "sim:ideal"
hand = "sine&amplitude_m=0.005&frequency_hz=0.5"
[audio]
noise = "pink"
[goal]
place_m = [0.04]
within_m = 0.01
[questions.sure]
kind = "likert"
text = "How sure?"
[questions.why]
kind = "text"
text = "Why?"
[[blocks]]
name = "b"
ask = ["sure", "why"]
"""
WHY = 'because, "it" <i>moved</i>\nü'


class Study:
    """The command, and its two pages; started anew they are the same pages."""

    def __init__(self, folder: Path, started: list[Spoken]) -> None:
        (folder / "study.toml").write_text(STUDY)
        self.path = folder / "out"
        self._command = ("study", str(folder / "study.toml"), "--live", "--view", "--port", str(free_port()))
        self._started = started

    def run(self, *arguments: str) -> Spoken:
        self._started.append(Spoken(*arguments, stdin=subprocess.PIPE))
        return self._started[-1]

    def start(self) -> tuple[Spoken, str, str]:
        """Start it, and return the addresses of the pages."""
        said = self.run(*self._command, "--out", str(self.path))
        return said, said.hear(r"page of P01: (\S+)")[1], said.hear(r"page of P02: (\S+)")[1]


@pytest.fixture
def study(tmp_path: Path) -> Iterator[Study]:
    started: list[Spoken] = []
    yield Study(tmp_path, started)
    for each in started:
        each.stop()


def press(page: BrowserPage, name: str) -> None:
    page.tab.get_by_role("button", name=name, exact=True).click()


def ask(page: BrowserPage, question: str) -> None:
    page.until(f"document.querySelector('#panel legend')?.textContent === '{question}'")


def one_session(said: Spoken, first: BrowserPage, second: BrowserPage) -> None:
    """Read the instructions, say ready by a button of the device and on the page, and let the operator end it."""
    press(first, "Go on")
    second.until("document.querySelector('#panel button')?.textContent === 'Go on'")
    second.tab.keyboard.press("Enter")
    said.hear("press a button of your device")
    press(second, "I am ready")
    said.hear("P02 is ready")
    first.until("cogrip.hand.own !== null")
    first.tab.keyboard.press("7", delay=50)
    said.hear("P01 is ready")
    said.hear("everybody holds on")
    first.until("cogrip.frame?.drawn.target?.place[0] === 0.04")
    for page in (first, second):
        page.until("cogrip.sounds.noise && cogrip.sounds.most > 0.01")
    said.tell("e")
    for page in (first, second):
        page.until("!cogrip.sounds.noise && cogrip.sounds.most === 0")


@pytest.mark.long
def test_no_trial_is_lost_over_a_kill_with_a_question_open(study: Study, open_page: Callable[..., BrowserPage]) -> None:
    killed, *addresses = study.start()
    first, second = (open_page(address) for address in addresses)
    assert "<b>cube</b>" in first.text("#panel [data-part=text]")
    one_session(killed, first, second)
    ask(first, "How sure?")
    assert second.text("#panel [data-part=prompt]") == "Please wait ..."
    press(first, "2")
    ask(first, "Why?")
    first.tab.keyboard.type("half")
    killed.popen.send_signal(signal.SIGKILL)
    killed.popen.wait()
    assert [line.status for line in read_trials(study.path)] == ["begun"]

    again, *now = study.start()
    assert now == addresses, "tabs that are open find their pages again"
    assert stat.S_IMODE((study.path / "state" / "pages.json").stat().st_mode) == 0o600
    first.until("document.querySelector('#panel button')?.textContent === 'Go on'")
    one_session(again, first, second)
    ask(first, "How sure?")
    first.tab.reload()
    ask(first, "How sure?")
    press(first, "6")
    ask(first, "Why?")
    first.tab.locator("#panel textarea").fill(WHY)
    press(first, "Send")
    ask(second, "How sure?")
    again.tell("9")
    again.hear("'9' is no answer here; give 1 to 7")
    second.until("document.querySelector('#panel .problem')?.textContent.includes('give 1 to 7')")
    press(second, "7")
    ask(second, "Why?")
    assert second.text("#panel h2") == "P02 – trial 1 of 1"
    again.tell("typed at the terminal")
    for page in (first, second):
        page.until("document.querySelector('#panel [data-part=text]').textContent.startsWith('The study is over.')")
        page.until("document.getElementById('mode').textContent === 'over'")
    again.hear("1 trial finished, 1 of them now")
    assert again.end() == 0, again.said

    trials = [(line.status, line.attempt) for line in read_trials(study.path)]
    assert trials == [("begun", 1), ("begun", 2), ("finished", 2)]
    answers = [(line.participant, line.attempt, line.answer) for line in read_answers(study.path)]
    typed = ("P02", 2, "typed at the terminal")
    assert answers == [("P01", 1, 2), ("P01", 2, 6), ("P01", 2, WHY), ("P02", 2, 7), typed]
    check_table(study)


def check_table(study: Study) -> None:
    """Answers are in the table; time 0 is the marker of the beginning, and until then nobody moved the object."""
    table = study.run("table", str(study.path), "--to", "csv")
    assert table.end() == 0, table.said
    with (study.path / "table.csv").open(newline="") as lines:
        first, second = csv.DictReader(lines)
    assert (first["answer_sure"], first["answer_why"], second["answer_sure"]) == ("6.0", WHY, "7.0")
    run = study.path / "runs" / first["run"]
    whole, trial = read_columns(run), read_columns(run, marker=f"begin {first['run']}")
    waited_s = whole.time_s[-1] - trial.time_s[-1]
    assert waited_s > 0.0
    assert abs(whole.object_m[whole.time_s < waited_s]).max() == 0.0
