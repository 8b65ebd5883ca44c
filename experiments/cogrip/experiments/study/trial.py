"""State machine of one trial. It does no input or output: events go in, the state says what its driver does next.

A trial waits until everybody is ready, runs its sessions one after the other, asks, and is finished. A pause, a repeat, or a
session that fails begins it again, as another attempt: what was recorded stays, and does not count. Questions wait by
themselves: there is nothing to pause.
"""

from collections.abc import Sequence
from enum import Enum, auto
from typing import Literal

State = Literal["waiting", "running", "asking", "paused", "finished", "abandoned"]


class Event(Enum):
    """An event of a trial."""

    READY = auto()  # everybody is ready: by keys, by buttons, or at once
    ENDED = auto()  # one session ended, by time, goal or operator
    FAILED = auto()  # one session broke off
    ANSWERED = auto()  # all questions are answered
    PAUSE = auto()
    RESUME = auto()
    REPEAT = auto()
    ABANDON = auto()


BEGINS_ANEW = {Event.FAILED, Event.REPEAT}
"""Events after which a trial is another attempt; a pause of a running session too."""

TRANSITIONS: dict[tuple[State, Event], State] = {
    ("waiting", Event.READY): "running",
    ("waiting", Event.PAUSE): "paused",
    ("waiting", Event.ABANDON): "abandoned",
    ("running", Event.ENDED): "asking",  # after the last session; "waiting" before
    ("running", Event.FAILED): "waiting",
    ("running", Event.PAUSE): "paused",
    ("running", Event.REPEAT): "waiting",
    ("running", Event.ABANDON): "abandoned",
    ("asking", Event.ANSWERED): "finished",
    ("asking", Event.REPEAT): "waiting",
    ("asking", Event.ABANDON): "abandoned",
    ("paused", Event.RESUME): "waiting",
    ("paused", Event.ABANDON): "abandoned",
}


def begun_by(run: str) -> str:
    """Return the marker of a live session's beginning, by the name of its run folder."""
    return f"begin {run}"


def ended_by(run: str, how: str) -> str:
    """Return the marker of its end."""
    return f"end {run} {how}"


class TrialError(Exception):
    """Raised for an event that a trial's state does not take."""


class TrialState:
    """One trial of `sessions` sessions and of `people` who are to be ready. attempt: from 1."""

    def __init__(self, sessions: int, people: Sequence[str], attempt: int = 1) -> None:
        self._sessions = sessions
        self._people = frozenset(people)
        self._ready: set[str] = set()
        self.state: State = "waiting"
        self.session = 0  # the current one, from 0
        self.attempt = attempt
        self.pauses = 0

    @property
    def readied(self) -> frozenset[str]:
        """Return who is ready."""
        return frozenset(self._ready)

    def ready(self, who: str) -> bool:
        """Take that a person is ready. Return whether everybody is, which begins the session."""
        if self.state == "waiting" and who in self._people:
            self._ready.add(who)
        if self.state == "waiting" and self._ready == self._people:
            self.handle(Event.READY)
            return True
        return False

    def handle(self, event: Event) -> State:
        """Take an event, and return the state after it. Raises TrialError."""
        before = self.state
        try:
            after = TRANSITIONS[before, event]
        except KeyError:
            raise TrialError(f"a trial that is {before} takes no {event.name}") from None
        self._ready.clear()
        if event is Event.ENDED:
            self.session += 1
            after = "waiting" if self.session < self._sessions else after
        if event is Event.PAUSE:
            self.pauses += 1
        if event in BEGINS_ANEW or (event is Event.PAUSE and (before == "running" or self.session)):
            self.attempt, self.session = self.attempt + 1, 0
        self.state = after
        return after

    @property
    def over(self) -> bool:
        return self.state in ("finished", "abandoned")
