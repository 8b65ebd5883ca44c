"""Seats and observer slots of a server: who speaks from which address, and which one a hello gets."""

from collections.abc import Iterator, Sequence
from itertools import chain

from cogrip.machine.addition import add_integers
from cogrip.protocol.secure.channel import Address
from cogrip.protocol.wire.messages import NO_BOUND, Hello
from cogrip.protocol.wire.session import unfit
from cogrip.server.admission.admission import Denied, Grant
from cogrip.server.ports.seat_limits import misclaimed, record_of
from cogrip.server.room import Room
from cogrip.server.seats.participants import Observer, Participant, Seat

Place = tuple[Room, Seat | Observer]


class SeatTable:
    """Places of all participants. It alone writes `Participant.address`: nobody has two addresses, no address two people.

    A seat that was left keeps its address until another hello comes from it, so that a repeated goodbye is answered.
    places  place at each address; it is read here and in the core, and written here alone
    woken  rooms in which somebody got an address, since the loop emptied it
    """

    def __init__(self, rooms: Sequence[Room]) -> None:
        self.rooms = rooms
        self.woken: set[Room] = set()
        self.places: dict[Address, Place] = {}

    @property
    def addresses(self) -> list[Address]:
        """All addresses that are bound."""
        return list(self.places)

    def bind(self, room: Room, who: Seat | Observer, address: Address) -> None:
        """Bind a participant to this address."""
        self.unbind(who)
        self.release(address)
        self.places[address] = room, who
        self.woken.add(room)
        who.address = address

    def unbind(self, who: Participant) -> None:
        """Take a participant's address away."""
        if who.address is not None:
            self.release(who.address)

    def release(self, address: Address) -> None:
        """Take an address from whoever has it."""
        place = self.places.pop(address, None)
        if place is not None:
            place[1].address = None

    def roster(self) -> list[Place]:
        """Return everybody in a session: seats, then observers."""
        return [
            *((room, seat) for room in self.rooms for seat in room.seats if seat.state == "seated"),
            *self._observers(),
        ]

    def by_ticket(self, ticket_hash: str) -> Place | None:
        """Return the seat, or else the observer slot, that a ticket resumes."""
        if not ticket_hash:
            return None
        seats: Iterator[Place] = ((room, seat) for room in self.rooms for seat in room.seats)
        return next((place for place in chain(seats, self._observers()) if place[1].ticket_hash == ticket_hash), None)

    def _observers(self) -> Iterator[Place]:
        return ((room, each) for room in self.rooms for each in room.observer_slots.observers.values())

    def count_by_token(self, token: str) -> int:
        """Return how many seats were taken with this token and are not left."""
        return add_integers(
            seat.state == "seated" and seat.token == token for room in self.rooms for seat in room.seats
        )


def find_seat(rooms: Sequence[Room], hello: Hello, grant: Grant, now_ns: int) -> tuple[Room, Seat] | Denied:
    """Return the first free seat that hello and grant agree on and that the device fits, else why the first does not fit."""
    among = _rooms(rooms, hello, grant)
    if isinstance(among, Denied):
        return among
    if grant.user and hello.name not in ("", grant.user):
        return Denied("name", f"this token is for the seat of {grant.user!r}, not of {hello.name!r}; leave --name out")
    if grant.device and not hello.device.startswith(grant.device):
        claimed = f"and {hello.device} is claimed; join with the device it is for"
        return Denied("device", f"this token is for {grant.device}, {claimed}")
    for most, claim, unit, kind in (
        (grant.force_n, hello.device_force_n, "N", "weaker"), (grant.speed_mps, hello.device_speed_mps, "m/s", "slower")
    ):  # fmt: skip
        if 0.0 < most < claim:
            claimed = f"{claim:g} {unit}" if claim < NO_BOUND else "no bound"
            words = f"and {hello.device} claims {claimed}; join with a {kind} device"
            return Denied("device", f"this token is for devices of at most {most:g} {unit}, {words}")
    name = hello.name or grant.user
    misfit: Denied | None = None
    for room in among:
        for seat in room.seats:
            if room.free(seat.number, now_ns) and name in ("", seat.name):
                reason = _misfit(room, seat, hello)
                if reason is None:
                    return room, seat
                misfit = misfit or reason
    if misfit is not None:
        return misfit
    names = [seat.name for room in among for seat in room.seats]
    if name and name not in names:
        return Denied("name", f"no seat is kept for {name!r}; seats are: {', '.join(names)}")
    fit = [(room, seat.number) for room in among for seat in room.seats if name in ("", seat.name)]
    return _none_free(name, [room.reserved_ns(number, now_ns) for room, number in fit])


def _none_free(name: str, reserved_ns: Sequence[int]) -> Denied:
    """Return a refusal that says for how long seats are reserved, and not for whom. reserved_ns: 0 of a seat that is taken."""
    kept = sorted(-(-each // 1_000_000_000) for each in reserved_ns if each)
    if name and kept:
        words = f"the seat of {name!r} is kept for another {kept[0]} s for someone who lost their connection; try again then"
        return Denied("taken", words)
    if name:
        return Denied("taken", f"the seat of {name!r} is taken; wait until it is left or time out")
    if not kept:
        return Denied("full", f"the room is full: all {len(reserved_ns)} seats are taken")
    span = f"{kept[0]} s" if kept[0] == kept[-1] else f"{kept[0]} to {kept[-1]} s"
    taken, lost = (
        len(reserved_ns) - len(kept),
        f"{len(kept)} kept for another {span} for someone who lost their connection",
    )
    return Denied("full", f"the room has no free seat: {taken} taken, {lost}; try again then")


def find_observer_slot(rooms: Sequence[Room], hello: Hello, grant: Grant) -> Room | Denied:
    """Return the first room with a free observer slot."""
    among = _rooms(rooms, hello, grant)
    if isinstance(among, Denied):
        return among
    for room in among:
        if not room.observer_slots.full:
            return room
    places = add_integers(room.observer_slots.places for room in among)
    return Denied("full", f"all {places} places for observers are taken (admission.observers)")


def _rooms(rooms: Sequence[Room], hello: Hello, grant: Grant) -> list[Room] | Denied:
    if grant.room and hello.room not in ("", grant.room):
        return Denied("room", f"this token is for room {grant.room!r}, not {hello.room!r}; use the link as it is")
    wanted = hello.room or grant.room
    # a room on demand is entered by its name alone
    among = [room for room in rooms if room.is_open and (wanted == room.called or not (wanted or room.template))]
    if not among:
        there = ", ".join([room.called for room in rooms if not room.template])
        known = f"; there is: {there}" if there else ": it was not opened yet, or is closed again"
        return Denied("room", f"there is no room {wanted!r} here{known}")
    return among


def _misfit(room: Room, seat: Seat, hello: Hello) -> Denied | None:
    """Return why this device does not fit a seat; None where it fits."""
    user = room.settings.users[seat.number]
    whose = "this room at rates.device_hz"
    if user.device_hz is not None:
        whose = f"the seat of {user.name!r} at users.{seat.number}.device_hz"
    device_hz = seat.settings.rates.device_hz
    misfit = unfit(hello, digest=room.digest, axes=seat.settings.object.axes, device_hz=device_hz, whose=whose)
    if misfit is not None:
        return Denied(*misfit)
    misclaim = misclaimed(record_of(hello), room.settings, seat.number)
    return Denied("device", misclaim) if misclaim else None
