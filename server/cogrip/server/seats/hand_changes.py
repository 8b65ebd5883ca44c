"""Changes of a person's hand settings by the administrator, told to the client until it reports that it has taken them."""

from collections import deque
from collections.abc import Sequence

from msgspec.structs import replace

from cogrip.protocol.settings.hand import UNSET, HandChange
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.tool_frame import ToolFrame
from cogrip.protocol.wire.messages import SetHand
from cogrip.protocol.wire.reliable import Unanswered
from cogrip.server.seats.markers import A_SECOND, BURST

TOLD_HZ = 16
MOST_UNTOLD = 8  # most changes that are on their way at once


class SentChanges:
    """Those of one seat session.

    holds    what the client goes by, as it reported last; before that, what the seat's settings say
    taken    newest change that the client has taken
    wanted   frame of the tool by settings and changes; reports are a client's word
    line     what was changed of line and spring
    """

    def __init__(self, seat: SeatSettings, network_hz: int, before: "SentChanges | None" = None) -> None:
        """before: of this client's last seat session, which it resumes with the hand that it had."""
        self.holds = seat.hand_change
        self.taken = 0
        self.wanted: ToolFrame = before.wanted if before is not None else seat.tool or ToolFrame()
        self.line: HandChange = before.line if before is not None else UNSET
        self._told: Unanswered[HandChange] = Unanswered(MOST_UNTOLD)
        self._reported = 0
        self._lines: deque[int] = deque(maxlen=BURST)  # steps of the last ones
        self._hz, self._every = network_hz, max(1, network_hz // TOLD_HZ)
        for _, change in before._told.waiting if before is not None else ():
            self.add(change)

    @property
    def number(self) -> int:
        """Number of the newest change, from 1; 0: none."""
        return self._told.number

    @property
    def full(self) -> bool:
        """Return whether the client has yet to answer too many changes."""
        return self._told.full

    def add(self, change: HandChange) -> ToolFrame:
        """Queue a change for the client. Return the hand frame that the tool will have."""
        self._told.add(change)
        self.wanted = change.frame(self.wanted)
        self.line = HandChange(**change.of_line()).after(self.line)
        self.holds = HandChange(**change.of_spring()).after(self.holds)  # the server's own, whatever a client reports
        return self.wanted

    def receive(self, message: SetHand) -> bool:
        """Receive a report. Return whether it is new."""
        if message.acknowledged > self.number or None in (message.hand.position_scale, message.hand.force_scale):
            return False
        self.taken = max(self.taken, message.acknowledged)
        self._told.answered(self.taken)
        if message.number <= self._reported:
            return False
        told = replace(message.hand, stiffness_npm=None, damping_nspm=None)  # of the spring the server knows by itself
        self._reported, self.holds = message.number, told.after(self.holds)
        return True

    def worth_a_line(self, step: int) -> bool:
        """Return whether a report of this step is to be logged: of a client that reports without end few are."""
        if len(self._lines) == BURST and step - self._lines[0] < BURST // A_SECOND * self._hz:
            return False
        self._lines.append(step)
        return True

    def answer(self, session: int) -> SetHand:
        """Return the message that acknowledges the newest report."""
        return SetHand(session, 0, self._reported)

    def due(self, session: int, step: int) -> Sequence[SetHand]:
        """Return the changes to tell after a step."""
        return self.untold(session) if self._told.waiting and step % self._every == 0 else ()

    def untold(self, session: int) -> list[SetHand]:
        """Return the changes that the client has not answered."""
        return [SetHand(session, number, self._reported, change) for number, change in self._told.waiting]
