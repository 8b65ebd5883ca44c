"""Roster: everybody in a session at a running server, for its administrator (`cogrip who`)."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import msgspec

from cogrip.protocol.secure.channel import place_text
from cogrip.protocol.settings.hand import UNCHANGED

if TYPE_CHECKING:  # the command that asks needs no room, and none of numpy
    from cogrip.protocol.wire.clock import MessageClock
    from cogrip.server.room import Room
    from cogrip.server.seats.participants import Participant, Seat

MOST_LISTED = 100  # most entries in an answer

Number = float | None


class RosterEntry(msgspec.Struct, frozen=True, omit_defaults=True):
    """One person. Delays and round trip are the newest; None: not known."""

    name: str
    room: str
    address: str
    since_s: float  # age of the session
    seat: int | None = None  # number of the seat; None: an observer
    device: str = ""
    rtt_ms: Number = None
    up_ms: Number = None
    down_ms: Number = None
    lost: int | None = None  # frames from this person that never came
    holds: bool = False  # the person holds the object
    hand: str = ""  # settings of the hand that differ from those of a hand that moves its tool as itself
    # energies of the gate at the hand, where there is one: what it put in and was given less what it took, as its client
    # tells; what it gave to the others and got from them, as it was passed on
    gate_j: Number = None
    gave_j: Number = None
    got_j: Number = None
    token: str = ""  # public id of the token by which the person came in


def roster_of(rooms: "Iterable[Room]", now_ns: int) -> list[RosterEntry]:
    """Return the roster, room by room, the seats first."""
    entries: list[RosterEntry] = []
    for room in rooms:
        entries += [
            _entry(room, seat, now_ns, seat=seat.number, device=seat.record.device if seat.record else "",
                   rtt_ms=_ms(seat.rtt_ns), lost=seat.port.lost if seat.port else None, holds=seat.on_object,
                   hand=seat.hand.holds.unlike(UNCHANGED).text, **_gate(seat))
            for seat in room.seats if seat.state == "seated"
        ]  # fmt: skip
        entries += [
            _entry(room, observer, now_ns, rtt_ms=_rtt_ms(observer.clock))
            for observer in room.observer_slots.observers.values()
        ]
    return entries


def _gate(seat: "Seat") -> dict[str, Number]:
    if seat.port is None or not seat.settings.coupling.traits.gated:
        return {}
    return {"gate_j": seat.line_reserve.now_j, "gave_j": seat.port.used_j, "got_j": seat.port.made_j}


def _entry(room: "Room", who: "Participant", now_ns: int, **other: Any) -> RosterEntry:
    place = "away" if who.address is None else place_text(who.address)
    since_s = round(max(0, now_ns - who.since_ns) * 1e-9, 1)
    up_ms, down_ms = _ms(who.clock.return_ns), _ms(who.clock.forward_ns)
    return RosterEntry(who.name, room.called, place, since_s, up_ms=up_ms, down_ms=down_ms, token=who.token, **other)


def _ms(value_ns: int | None) -> Number:
    return None if value_ns is None else round(value_ns * 1e-6, 3)


def _rtt_ms(clock: "MessageClock") -> Number:
    return None if clock.return_ns is None or clock.forward_ns is None else _ms(clock.return_ns + clock.forward_ns)
