"""The server without I/O: messages in, messages out; many rooms, no socket, no clock."""

from collections import deque
from collections.abc import Callable, Iterable, Sequence

import msgspec

from cogrip.protocol import messages
from cogrip.protocol.channel import Address, place_text
from cogrip.protocol.clock import Clock
from cogrip.protocol.messages import PROTOCOL_VERSION, Farewell, Frame, Heartbeat, Hello, Leave, Power, State, Waves
from cogrip.protocol.session import nonce_of, refusal, version_mismatch
from cogrip.protocol.settings import Settings
from cogrip.server.admission import AdmitAll, Authenticator, Denied, Grant
from cogrip.server.checkpoint import RoomCheckpoint
from cogrip.server.events import ServerEvent
from cogrip.server.observers import Observer
from cogrip.server.room import Room, Seat
from cogrip.server.seat_assignment import find_again, find_observer, find_observer_slot, find_seat
from cogrip.server.seat_limits import record_of

FAREWELL_EVERY_NS = 50_000_000  # to one who has not heard it

FROM_SEATS = (Waves, State, Power, Heartbeat, Leave)  # as a union it would be made anew for every datagram


class ServerCore:
    """`outbox` holds (address, message) to send, `events` what people should hear of, `dropped` counts by reason.

    new_session: gives a random session number from 1 to 2^63 - 1 (its source is the caller's: no chance in here).
    new_ticket: gives a secret that opens the seat again; without it nobody can come back.
    mark: what is kept of a ticket in its place.
    """

    def __init__(
        self,
        rooms: Sequence[Settings],
        software: str,
        new_session: Callable[[], int],
        authenticator: Authenticator | None = None,
        new_ticket: Callable[[], str] = str,
        mark: Callable[[str], str] = str,
    ) -> None:
        self.rooms = [Room(settings) for settings in rooms]
        self._software = software
        self._new_session = new_session
        self._authenticator = authenticator or AdmitAll()
        self._new_ticket = new_ticket
        self._mark = mark
        self._seated: dict[Address, tuple[Room, int]] = {}
        self._observing: dict[Address, tuple[Room, int]] = {}
        self._tickets: dict[int, str] = {}  # by session, for a welcome that has to be said again
        self.outbox: deque[tuple[Address, bytes]] = deque()
        self.events: deque[ServerEvent] = deque()
        self.dropped: dict[str, int] = {}

    def drop(self, reason: str, count: int = 1) -> None:
        self.dropped[reason] = self.dropped.get(reason, 0) + count

    def socket_failed(self, reason: str) -> None:
        """The socket refused to send or receive: counted as a drop."""
        self.drop(f"socket: {reason}")

    @property
    def addresses(self) -> list[Address]:
        """Of all who sit or look on, or did when their seat was last had."""
        return [*self._seated, *self._observing]

    def knows(self, address: Address) -> bool:
        """Whether somebody who sits or looks on here is at this address."""
        place = self._seated.get(address)
        return address in self._observing or (place is not None and place[0].seats[place[1]].state == "seated")

    def listens_to(self, address: Address) -> bool:
        """Whether what comes from this address is more than a stranger's: of a seat that was just left as well, whose
        goodbye may have to be said again."""
        return address in self._seated or address in self._observing

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> None:
        """Take in one message. Whatever does not belong is dropped and counted by name."""
        try:
            message = messages.decode(datagram)
        except messages.MalformedError:
            theirs = messages.foreign_version(datagram)
            if theirs is None:
                self.drop("malformed")
            elif len(datagram) < messages.HELLO_BYTES:
                self.drop("short hello")
            else:
                self._refuse(nonce_of(datagram), address, Denied(*version_mismatch(theirs)))
            return
        if isinstance(message, Hello):
            self._greet(message, len(datagram), address, now_ns)
            return
        place = self._seated.get(address)
        if place is not None:
            self._hear(place, message, now_ns)
        elif address in self._observing:
            self._hear_observer(self._observing[address], message, now_ns)
        else:
            self.drop("not seated")

    def _hear(self, place: tuple[Room, int], message: messages.AnyMessage, now_ns: int) -> None:
        room, number = place
        seat = room.seats[number]
        if not isinstance(message, FROM_SEATS):
            self.drop("unexpected")
            return
        if message.session != seat.session:
            self.drop("other session")
            return
        if isinstance(message, Leave):
            self._bid_farewell(room, number, message, now_ns)
            return
        if seat.state != "seated":  # our farewell was lost
            self._repeat_farewell(seat, now_ns)
            return
        rtt_ns = seat.clock.read(message.stamp, now_ns)
        if rtt_ns is not None:
            seat.rtt_ns = rtt_ns
        elif message.stamp.echo_ns:
            self.drop("wild stamp")
        if not isinstance(message, Heartbeat) and (seat.port is None or not seat.port.receive(message)):
            self.drop("unfit")  # it keeps no seat: whoever can bring nothing in is as silent
            return
        seat.last_received_ns = now_ns

    def _hear_observer(self, place: tuple[Room, int], message: messages.AnyMessage, now_ns: int) -> None:
        """An observer may say that it is there, and goodbye. Whoever sends more is shown out."""
        room, number = place
        observer = room.observer_slots.observers[number]
        if isinstance(message, FROM_SEATS) and message.session != observer.session:
            self.drop("other session")
        elif isinstance(message, Heartbeat):
            observer.last_received_ns = now_ns
            observer.clock.read(message.stamp, now_ns)
        elif isinstance(message, Leave):
            self._remove_observer(room, number, "goodbye", "left", f"left: {messages.shown(message.reason)}")
        elif isinstance(message, Frame):
            self.drop("observer's waves")
            reason = "an observer may not send waves: they were not applied; join with a player's link"
            self._remove_observer(room, number, reason, "kicked", f"was shown out: {reason}")
        else:
            self.drop("unexpected")

    def _remove_observer(self, room: Room, number: int, reason: str, event: str, words: str) -> None:
        observer = room.observer_slots.observers[number]
        room.observer_slots.leave(number)
        self._observing.pop(observer.address, None)
        self._tickets.pop(observer.session, None)
        self._tell(event, room, observer, words)
        farewell = Farewell(observer.session, messages.clipped(reason), None, room.account())
        self.outbox.append((observer.address, messages.encode(farewell)))

    def tick(self, room: Room, now_ns: int, frames: int = 1) -> None:
        """One step of one room; its messages go to the outbox."""
        for number in room.silent(now_ns):
            seat = room.seats[number]
            self._unlink(room, number)
            room.leave_seat(number, "silence")
            self.drop("seat timed out")
            self._tell("lost", room, seat, "has been silent for too long and lost the seat")
        for number in room.observer_slots.silent(now_ns):
            observer = room.observer_slots.observers[number]
            self._observing.pop(observer.address, None)
            self._tickets.pop(observer.session, None)
            room.observer_slots.leave(number)
            self._tell("lost", room, observer, "has been silent for too long")
        self.outbox.extend(room.tick(now_ns, frames))
        for seat in room.seats:
            adapter = seat.adapter
            if adapter is None:
                continue
            if adapter.told:
                self._tell("stiffness", room, seat, f"is told: {adapter.told}")
                adapter.told = ""
            if adapter.withheld:
                self.drop("stiffness word", adapter.withheld)
                adapter.withheld = 0

    def stop(self, reason: str) -> None:
        """Tell everyone goodbye; their accounts may still come (`awaits_accounts`)."""
        for room in self.rooms:
            for number in range(len(room.seats)):
                self._end_seat(room, number, "stop", reason)
            for number in list(room.observer_slots.observers):
                self._remove_observer(room, number, reason, "left", "was told that the server stops")

    def roster(self) -> list[tuple[Room, Seat | Observer]]:
        """Everybody who sits or looks on."""
        seated = [(room, seat) for room in self.rooms for seat in room.seats if seat.state == "seated"]
        return [*seated, *((room, each) for room in self.rooms for each in room.observer_slots.observers.values())]

    def kick(self, user: str, room: str = "", reason: str = "") -> int:
        """End the seats (or observers) of that name. Returns how many there were."""
        words = f"shown out by the server's keeper{': ' if reason else ''}{reason}"
        return self._end(lambda here, who: who.name == user and room in ("", here.name), words)

    def revoke(self, tokens: Iterable[str]) -> int:
        """End whatever was taken with one of these tokens (public ids). Returns how many there were."""
        gone = set(tokens)
        return self._end(lambda here, who: bool(who.token) and who.token in gone, "shown out: the token was revoked")

    def _unlink(self, room: Room, number: int) -> None:
        """A seat's address is no longer the seat's; it may be another's by now."""
        address = room.seats[number].address
        if self._seated.get(address) == (room, number):
            del self._seated[address]

    def _end(self, chosen: "Callable[[Room, Seat | Observer], bool]", reason: str) -> int:
        count = 0
        for room in self.rooms:
            for number, seat in enumerate(room.seats):
                if seat.state == "seated" and chosen(room, seat):
                    count += 1
                    self._end_seat(room, number, "kick", reason)
                    self._tell("kicked", room, seat, f"was {reason}")
                elif seat.state == "free" and seat.ticket and chosen(room, seat):
                    seat.ticket, seat.reserved_until_ns = "", None
            for number, observer in list(room.observer_slots.observers.items()):
                if chosen(room, observer):
                    count += 1
                    self._remove_observer(room, number, reason, "kicked", f"was {reason}")
        return count

    def _end_seat(self, room: Room, number: int, event: str, reason: str) -> None:
        seat = room.seats[number]
        account = room.leave_seat(number, event)
        if account is not None:
            self._tickets.pop(seat.session, None)
            seat.farewell = messages.encode(Farewell(seat.session, messages.clipped(reason), account, room.account()))
            self.outbox.append((seat.address, seat.farewell))

    def unbind_address(self, address: Address) -> None:
        """Somebody else speaks from this address now (a new seal): who sat here keeps the seat, and has to come back to it."""
        place = self._seated.pop(address, None)
        if place is not None:
            place[0].seats[place[1]].address = None
        looked = self._observing.pop(address, None)
        if looked is not None:
            looked[0].observer_slots.observers[looked[1]].address = None

    @property
    def awaits_accounts(self) -> bool:
        """True while someone whose seat was ended by `stop` has not said what they know."""
        return any(seat.last is not None and seat.account is None for room in self.rooms for seat in room.seats)

    def checkpoint(self) -> list[RoomCheckpoint]:
        """What a next server would have to know."""
        return [room.checkpoint() for room in self.rooms]

    def restore(self, checkpoint: RoomCheckpoint, now_ns: int) -> None:
        """Before anybody comes: go on from what the server before left. Raises CheckpointError, and nothing has changed."""
        room = next((room for room in self.rooms if room.name == checkpoint.room), self.rooms[0])
        room.restore(checkpoint, now_ns)
        kept = [seat.settings.user for seat in room.seats if seat.ticket]
        place = ", ".join(f"{value * 1e3:.1f}" for value in checkpoint.position_m)
        words = (
            f"{room.name}: restored: the object is at ({place}) mm, seats are kept for {', '.join(kept) or 'nobody'}"
        )
        self.events.append(ServerEvent("restored", words, room.name))

    def _refuse(self, nonce: int, address: Address, denied: Denied) -> None:
        self.drop(f"refused: {denied.code}")
        where = place_text(address)
        words = f"refused {where}: {denied.reason} [{denied.code}]"
        self.events.append(ServerEvent("refused", words, address=where, code=denied.code))
        self.outbox.append((address, refusal(nonce, denied.code, denied.reason)))

    def _greet(self, hello: Hello, size: int, address: Address, now_ns: int) -> None:
        if size < messages.HELLO_BYTES:
            self.drop("short hello")  # an answer may not be longer than the question
            return
        if self._greeted(hello, address, now_ns):
            return
        if hello.version != PROTOCOL_VERSION:
            self._refuse(hello.nonce, address, Denied(*version_mismatch(hello.version)))
            return
        if hello.ticket and self._resume(hello, address, now_ns):
            return
        grant = self._authenticator.admit(hello)
        if isinstance(grant, Denied):
            self._refuse(hello.nonce, address, grant)
        elif grant.role == "observer" or hello.role == "observer":
            self._give_observer_slot(hello, grant, address, now_ns)
        else:
            self._give_seat(hello, grant, address, now_ns)

    def _greeted(self, hello: Hello, address: Address, now_ns: int) -> bool:
        """Whether this is a hello that was answered, and the answer lost: it is said again. Or one too many."""
        place = self._seated.get(address)
        if place is not None:
            room, number = place
            seat = room.seats[number]
            if not seat.hellos.take(0, now_ns):
                self.drop("hello budget")
                return True
            if seat.nonce == hello.nonce and seat.state == "seated":
                self._welcome(room, seat)
                return True
            self._seated.pop(address)
            room.leave_seat(number, "silence")
        looked = self._observing.get(address)
        if looked is not None:
            room, number = looked
            observer = room.observer_slots.observers[number]
            if not observer.hellos.take(0, now_ns):
                self.drop("hello budget")
                return True
            if observer.nonce == hello.nonce:
                self._welcome_observer(room, observer)
                return True
            self._observing.pop(address)
            self._tickets.pop(observer.session, None)
            room.observer_slots.leave(number)
        return False

    def _resume(self, hello: Hello, address: Address, now_ns: int) -> bool:
        """To the seat that the ticket opens. False where it opens none."""
        mark = self._mark(hello.ticket)
        found = find_again(self.rooms, mark)
        if found is None:
            looked = find_observer(self.rooms, mark)
            if looked is None:
                return False
            room, number = looked
            observer = room.observer_slots.observers[number]
            if not observer.hellos.take(0, now_ns):
                self.drop("hello budget")
                return True
            self._observing.pop(observer.address, None)
            observer.address, observer.last_received_ns, observer.nonce = address, now_ns, hello.nonce
            observer.clock = Clock()
            self._observing[address] = room, number
            self._tell("resumed", room, observer, f"goes on from {place_text(address)}", address)
            self._welcome_observer(room, observer)
            return True
        room, number = found
        seat = room.seats[number]
        if not seat.hellos.take(0, now_ns):
            self.drop("hello budget")
            return True
        if not record_of(hello).is_of(seat.record):
            had = seat.record.device if seat.record else "another device"
            self._refuse(hello.nonce, address, Denied(
                "device", f"the seat was taken with {had}, and {hello.device} with another record is claimed; join anew",
            ))  # fmt: skip
            return True
        self._unlink(room, number)
        if seat.state == "seated":
            room.move(number, address, now_ns)
            seat.nonce = hello.nonce
        else:
            self._tickets.pop(seat.session, None)
            room.take_seat(number, self._new_session(), hello.nonce, address, now_ns, record_of(hello))
        self._tickets[seat.session] = hello.ticket
        self._seated[address] = (room, number)
        self._tell("resumed", room, seat, f"goes on from {place_text(address)}", address)
        self._welcome(room, seat)
        return True

    def _give_seat(self, hello: Hello, grant: Grant, address: Address, now_ns: int) -> None:
        found = find_seat(self.rooms, hello, grant, now_ns)
        if isinstance(found, Denied):
            self._refuse(hello.nonce, address, found)
            return
        room, number = found
        most = room.settings.admission.seats_per_token
        if grant.token and self._seats_of(grant.token) >= most:
            words = f"this token holds {most} seats already (admission.seats_per_token): ask for a link of your own"
            self._refuse(hello.nonce, address, Denied("token", words))
            return
        seat = room.seats[number]
        self._unlink(room, number)  # whoever sat here before
        self._tickets.pop(seat.session, None)
        room.take_seat(number, self._new_session(), hello.nonce, address, now_ns, record_of(hello))
        self._seated[address] = (room, number)
        seat.ticket = self._ticket(seat.session)
        seat.token = grant.token
        self._authenticator.admitted(grant)
        self._tell(
            "joined", room, seat, f"joined from {place_text(address)} with {messages.shown(hello.device)}", address
        )
        self._welcome(room, seat)

    def _seats_of(self, token: str) -> int:
        """How many seats are held by this token now."""
        return sum(seat.state == "seated" and seat.token == token for room in self.rooms for seat in room.seats)

    def _give_observer_slot(self, hello: Hello, grant: Grant, address: Address, now_ns: int) -> None:
        room = find_observer_slot(self.rooms, hello, grant)
        if isinstance(room, Denied):
            self._refuse(hello.nonce, address, room)
            return
        number = room.observer_slots.enter(self._new_session(), hello.nonce, address, now_ns)
        observer = room.observer_slots.observers[number]
        self._observing[address] = (room, number)
        observer.ticket = self._ticket(observer.session)
        observer.token = grant.token
        self._authenticator.admitted(grant)
        self._tell("observes", room, observer, f"looks on from {place_text(address)}", address)
        self._welcome_observer(room, observer)

    def _ticket(self, session: int) -> str:
        """A new ticket's mark; the ticket itself is kept until its holder is gone, to be said again."""
        ticket = self._tickets[session] = self._new_ticket()
        return self._mark(ticket)

    def _welcome(self, room: Room, seat: Seat) -> None:
        welcome = messages.Welcome(
            PROTOCOL_VERSION, seat.nonce, seat.session, room.digest, self._software, seat.settings,
            self._tickets.get(seat.session, ""),
        )  # fmt: skip
        self.outbox.append((seat.address, messages.encode(welcome)))

    def _welcome_observer(self, room: Room, observer: Observer) -> None:
        shown = msgspec.structs.replace(room.seats[0].settings, user=observer.name)
        welcome = messages.Welcome(
            PROTOCOL_VERSION, observer.nonce, observer.session, room.digest, self._software, shown,
            self._tickets.get(observer.session, ""), "observer",
        )  # fmt: skip
        self.outbox.append((observer.address, messages.encode(welcome)))

    def _bid_farewell(self, room: Room, number: int, leave: Leave, now_ns: int) -> None:
        seat = room.seats[number]
        account = room.leave_seat(number, "leave")
        if seat.account is None:
            seat.account = leave.account
        if account is None:
            self._repeat_farewell(seat, now_ns)
            return
        self._tell("left", room, seat, f"left: {messages.shown(leave.reason)}")
        # the seat keeps its address until the next hello, so that a repeated leave is answered again
        seat.farewell = messages.encode(Farewell(seat.session, "goodbye", account, room.account()))
        seat.farewell_ns = now_ns
        self.outbox.append((seat.address, seat.farewell))

    def _repeat_farewell(self, seat: Seat, now_ns: int) -> None:
        """As it was said first, and not at every word: to make one up takes its time."""
        if seat.farewell and now_ns - seat.farewell_ns >= FAREWELL_EVERY_NS:
            seat.farewell_ns = now_ns
            self.outbox.append((seat.address, seat.farewell))
        else:
            self.drop("said goodbye")

    def _tell(self, event: str, room: Room, who: Seat | Observer, words: str, address: Address = None) -> None:
        where = place_text(address) if address is not None else ""
        self.events.append(
            ServerEvent(event, f"{room.name}: {who.name} {words}", room.name, who.name, where, token=who.token)
        )
