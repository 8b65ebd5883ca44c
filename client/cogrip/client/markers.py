"""Markers of one client: those that it sets, sent until the server has them, and those that the server tells."""

from collections import deque

from cogrip.protocol.settings.task import EVERYBODY
from cogrip.protocol.texts import clipped_mark
from cogrip.protocol.wire.messages import Mark
from cogrip.protocol.wire.reliable import Unanswered

AGAIN_NS = 100_000_000
MOST_UNANSWERED = 8
MOST_KNOWN = 256  # most numbers of markers kept, so that a marker that is repeated is taken once


class Markers:
    """refused: markers that were set while MOST_UNANSWERED were on their way; everybody: whether every seat has been held."""

    def __init__(self) -> None:
        self.refused = 0
        self.everybody = False
        self._unanswered: Unanswered[str] = Unanswered(MOST_UNANSWERED, AGAIN_NS)
        self._known: deque[tuple[int, int]] = deque(maxlen=MOST_KNOWN)

    def pending(self) -> bool:
        """Return whether one that was set has not been answered."""
        return bool(self._unanswered.waiting)

    def add(self, text: str) -> bool:
        """Set a marker; False where too many are on their way."""
        if self._unanswered.full:
            self.refused += 1
            return False
        self._unanswered.add(clipped_mark(text))
        return True

    def due(self, session: int, now_ns: int) -> list[Mark]:
        """Return the messages to send now."""
        return [Mark(session, number, text) for number, text in self._unanswered.due(now_ns)]

    def receive(self, mark: Mark, seat: int | None) -> bool:
        """Take in a marker that the server tells. seat: one's own. Returns whether it is new here, and not one's own."""
        own = seat is not None and mark.seat == seat and mark.theirs > 0  # 0: of who had the seat before
        if own:
            self._unanswered.answered_one(mark.theirs)
        known = mark.number, mark.step  # a server that begins anew counts from 1
        if known in self._known:
            return False
        self._known.append(known)
        if mark.seat is None and mark.text == EVERYBODY:
            self.everybody = True
        return not own
