"""Participants and operator at one terminal: lines typed on standard input."""

import os
import select
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from cogrip.protocol.io.stop import Stop
from cogrip.sim.experiments.study.conductor import Quit
from cogrip.sim.experiments.study.plan import Trial
from cogrip.sim.experiments.study.questions import Answer, AnswerError, Item
from cogrip.sim.experiments.study.trial import Event, TrialState

ORDERS = {"p": Event.PAUSE, "r": Event.REPEAT, "a": Event.ABANDON}
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
    """See `conductor.People`. A person is ready who presses Enter; `TrialState.ready` takes buttons of devices as well."""

    def __init__(self, keys: Keys, console: Console) -> None:
        self._keys, self._console = keys, console

    def tell(self, text: str) -> None:
        """Show instructions until Enter."""
        self._console.print(f"\n{text}\n(Enter goes on)")
        self._order(self._keys.line())

    def wait(self, trial: Trial, state: TrialState, people: Sequence[str]) -> Event:
        """Wait for Enter from each person, or for an order."""
        part = f", part {state.session + 1} of {len(trial.presentations)}" if len(trial.presentations) > 1 else ""
        kind = "practice trial" if trial.block.practice else "trial"
        self._console.print(f"\n{kind} {trial.number}{part} ({trial.block.name})")
        if state.state == "paused":
            self._console.print("paused: Enter goes on; a leaves this trial out, q quits")
            return Event.ABANDON if self._order(self._keys.line()) is Event.ABANDON else Event.RESUME
        for person in people:
            self._console.print(f"{person}: Enter when you are ready (p pauses, a leaves this trial out, q quits)")
            order = self._order(self._keys.line())
            if order in (Event.PAUSE, Event.ABANDON):
                return order
        return Event.READY

    def _order(self, line: str) -> Event | None:
        if line == "q":
            raise Quit
        return ORDERS.get(line)

    def answer(self, person: str, item: Item, trial: Trial | None, runs: Sequence[Path]) -> Answer:
        """Ask until the answer is one that the question takes."""
        while True:
            self._console.print(f"\n{person}: {item.text}\n  {item.takes}")
            try:
                return item.read(self._keys.line())
            except AnswerError as error:
                self._console.print(f"  {error}")
