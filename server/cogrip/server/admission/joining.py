"""Answers to hellos: a seat, an observer slot, a session that is resumed, or a refusal."""

from msgspec.structs import replace

from cogrip.protocol.secure.channel import Address, place_text
from cogrip.protocol.texts import shown
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.messages import PROTOCOL_VERSION, Hello, Role, Welcome
from cogrip.protocol.wire.session import refusal, version_mismatch
from cogrip.server.admission.admission import AdmissionServices, Denied, Grant
from cogrip.server.admission.seat_assignment import SeatTable, find_observer_slot, find_seat
from cogrip.server.events import ServerEvent
from cogrip.server.outputs import Outputs
from cogrip.server.ports.seat_limits import record_of
from cogrip.server.room import Room
from cogrip.server.seats.participants import Observer, Seat


class Joining:
    """Admission to the rooms of one server core. Parameters: see `ServerCore`."""

    def __init__(self, table: SeatTable, outputs: Outputs, software: str, services: AdmissionServices) -> None:
        self._table = table
        self._out = outputs
        self._software = software
        self._services = services

    def refuse(self, nonce: int, address: Address, denied: Denied) -> None:
        """Send a refusal, and report it."""
        self._out.drop(f"refused: {denied.code}")
        where = place_text(address)
        text = f"refused {where}: {denied.reason} [{denied.code}]"
        self._out.events.append(ServerEvent("refused", text, address=where, code=denied.code))
        self._out.outbox.append((address, refusal(nonce, denied.code, denied.reason)))

    def answer(self, hello: Hello, size: int, address: Address, now_ns: int) -> None:
        """Answer a hello that came in a datagram of `size` bytes."""
        if size < messages.HELLO_BYTES:
            self._out.drop("short hello")  # an answer may not be longer than the request
        elif self._repeated(hello, address, now_ns):
            pass
        elif hello.version != PROTOCOL_VERSION:
            self.refuse(hello.nonce, address, Denied(*version_mismatch(hello.version)))
        elif not (hello.ticket and self._resumed(hello, address, now_ns)):
            grant = self._services.authenticator.admit(hello)
            if grant is None:
                self._out.drop("hello not judged yet")
            elif isinstance(grant, Denied):
                self.refuse(hello.nonce, address, grant)
            elif grant.role == "observer" or hello.role == "observer":
                self._give_observer_slot(hello, grant, address, now_ns)
            else:
                self._give_seat(hello, grant, address, now_ns)

    def _within_budget(self, who: Seat | Observer, now_ns: int) -> bool:
        if who.hellos.take(0, now_ns):
            return True
        self._out.drop("hello budget")
        return False

    def _repeated(self, hello: Hello, address: Address, now_ns: int) -> bool:
        """Repeat the welcome where only that was lost. Another hello from a known address ends the session there: False."""
        place = self._table.places.get(address)
        if place is None:
            return False
        room, who = place
        if not self._within_budget(who, now_ns):
            return True
        if who.nonce == hello.nonce and (isinstance(who, Observer) or who.state == "seated"):
            self._welcome(room, who)
            return True
        self._table.unbind(who)
        if isinstance(who, Seat):
            room.leave_seat(who.number, "silence")
        else:
            room.observer_slots.leave(who.number)
        return False

    def _resumed(self, hello: Hello, address: Address, now_ns: int) -> bool:
        """Resume the session of a ticket, from this address on. False where it is of none, or is shown without the token by
        which the session was admitted: it has no rights of its own.
        """
        place = self._table.by_ticket(self._services.hash_ticket(hello.ticket))
        if place is None:
            return False
        room, who = place
        if self._services.authenticator.shown(hello) != who.token:
            self._out.drop("ticket without its token")
            return False
        if who.address is not None and now_ns < who.asked_ns:
            self._out.drop("old hello")  # it was overtaken by one that came later, from where the person is now
            return True
        if not self._within_budget(who, now_ns):
            return True
        if isinstance(who, Observer):
            who.last_received_ns, who.clock = now_ns, MessageClock()
        elif record_of(hello) != who.record:
            had = who.record.device if who.record else "another device"
            self.refuse(hello.nonce, address, Denied(
                "device", f"the seat was taken with {had}, and {hello.device} with another record is claimed; join anew",
            ))  # fmt: skip
            return True
        elif who.state == "seated":
            room.resume_seat(who.number, now_ns)
        elif denied := self._too_many_seats(room, who.token):
            self.refuse(hello.nonce, address, denied)
            return True
        else:
            room.take_seat(who.number, self._services.new_session(), hello.nonce, now_ns, record_of(hello), who.hand)
        who.nonce, who.ticket, who.asked_ns = hello.nonce, hello.ticket, now_ns
        self._table.bind(room, who, address)
        self._out.report("resumed", room, who, f"resumed from {place_text(address)}", address)
        self._welcome(room, who)
        return True

    def _give_seat(self, hello: Hello, grant: Grant, address: Address, now_ns: int) -> None:
        found = find_seat(self._table.rooms, hello, grant, now_ns)
        if isinstance(found, Denied):
            self.refuse(hello.nonce, address, found)
            return
        room, seat = found
        if denied := self._too_many_seats(room, grant.token):
            self.refuse(hello.nonce, address, denied)
            return
        room.take_seat(seat.number, self._services.new_session(), hello.nonce, now_ns, record_of(hello))
        room.markers.begin(seat.number)
        words = f"joined from {place_text(address)} with {shown(hello.device)}"
        self._admit("joined", room, seat, grant, address, words)

    def _too_many_seats(self, room: Room, token: str) -> Denied | None:
        """Return a refusal where a token holds as many seats as the room lets it; None where one more may be taken."""
        most = room.settings.admission.seats_per_token
        if not token or self._table.count_by_token(token) < most:
            return None
        words = f"this token holds {most} seats already (admission.seats_per_token): ask for a link of your own"
        return Denied("token", words)

    def _give_observer_slot(self, hello: Hello, grant: Grant, address: Address, now_ns: int) -> None:
        room = find_observer_slot(self._table.rooms, hello, grant)
        if isinstance(room, Denied):
            self.refuse(hello.nonce, address, room)
            return
        observer = room.observer_slots.enter(self._services.new_session(), hello.nonce, now_ns)
        self._admit("observes", room, observer, grant, address, f"observes from {place_text(address)}")

    def _admit(
        self, event: str, room: Room, who: Seat | Observer, grant: Grant, address: Address, words: str
    ) -> None:  # fmt: skip
        self._table.bind(room, who, address)
        who.ticket, who.token = self._services.new_ticket(), grant.token
        who.ticket_hash = self._services.hash_ticket(who.ticket)
        self._services.authenticator.admitted(grant)
        self._out.report(event, room, who, words, address)
        self._welcome(room, who)

    def _welcome(self, room: Room, who: Seat | Observer) -> None:
        role: Role = "player" if isinstance(who, Seat) else "observer"
        settings = who.begins_with if isinstance(who, Seat) else replace(room.seats[0].begins_with, user=who.name)
        if room.template:
            settings = replace(settings, room=room.called)
        welcome = Welcome(
            PROTOCOL_VERSION, who.nonce, who.session, room.digest, self._software, settings, who.ticket, role
        )  # fmt: skip
        self._out.send(welcome, who.address)
