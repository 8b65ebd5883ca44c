"""Who sits and looks on in a running server, as its keeper sees them (`cogrip who`)."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import msgspec

from cogrip.protocol.channel import Address, place_text

if TYPE_CHECKING:  # who asks needs no room, and none of numpy
    from cogrip.protocol.clock import Clock
    from cogrip.server.room import Room

MOST_PRESENT = 100  # that an answer has room for

Number = float | None


class RosterEntry(msgspec.Struct, frozen=True, omit_defaults=True):
    """One person. Ways and round trip are the newest; what is not known is None."""

    name: str
    room: str
    address: str
    since_s: float  # so long ago they sat down, or began to look on
    seat: int | None = None  # None: an observer
    device: str = ""
    rtt_ms: Number = None
    up_ms: Number = None
    down_ms: Number = None
    lost: int | None = None  # frames from them that never came
    holds: bool = False  # the object


def people_of(rooms: "Iterable[Room]", now_ns: int) -> list[RosterEntry]:
    """Room by room, the seats first."""
    people = []
    for room in rooms:
        for number, seat in enumerate(room.seats):
            if seat.state == "seated":
                people.append(
                    RosterEntry(
                        seat.name, room.name, _place(seat.address), _since_s(seat.since_ns, now_ns), number,
                        seat.record.device if seat.record else "", _ms(seat.rtt_ns), _ms(seat.clock.return_ns),
                        _ms(seat.clock.forward_ns), seat.port.lost if seat.port else None, seat.on_object,
                    )
                )  # fmt: skip
        for observer in room.observer_slots.observers.values():
            clock = observer.clock
            people.append(
                RosterEntry(
                    observer.name, room.name, _place(observer.address), _since_s(observer.since_ns, now_ns),
                    rtt_ms=_rtt_ms(clock), up_ms=_ms(clock.return_ns), down_ms=_ms(clock.forward_ns),
                )
            )  # fmt: skip
    return people


def _place(address: Address) -> str:
    return "away" if address is None else place_text(address)


def _since_s(since_ns: int, now_ns: int) -> float:
    return round(max(0, now_ns - since_ns) * 1e-9, 1)


def _ms(value_ns: int | None) -> Number:
    return None if value_ns is None else round(value_ns * 1e-6, 3)


def _rtt_ms(clock: "Clock") -> Number:
    return None if clock.return_ns is None or clock.forward_ns is None else _ms(clock.return_ns + clock.forward_ns)
