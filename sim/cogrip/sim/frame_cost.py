"""Time that a frame of a room takes on this machine: everybody holds on, and sends a frame without motion.

It is the room's own world, ports and messages, encoded and decoded. Between two frames there is a pause, as there is live, in
which the processor caches lose its data (docs/decisions/0025-server-cost.md). Socket, encryption and recording are not in it.
"""

from collections.abc import Callable
from statistics import median
from typing import NamedTuple

from cogrip.protocol.settings.rates import NS_PER_S
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.wire.messages import decode
from cogrip.server.ports.seat_limits import ClaimedRecord
from cogrip.server.room import Room
from cogrip.sim.still_hand import StillHand

SPENT_NS = 250_000_000  # time that the measurement takes at most, with the last frame on top
PAUSE_NS = NS_PER_S // 128
WARM = 4  # number of first frames that are not counted, as everything in them is new


class FrameCost(NamedTuple):
    """Median time of a frame [s], and the number of frames that it is of."""

    frame_s: float
    frames: int


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
        hands.append(StillHand(seat.settings, number + 1))
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
