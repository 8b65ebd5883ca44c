"""The receiving end of virtual coupling and of power variables: the newest message wins (SPEC.md 7, 7b; theory section 5)."""

from typing import Generic, Protocol, TypeVar

from cogrip.protocol.line.receiver import FURTHEST_JUMP
from cogrip.protocol.wire.accounts import LinkCount

HISTORY = 256  # states for which the receiver still knows whether they have arrived


class Numbered(Protocol):
    """A message with the number of its frame."""

    @property
    def number(self) -> int: ...


M = TypeVar("M", bound=Numbered)


class StateReceiver(Generic[M]):
    """Keeps the newest state. One that arrives after a newer one, or is overtaken before it is popped, is late.

    newest  number of the newest state received; -1 before the first
    latest  the state popped last, None before the first
    """

    def __init__(self) -> None:
        self.newest = -1
        self._waiting: M | None = None
        self._received = self._applied = self._late = self._duplicate = 0
        self._seen = [-1] * HISTORY
        self.latest: M | None = None

    @property
    def acknowledged(self) -> int:
        """Number after the state popped last; 0 before the first."""
        return self.latest.number + 1 if self.latest else 0

    def receive(self, state: M) -> bool:
        """Receive a state. Return False, and change nothing, if it is too far ahead, or too old to tell from a duplicate."""
        if not self.newest - HISTORY < state.number <= self.newest + FURTHEST_JUMP:
            return False
        slot = state.number % HISTORY
        if self._seen[slot] == state.number:
            self._duplicate += 1
            return True
        self._seen[slot] = state.number
        self._received += 1
        overtaken = state.number < self.newest
        if overtaken or self._waiting is not None:
            self._late += 1
        if not overtaken:
            self.newest, self._waiting = state.number, state
        return True

    def pop(self) -> bool:
        """Make the newest state the one in `latest`. True if there was a new one."""
        if self._waiting is None:
            return False
        self._applied += 1
        self.latest, self._waiting = self._waiting, None
        return True

    @property
    def lost(self) -> int:
        """States that have not arrived, as far as is known."""
        return self.newest + 1 - (self._waiting is not None) - self._applied - self._late

    def count(self) -> LinkCount:
        """Return how many states met which fate."""
        waiting = self._waiting is not None
        sent = self.newest + 1 - waiting
        return LinkCount(sent, self._received, self._applied, self.lost, self._late, self._duplicate, int(waiting))
