"""Changes of a hand's settings that the server tells, and reports of what holds, each sent until the server has it."""

from cogrip.protocol.settings.hand import HandChange
from cogrip.protocol.wire.messages import SetHand

AGAIN_NS = 100_000_000


class HandChanges:
    """Those of one seat.

    taken, reported  newest change of this session that has come, and that holds
    holds            what was reported last
    """

    def __init__(self, begun: HandChange) -> None:
        """begun: what holds by the seat's settings, of which the server knows."""
        self.taken = self.reported = 0
        self.holds = begun
        self._number = self._answered = 0
        self._next_ns = 0

    def begin(self) -> None:
        """Begin a session of the same seat: whatever was reported is reported again."""
        self.taken = self.reported = self._answered = self._next_ns = 0

    def receive(self, message: SetHand) -> HandChange | None:
        """Take in a message. Returns a change that is due, None for a repeated one."""
        self._answered = max(self._answered, min(message.acknowledged, self._number))
        if message.number != self.taken + 1:
            return None
        self.taken += 1
        return message.hand

    def report(self, holds: HandChange) -> None:
        """Report what holds now."""
        self.holds, self.reported = holds, self.taken
        self._number += 1
        self._next_ns = 0

    def pending(self) -> bool:
        """Return whether the server has not answered the newest report."""
        return self._answered < self._number

    def due(self, session: int, now_ns: int) -> list[SetHand]:
        """Return the messages to send now."""
        if not self.pending() or now_ns < self._next_ns:
            return []
        self._next_ns = now_ns + AGAIN_NS
        return [SetHand(session, self._number, self.reported, self.holds)]
