"""Participants at a terminal: what they type, and what comes of it."""

import os
from collections.abc import Iterator
from io import StringIO
from pathlib import Path

import pytest

from cogrip.cli.study.pages import Pages
from cogrip.cli.study.study import trials_in_words
from cogrip.cli.study.study_source import load_study
from cogrip.cli.study.terminal_people import Keys, TerminalPeople
from cogrip.cli.terminal.output import make_console
from cogrip.experiments.study.conductor import Quit
from cogrip.experiments.study.plan import Trial, next_trial, planned
from cogrip.experiments.study.questions import AnswerError, Question, items_of, raw_tlx, unfit_question
from cogrip.experiments.study.trial import TrialEvent, TrialState
from cogrip.machine.stop import Stop
from cogrip.view.io.study_page import StudyPage

from tests.experiments.studies import PLAIN, parsed


class Terminal:
    """A terminal at which lines are typed beforehand."""

    def __init__(self) -> None:
        self._read, self._write = os.pipe()
        self.stop = Stop()
        self.shown = StringIO()
        self.people = TerminalPeople(Keys(self.stop, self._read), make_console(file=self.shown))
        found = next_trial(parsed(PLAIN), 0, [])
        assert found is not None
        self.trial: Trial = found

    def type(self, text: str) -> None:
        os.write(self._write, text.encode())

    def hang_up(self) -> None:
        os.close(self._write)

    def wait(self, state: TrialState) -> TrialEvent:
        return self.people.wait(self.trial, state, ["P01", "P02"])


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    yield (made := Terminal())
    os.close(made._read)


@pytest.mark.parametrize(
    ("pause", "typed", "event"),
    [
        (False, "\n\n", TrialEvent.READY), (False, "r\n\n", TrialEvent.READY), (False, "p\n", TrialEvent.PAUSE),
        (False, "\na\n", TrialEvent.ABANDON), (True, "\n", TrialEvent.RESUME), (True, "a\n", TrialEvent.ABANDON),
    ],
)  # fmt: skip
def test_orders_between_trials_where_everybody_presses_enter_and_in_a_pause(
    terminal: Terminal, pause: bool, typed: str, event: TrialEvent
) -> None:
    state = TrialState(1, ["P01", "P02"])
    if pause:
        state.handle(TrialEvent.PAUSE)
    terminal.type(typed)
    assert terminal.wait(state) is event
    shown = terminal.shown.getvalue()
    assert event is not TrialEvent.READY or ("P01: Enter" in shown and "P02: Enter" in shown)


@pytest.mark.parametrize(("typed", "looks"), [("", 4), ("\n", 2)])
def test_a_break_lasts_as_long_as_it_is_to_or_until_enter(typed: str, looks: int) -> None:
    read, write = os.pipe()
    seen: list[float] = []

    def clock() -> float:
        seen.append(10.0 * len(seen))
        return seen[-1]

    shown = StringIO()
    people = TerminalPeople(Keys(Stop(), read), make_console(file=shown), clock=clock)
    os.write(write, typed.encode())
    people.rest(30.0, ["P01"])
    assert len(seen) == looks
    assert "break of 30 s (Enter ends it, q quits)" in shown.getvalue()
    os.write(write, b"q\n")
    with pytest.raises(Quit):
        people.rest(30.0, ["P01"])
    os.close(read)
    os.close(write)


def test_quit_by_key_by_signal_and_by_the_end_of_the_input(terminal: Terminal) -> None:
    terminal.type("q\n")
    with pytest.raises(Quit):
        terminal.wait(TrialState(1, ["P01"]))
    terminal.type("half a li")
    terminal.hang_up()
    with pytest.raises(Quit):
        terminal.people.tell("Instructions", ["P01"])
    terminal.stop.reason = "interrupted"
    with pytest.raises(Quit):
        terminal.people.tell("Instructions", ["P01"])


QUESTIONS = {
    "choice": Question("choice", "Which?", choices=("left", "right")),
    "likert": Question("likert", "How?", points=5, low="bad"),
    "tlx": Question("tlx"),
    "text": Question("text", "Why?"),
}


@pytest.mark.parametrize(
    ("kind", "right", "wrong"),
    [
        ("choice", {"1": "left", "2": "right", " right ": "right"}, ("0", "3", "", "lef")),
        ("likert", {"1": 1, "5": 5}, ("0", "6", "2.5", "")),
        ("tlx", {"0": 0, "100": 100, "35": 35}, ("-5", "105", "7")),
        ("text", {"": "", " because\n\tü ": "because\n\tü"}, ("x" * 10_001, "x\0y", "\x1b[2Jx", "x\x9by")),
    ],
)
def test_answers_within_their_bounds_are_taken(kind: str, right: dict[str, object], wrong: tuple[str, ...]) -> None:
    item = items_of("q", QUESTIONS[kind])[0]
    for text, answer in right.items():
        assert item.read(text) == answer
    for text in wrong:
        with pytest.raises(AnswerError):
            item.read(text)


def test_question_is_asked_until_it_is_answered(terminal: Terminal) -> None:
    terminal.type("9\nnothing\n4\n")
    assert terminal.people.answer("P01", items_of("q", QUESTIONS["likert"])[0], None, ()) == 4
    assert terminal.shown.getvalue().count("is no answer here; give 1 to 5 (bad to )") == 2


def test_tlx_has_six_scales_and_their_mean() -> None:
    names = [item.name for item in items_of("load", QUESTIONS["tlx"])]
    assert len(names) == 6
    answers = {name: 10 * number for number, name in enumerate(names)}
    assert raw_tlx(answers, "load") == 25.0
    del answers[names[0]]
    assert raw_tlx(answers, "load") is None


def test_questions_that_cannot_be_asked_are_refused() -> None:
    assert not any(unfit_question(question) for question in QUESTIONS.values())
    assert "two different choices" in unfit_question(Question("choice", "Which?", choices=("one", "one")))
    assert "has no text" in unfit_question(Question("text"))
    assert "leave them out" in unfit_question(Question("likert", "How?", choices=("a", "b")))


def test_pages_say_which_trial_of_how_many_and_that_it_is_over() -> None:
    """On the page of whoever is done; the other one's is as it was."""
    terminal, page = Terminal(), StudyPage("study", {"P01": "a", "P02": "b"})
    people = TerminalPeople(terminal.people._keys, terminal.people._console, Pages(page), length=lambda group: " of 12")
    terminal.type("\n\n")
    people.wait(terminal.trial, TrialState(1, ["P01", "P02"]), ["P01", "P02"])
    assert [page.panel(person).message.title for person in ("P01", "P02")] == ["trial 1 of 12"] * 2
    people.thank(["P01"])
    first, second = (page.panel(person).message for person in ("P01", "P02"))
    assert (first.state, first.title) == ("over", "")
    assert first.text.startswith("The study is over.")
    assert (second.state, second.title) == ("waiting", "trial 1 of 12")
    os.close(terminal._read)


def test_staircases_may_end_before_their_last_trial() -> None:
    plain = load_study(Path("fitts"), live=False, allow_unstable=False)[0]
    stairs = load_study(Path("stiffness"), live=False, allow_unstable=False)[0]
    assert trials_in_words(plain, 0) == f" of {planned(plain, 0)}"
    assert trials_in_words(stairs, 0) == f" of at most {planned(stairs, 0)}"
