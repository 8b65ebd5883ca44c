"""Changes of a hand's settings that the server tells, and reports of what holds, each sent until the server has it."""

from cogrip.protocol.settings.hand import HandChange
from cogrip.protocol.wire.messages import SetHand
from cogrip.protocol.wire.reliable import Unanswered

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
        self._reports: Unanswered[HandChange] = Unanswered(again=AGAIN_NS)  # the newest alone

    def begin(self) -> None:
        """Begin a session of the same seat: whatever was reported is reported again."""
        self.taken = self.reported = 0
        if self._reports.number:
            self.report(self.holds)

    def receive(self, message: SetHand) -> HandChange | None:
        """Take in a message. Returns a change that is due, None for a repeated one."""
        self._reports.answered(message.acknowledged)
        if message.number != self.taken + 1:
            return None
        self.taken += 1
        return message.hand

    def report(self, holds: HandChange) -> None:
        """Report what holds now."""
        self.holds, self.reported = holds, self.taken
        self._reports.waiting.clear()
        self._reports.add(holds)

    def pending(self) -> bool:
        """Return whether the server has not answered the newest report."""
        return bool(self._reports.waiting)

    def due(self, session: int, now_ns: int) -> list[SetHand]:
        """Return the messages to send now."""
        return [SetHand(session, number, self.reported, holds) for number, holds in self._reports.due(now_ns)]
