"""State machine of one trial. It does no input or output: events go in, the state says what its driver does next.

A trial waits until everybody is ready, runs its sessions one after the other, asks, and is finished. A pause, a repeat, or a
session that fails begins it again, as another attempt: what was recorded stays, and does not count. Questions wait by
themselves: there is nothing to pause.
"""

from collections.abc import Sequence
from enum import Enum, auto
from typing import Literal

How = Literal["time", "goal", "operator"]  # by what a session ended
State = Literal["waiting", "running", "asking", "paused", "finished", "abandoned"]


class TrialEvent(Enum):
    """An event of a trial."""

    READY = auto()  # everybody is ready: by keys, by buttons, or at once
    ENDED = auto()  # one session ended, by time, goal or operator
    FAILED = auto()  # one session broke off
    ANSWERED = auto()  # all questions are answered
    PAUSE = auto()
    RESUME = auto()
    REPEAT = auto()
    ABANDON = auto()


BEGINS_ANEW = {TrialEvent.FAILED, TrialEvent.REPEAT}
"""Events after which a trial is another attempt; a pause of a running session too."""

TRANSITIONS: dict[tuple[State, TrialEvent], State] = {
    ("waiting", TrialEvent.READY): "running",
    ("waiting", TrialEvent.PAUSE): "paused",
    ("waiting", TrialEvent.ABANDON): "abandoned",
    ("running", TrialEvent.ENDED): "asking",  # after the last session; "waiting" before
    ("running", TrialEvent.FAILED): "waiting",
    ("running", TrialEvent.PAUSE): "paused",
    ("running", TrialEvent.REPEAT): "waiting",
    ("running", TrialEvent.ABANDON): "abandoned",
    ("asking", TrialEvent.ANSWERED): "finished",
    ("asking", TrialEvent.REPEAT): "waiting",
    ("asking", TrialEvent.ABANDON): "abandoned",
    ("paused", TrialEvent.RESUME): "waiting",
    ("paused", TrialEvent.ABANDON): "abandoned",
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
            self.handle(TrialEvent.READY)
            return True
        return False

    def handle(self, event: TrialEvent) -> State:
        """Take an event, and return the state after it. Raises TrialError."""
        before = self.state
        try:
            after = TRANSITIONS[before, event]
        except KeyError:
            raise TrialError(f"a trial that is {before} takes no {event.name}") from None
        self._ready.clear()
        if event is TrialEvent.ENDED:
            self.session += 1
            after = "waiting" if self.session < self._sessions else after
        if event is TrialEvent.PAUSE:
            self.pauses += 1
        if event in BEGINS_ANEW or (event is TrialEvent.PAUSE and (before == "running" or self.session)):
            self.attempt, self.session = self.attempt + 1, 0
        self.state = after
        return after

    @property
    def over(self) -> bool:
        return self.state in ("finished", "abandoned")
