"""Participants and operator at one terminal: lines typed on standard input; and participants at their pages."""

import os
import select
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console

from cogrip.cli.study.pages import Pages, prompt_of
from cogrip.experiments.study.conductor import Quit
from cogrip.experiments.study.plan import Trial
from cogrip.experiments.study.questions import Answer, AnswerError, Item
from cogrip.experiments.study.trial import TrialEvent, TrialState
from cogrip.machine.stop import Stop
from cogrip.view.panel import Prompt

ORDERS = {"p": TrialEvent.PAUSE, "r": TrialEvent.REPEAT, "a": TrialEvent.ABANDON}
_POLL_S = 0.05


class Keys:
    """Lines of standard input, taken as they come. The end of the input, and Ctrl-C, quit."""

    def __init__(self, stop: Stop, file: int | None = None) -> None:
        self._stop = stop
        self._file = sys.stdin.fileno() if file is None else file
        self._held = b""

    def poll(self, wait_s: float = 0.0) -> str | None:
        """Return the next line without its end, None if there is none within that time. Raises Quit."""
        if self._stop.reason:
            raise Quit
        while b"\n" not in self._held and select.select([self._file], [], [], wait_s)[0]:
            more = os.read(self._file, 4096)
            if not more:
                raise Quit
            self._held += more
        line, end, rest = self._held.partition(b"\n")
        if not end:
            return None
        self._held = rest
        return line.decode(errors="replace").strip()

    def line(self) -> str:
        """Return the next line, once there is one. Raises Quit."""
        while (line := self.poll(_POLL_S)) is None:
            pass
        return line


class TerminalPeople:
    """See `conductor.People`: at this terminal, and each on their page. Whichever is first counts; pages give no orders."""

    def __init__(
        self, keys: Keys, console: Console, pages: Pages | None = None, *, buttons: bool = False,
        length: Callable[[int], str] = lambda group: "", clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        """buttons: people say in the session that they are ready, by a button of the device; before it nobody is asked.

        length: of a group's trials, in the words behind a trial's number: " of 12". clock: [s], by which breaks last
        """
        self._buttons, self._length, self._clock = buttons, length, clock
        self._keys, self._console, self._pages = keys, console, pages or Pages()

    def tell(self, text: str, people: Sequence[str]) -> None:
        """Show instructions until Enter, or until everybody goes on from their page."""
        self._console.print(f"\n{text}\n(Enter goes on)")
        self._pages.instruct(people, text)
        self._everybody(people, Prompt(kind="go", text="Go on"), at_once=True)

    def rest(self, seconds: float, people: Sequence[str]) -> None:
        """Say that there is a break, until it is over or the operator presses Enter. Raises Quit."""
        self._console.print(f"\nbreak of {seconds:g} s (Enter ends it, q quits)")
        self._pages.title(people, f"A break of {seconds:g} s")
        for person in people:
            self._pages.show(person, "paused")
        ends_s = self._clock() + seconds
        while self._clock() < ends_s:
            line = self._keys.poll(_POLL_S)
            if line is not None:
                self._order(line)
                return

    def wait(self, trial: Trial, state: TrialState, people: Sequence[str]) -> TrialEvent:
        """Wait for Enter from each person, or for an order."""
        part = f", part {state.session + 1} of {len(trial.presentations)}" if len(trial.presentations) > 1 else ""
        kind = "practice trial" if trial.block.practice else "trial"
        title = f"{kind} {trial.number}{self._length(trial.group)}{part}"
        self._console.print(f"\n{title} ({trial.block.name})")
        self._pages.title(people, title)
        if state.state == "paused":
            self._console.print("paused: Enter goes on; a leaves this trial out, q quits")
            for person in people:
                self._pages.show(person, "paused")
            return TrialEvent.ABANDON if self._order(self._keys.line()) is TrialEvent.ABANDON else TrialEvent.RESUME
        return TrialEvent.READY if self._buttons else self._everybody(people, Prompt(kind="go", text="I am ready"))

    def thank(self, people: Sequence[str]) -> None:
        """Say on the pages of these people that the study is over for them."""
        self._pages.title(people, "")
        self._pages.instruct(people, "The study is over. Thank you! You can close this page.")
        for person in people:
            self._pages.show(person, "over")

    def _everybody(self, people: Sequence[str], prompt: Prompt, *, at_once: bool = False) -> TrialEvent:
        """Wait until everybody has gone on, or for an order. at_once: Enter goes on for all of them."""
        missing = list(people)
        for person in people:
            self._pages.show(person, "waiting", prompt)
        asked = ""
        while missing:
            if missing[0] != asked and not at_once:
                asked = missing[0]
                self._console.print(f"{asked}: Enter when you are ready (p pauses, a leaves this trial out, q quits)")
            line = self._keys.poll(_POLL_S)
            if line is not None:
                order = self._order(line)
                if order in (TrialEvent.PAUSE, TrialEvent.ABANDON) and not at_once:
                    return order
            gone = people if line is not None and at_once else missing[:1] if line is not None else []
            replied = [person for person in missing if self._pages.take(person) is not None]
            for person in replied if not at_once else ():
                self._console.print(f"{person} is ready")
            for person in {*gone, *replied}:
                missing.remove(person)
                self._pages.show(person, "waiting")
        return TrialEvent.READY

    def _order(self, line: str) -> TrialEvent | None:
        if line == "q":
            raise Quit
        return ORDERS.get(line)

    def answer(self, person: str, item: Item, trial: Trial | None, runs: Sequence[Path]) -> Answer:
        """Ask until the answer is one that the question takes."""
        problem = ""
        while True:
            self._console.print(f"\n{person}: {item.text}\n  {item.takes}")
            self._pages.show(person, "asking", prompt_of(item, problem))
            try:
                answer = item.read(self._said(person))
            except AnswerError as error:
                problem = str(error)
                self._console.print(f"  {problem}")
            else:
                self._pages.show(person, "waiting")
                return answer

    def _said(self, person: str) -> str:
        """Return what was typed here or sent from the person's page, whichever comes first."""
        while True:
            line = self._keys.poll(_POLL_S)
            if line is None:
                line = self._pages.take(person)
            if line is not None:
                return line
