"""Time that a frame of a room takes on this machine: everybody holds on, and sends a frame without motion.

It is the room's own world, ports and messages, encoded and decoded. Between two frames there is a pause, as there is live, in
which the processor caches lose its data (docs/decisions/0025-server-cost.md). Socket, encryption and recording are not in it.
"""

from collections.abc import Callable
from statistics import median
from typing import NamedTuple

from cogrip.protocol.axes import PLACES, POSE_AXES
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.settings.rates import NS_PER_S
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.wire.messages import Frame, Intent, Partner, Power, Stamp, State, Waves, decode, encode
from cogrip.server.ports.seat_limits import ClaimedRecord
from cogrip.server.room import Room

SPENT_NS = 250_000_000  # time that the measurement takes at most, with the last frame on top
PAUSE_NS = NS_PER_S // 128
WARM = 4  # number of first frames that are not counted, as everything in them is new


class FrameCost(NamedTuple):
    """Median time of a frame [s], and the number of frames that it is of."""

    frame_s: float
    frames: int


class StillHand:
    """A client's end of one seat, whose hand stays where it began."""

    def __init__(self, seat: SeatSettings, message: type[Frame], session: int) -> None:
        axes = seat.object.axes
        self._message, self._session, self._seat = message, session, seat.seat
        self._sender, self._number = LineSender(axes, seat.playout.redundancy), 0
        self._zero = (0.0,) * axes
        proxy = min(axes, PLACES) if seat.coupling.traits.local else 0
        self._state = (0.0,) * (2 * axes + PLACES * (axes == POSE_AXES) + proxy)

    def frame(self, now_ns: int) -> bytes:
        """Return the next frame, encoded."""
        zero, stamp, number = self._zero, Stamp(now_ns + 1, now_ns), self._number
        self._number += 1
        message: Frame
        if self._message is Waves:
            self._sender.push(zero)
            message = Waves(self._session, *self._sender.contents(), 0.0, 0.0, number, stamp, self._state)
        elif self._message is Power:
            message = Power(self._session, number, zero, zero, zero, zero, zero, 0.0, number, stamp)
        elif self._message is Partner:
            intent = Intent(self._seat, now_ns + 1, zero, zero, 0.0, 0.0)
            message = Partner(self._session, number, zero, zero, (intent,), number, stamp)
        else:
            message = State(self._session, number, zero, zero, 0.0, number, stamp)
        return encode(message)


def frame_cost(settings: Settings, clock_ns: Callable[[], int], wait_until_ns: Callable[[int], None]) -> FrameCost:
    """Return what a frame of this room takes, by this clock, within SPENT_NS. Raises SceneError, WorldError, WorldKindError."""
    room = Room(settings)
    hands: list[StillHand] = []
    for number, seat in enumerate(room.seats):
        record = ClaimedRecord(
            "frame cost", seat.settings.object.axes, seat.settings.rates.device_hz, 10.0, 2.0, 1.0, 10.0
        )
        room.take_seat(number, number + 1, 1, 0, record)
        seat.address = "frame cost", number
        hands.append(StillHand(seat.settings, room.frame, number + 1))
    period_ns = NS_PER_S // settings.rates.network_hz
    took_ns: list[int] = []
    due_ns = clock_ns()
    end_ns = due_ns + SPENT_NS
    while due_ns < end_ns:
        now_ns = period_ns * len(took_ns)
        datagrams = [hand.frame(now_ns) for hand in hands]
        begun_ns = clock_ns()
        for seat, datagram in zip(room.seats, datagrams, strict=True):
            if seat.port is not None:
                seat.port.receive(decode(datagram), now_ns)
        room.tick(now_ns)
        took_ns.append(clock_ns() - begun_ns)
        due_ns = max(due_ns, begun_ns + took_ns[-1]) + PAUSE_NS
        wait_until_ns(due_ns)
    counted = took_ns[WARM:] or took_ns
    return FrameCost(1e-9 * median(counted), len(counted))
