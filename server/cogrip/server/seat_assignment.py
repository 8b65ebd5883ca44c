"""Where a hello leads: to a seat, to the gallery, or to a refusal in words that both sides print."""

from collections.abc import Sequence

from cogrip.protocol.messages import Hello
from cogrip.protocol.session import unfit
from cogrip.server.admission import Denied, Grant
from cogrip.server.room import Room
from cogrip.server.seat_limits import misclaimed, record_of


def find_again(rooms: Sequence[Room], mark: str) -> tuple[Room, int] | None:
    """The seat that a ticket with this mark opens."""
    if not mark:
        return None
    for room in rooms:
        for number, seat in enumerate(room.seats):
            if seat.ticket == mark:
                return room, number
    return None


def find_observer(rooms: Sequence[Room], mark: str) -> tuple[Room, int] | None:
    """The observer whose ticket has this mark."""
    if not mark:
        return None
    for room in rooms:
        for number, each in room.observer_slots.observers.items():
            if each.ticket == mark:
                return room, number
    return None


def find_seat(rooms: Sequence[Room], hello: Hello, grant: Grant, now_ns: int) -> tuple[Room, int] | Denied:
    """The first free seat that hello and grant agree on, and that the device fits; else why the first of them does not fit."""
    among = _rooms(rooms, hello, grant)
    if isinstance(among, Denied):
        return among
    if grant.user and hello.name not in ("", grant.user):
        return Denied("name", f"this token is for the seat of {grant.user!r}, not of {hello.name!r}; leave --name out")
    if grant.device and not hello.device.startswith(grant.device):
        return Denied(
            "device", f"this token is for {grant.device}, and {hello.device} is claimed; join with the device it is for"
        )
    name = hello.name or grant.user
    misfit: Denied | None = None
    for room in among:
        for number, seat in enumerate(room.seats):
            if room.free(number, now_ns) and name in ("", seat.settings.user):
                found = _fitting(room, number, hello)
                if not isinstance(found, Denied):
                    return found
                misfit = misfit or found
    if misfit is not None:
        return misfit
    names = [seat.settings.user for room in among for seat in room.seats]
    if name and name not in names:
        return Denied("name", f"no seat is kept for {name!r}; seats are: {', '.join(names)}")
    left_ns = [
        room.kept_ns(number, now_ns)
        for room in among
        for number, seat in enumerate(room.seats)
        if name in ("", seat.settings.user)
    ]
    return _none_free(name, left_ns)


def _none_free(name: str, left_ns: Sequence[int]) -> Denied:
    """Say for how long the seats that are not taken are kept, and not for whom. left_ns: of each seat, 0 where it is taken."""
    kept = sorted(-(-each // 1_000_000_000) for each in left_ns if each)
    if name and kept:
        words = f"the seat of {name!r} is kept for another {kept[0]} s for someone who lost their connection; try again then"
        return Denied("taken", words)
    if name:
        return Denied("taken", f"the seat of {name!r} is taken; wait until it is left or time out")
    if not kept:
        return Denied("full", f"the room is full: all {len(left_ns)} seats are taken")
    span = f"{kept[0]} s" if kept[0] == kept[-1] else f"{kept[0]} to {kept[-1]} s"
    words = (
        f"the room has no free seat: {len(left_ns) - len(kept)} taken, {len(kept)} kept for another {span} for someone "
        "who lost their connection; try again then"
    )
    return Denied("full", words)


def find_observer_slot(rooms: Sequence[Room], hello: Hello, grant: Grant) -> Room | Denied:
    """The first room with a place to look on from."""
    among = _rooms(rooms, hello, grant)
    if isinstance(among, Denied):
        return among
    for room in among:
        if not room.observer_slots.full:
            return room
    places = sum(room.observer_slots.places for room in among)
    return Denied("full", f"all {places} places for observers are taken (admission.observers)")


def _rooms(rooms: Sequence[Room], hello: Hello, grant: Grant) -> list[Room] | Denied:
    if grant.room and hello.room not in ("", grant.room):
        return Denied("room", f"this token is for room {grant.room!r}, not {hello.room!r}; use the link as it is")
    wanted = hello.room or grant.room
    among = [room for room in rooms if wanted in ("", room.name)]
    if not among:
        there = ", ".join(room.name for room in rooms)
        return Denied("room", f"there is no room {wanted!r} here; there is: {there}")
    return among


def _fitting(room: Room, number: int, hello: Hello) -> tuple[Room, int] | Denied:
    whose = "this room at rates.device_hz"
    if room.settings.users[number].device_hz is not None:
        whose = f"the seat of {room.settings.users[number].name!r} at users.{number}.device_hz"
    device_hz = room.seats[number].settings.rates.device_hz
    misfit = unfit(hello, digest=room.digest, axes=room.world.axes, device_hz=device_hz, whose=whose)
    if misfit is not None:
        return Denied(*misfit)
    misclaim = misclaimed(record_of(hello), room.settings, number)
    if misclaim:
        return Denied("device", misclaim)
    return room, number
