"""A client's end of one seat, whose hand stays where it began: what it sends, whatever the coupling scheme."""

from typing import assert_never

from cogrip.protocol.axes import PLACES, POSE_AXES
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.messages import Frame, Intent, Partner, Power, Stamp, State, Waves, encode


class StillHand:
    """The frames of a hand that never moves, and feels nothing. session: number of its seat session."""

    def __init__(self, seat: SeatSettings, session: int) -> None:
        axes, traits = seat.object.axes, seat.coupling.traits
        self._kind, self._session, self._seat = traits.frame, session, seat.seat
        self._sender, self._number = LineSender(axes, seat.playout.redundancy), 0
        self._zero = (0.0,) * axes
        proxy = min(axes, PLACES) if traits.local else 0
        self._state = (0.0,) * (2 * axes + PLACES * (axes == POSE_AXES) + proxy)

    def frame(self, now_ns: int) -> bytes:
        """Return the next frame, encoded."""
        zero, stamp, number = self._zero, Stamp(now_ns + 1, now_ns), self._number
        self._number += 1
        message: Frame
        match self._kind:
            case "Waves":
                self._sender.push(zero)
                message = Waves(self._session, *self._sender.contents(), 0.0, 0.0, number, stamp, self._state)
            case "State":
                message = State(self._session, number, zero, zero, 0.0, number, stamp)
            case "Power":
                message = Power(self._session, number, zero, zero, zero, zero, zero, 0.0, number, stamp)
            case "Partner":
                intent = Intent(self._seat, now_ns + 1, zero, zero, 0.0, 0.0)
                message = Partner(self._session, number, zero, zero, (intent,), number, stamp)
            case unknown:
                assert_never(unknown)
        return encode(message)
