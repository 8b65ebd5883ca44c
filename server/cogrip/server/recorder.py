"""A server core that notes every call and everything that comes of it: the same core, live, in virtual time, in replay.

What is noted stands in the order in which it happened; a step is noted after the datagrams that it sent. Steps of a room
where nobody sits are counted, and noted as one before anything else happens: a daemon that waits writes nothing.
"""

import json
from collections.abc import Callable, Iterable, Sequence

import msgspec

from cogrip.protocol.accounts import TickCount
from cogrip.protocol.channel import Address
from cogrip.protocol.messages import Hello
from cogrip.protocol.recording.records import Asked, Command, Datagram, Event, Ledger, SeatStep, Step
from cogrip.protocol.recording.secrets import without_secrets
from cogrip.protocol.recording.sink import Held, Nowhere, ObservedQueue, Sink, encode, topics
from cogrip.protocol.settings import Settings
from cogrip.server.admission import AdmitAll, Authenticator, Denied, Grant
from cogrip.server.checkpoint import RoomCheckpoint
from cogrip.server.checkpoint import encode as encode_checkpoint
from cogrip.server.core import ServerCore
from cogrip.server.events import ServerEvent
from cogrip.server.room import Room

WHO = "server"
KINDS = ("datagram_in", "datagram_out", "command", "asked", "event", "account", "gap", "clock")
MOST_TEXTS = 4096
DATAGRAM_IN, DATAGRAM_OUT, COMMAND, ASKED, EVENT, ACCOUNT = range(6)


def server_topics(rooms: Sequence[str]) -> tuple[str, ...]:
    """Topics of a server's recording: its own, then the steps of each room."""
    return topics(WHO, KINDS) + tuple(step_topic(room) for room in rooms)


def step_topic(room: str) -> str:
    """Where the steps of a room are."""
    return f"/room/{room}/step"


class RecordedServer(ServerCore):
    """Messages are held until `record` says where they go. `timing` of a room is the driver's: see `Step`.

    Tokens and tickets are not noted (`cogrip.protocol.recording.secrets`).
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
        authenticator = RecordedAuthenticator(authenticator or AdmitAll(), self._granted)
        super().__init__(
            rooms, software, lambda: self._session(new_session), authenticator, lambda: self._new(new_ticket), mark
        )  # fmt: skip
        self.start = start_text(rooms, software)
        self.timing = {room.name: (0, 0, 0) for room in self.rooms}  # late [us], work [us], skipped
        self._held = Held()
        self._sink: Sink = self._held
        self._notes = True
        self._texts: dict[Address, str] = {}
        self._now_ns = 0
        self._rested: dict[str, int] = {}
        self._number = {room.name: len(KINDS) + number for number, room in enumerate(self.rooms)}
        self.outbox = ObservedQueue(self._sent)
        self.events = ObservedQueue(self._told)
        for room in self.rooms:
            self.count_ticks(room, room.ticks)

    def record(self, sink: Sink) -> None:
        """Give what was noted so far to `sink`, and all that follows."""
        self._sink = sink
        self._notes = not isinstance(sink, Nowhere)  # what nobody keeps need not be written out
        self._held.pour(sink)

    def count_ticks(self, room: Room, count: Callable[[], TickCount]) -> None:
        """From now on `count` tells how the loop of a room runs."""

        def asked() -> TickCount:
            ticks = count()
            self._put(ASKED, Asked(room.name, ticks=msgspec.json.encode(ticks).decode()))
            return ticks

        room.ticks = asked

    def _put(self, topic: int, record: msgspec.Struct) -> None:
        if self._notes:
            self._sink.put(topic, self._now_ns, encode(record))

    def note_rest(self) -> None:
        """Note the steps that were counted; before every call that comes from outside."""
        for room, steps in self._rested.items():
            self._put(COMMAND, Command("rest", room, steps))
        self._rested.clear()

    def _session(self, new_session: Callable[[], int]) -> int:
        session = new_session()
        self._put(ASKED, Asked(session=session))
        return session

    def _new(self, new_ticket: Callable[[], str]) -> str:
        ticket = new_ticket()
        self._put(ASKED, Asked(ticket=self._mark(ticket)))
        return ticket

    def _granted(self, answer: Grant | Denied) -> None:
        self._put(ASKED, Asked(grant=msgspec.json.encode(answer).decode()))

    def _text(self, address: Address) -> str:
        """`address_text`, of which there are few, and many datagrams."""
        text = self._texts.get(address)
        if text is None:
            if len(self._texts) >= MOST_TEXTS:
                self._texts.clear()
            text = self._texts[address] = address_text(address)
        return text

    def _sent(self, entry: tuple[Address, bytes]) -> None:
        if self._notes:
            self._put(DATAGRAM_OUT, Datagram(without_secrets(entry[1], self._mark), self._text(entry[0])))

    def _told(self, event: ServerEvent) -> None:
        self._put(EVENT, Event(event.text))

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> None:
        if self._rested:
            self.note_rest()
        self._now_ns = now_ns
        if self._notes:
            self._put(DATAGRAM_IN, Datagram(without_secrets(datagram, self._mark), self._text(address)))
        super().receive(datagram, address, now_ns)

    def socket_failed(self, reason: str) -> None:
        self.note_rest()
        self._put(COMMAND, Command("socket_failed", reason))
        super().socket_failed(reason)

    def stop(self, reason: str) -> None:
        self.note_rest()
        self._put(COMMAND, Command("stop", reason))
        super().stop(reason)

    def kick(self, user: str, room: str = "", reason: str = "") -> int:
        self.note_rest()
        self._put(COMMAND, Command("kick", json.dumps([user, room, reason])))
        return super().kick(user, room, reason)

    def revoke(self, tokens: Iterable[str]) -> int:
        gone = sorted(tokens)
        self.note_rest()
        self._put(COMMAND, Command("revoke", json.dumps(gone)))
        return super().revoke(gone)

    def unbind_address(self, address: Address) -> None:
        self.note_rest()
        self._put(COMMAND, Command("disown", address_text(address)))
        super().unbind_address(address)

    def restore(self, checkpoint: RoomCheckpoint, now_ns: int) -> None:
        self._now_ns = now_ns
        self._put(COMMAND, Command("restore", encode_checkpoint(checkpoint).decode()))
        super().restore(checkpoint, now_ns)

    def tick(self, room: Room, now_ns: int, frames: int = 1) -> None:
        if room.deserted:
            self._now_ns = now_ns
            self._rested[room.name] = self._rested.get(room.name, 0) + 1
            super().tick(room, now_ns, frames)
            return
        self.note_rest()
        self._now_ns = now_ns
        super().tick(room, now_ns, frames)
        if not self._notes:
            return
        world = room.world
        motion = world.motion()
        seats = tuple([_seat(room, number) for number in range(len(room.seats))])
        late_us, work_us, skipped = self.timing[room.name]
        self._put(self._number[room.name], Step(
            room.steps, motion[: world.axes], motion[world.axes :], seats,
            frames, late_us, work_us, skipped,
        ))  # fmt: skip

    def close_ledger(self) -> None:
        """Note what every room and seat knows at the end."""
        self.note_rest()
        self._put(COMMAND, Command("close_books"))
        for room in self.rooms:
            seats = [room.seat_account(number) for number in range(len(room.seats))]
            limited = [room.limited(number) for number in range(len(room.seats))]
            books = {
                "room": room.name, "account": room.account(), "seats": seats, "limited": limited, "dropped": self.dropped,
            }  # fmt: skip
            self._put(ACCOUNT, Ledger(msgspec.json.encode(books).decode()))


class RecordedAuthenticator:
    """A doorkeeper whose every answer is noted."""

    def __init__(self, authenticator: Authenticator, note: Callable[[Grant | Denied], None]) -> None:
        self._authenticator = authenticator
        self._note = note

    def admit(self, hello: Hello) -> Grant | Denied:
        answer = self._authenticator.admit(hello)
        self._note(answer)
        return answer

    def admitted(self, grant: Grant) -> None:
        self._authenticator.admitted(grant)


def _seat(room: Room, number: int) -> SeatStep:
    seat, world = room.seats[number], room.world
    port = seat.port
    if port is None:
        nothing = (0.0,) * world.axes
        return SeatStep(seat.settings.user, False, nothing, nothing, None, None, None, None, 0)
    return SeatStep(
        seat.settings.user, True, world.proxy_of(number), world.force_of(number),
        port.up_margin_j, seat.line_margin_j, port.used_j, port.made_j, port.lost,
        port.up_reserve.now_j, seat.line_reserve.now_j,
    )  # fmt: skip


def address_text(address: Address) -> str:
    """An address, text or a tuple as sockets give them, as JSON text."""
    return msgspec.json.encode(address).decode()


def address_of(text: str) -> Address:
    """The way back. Raises ValueError (msgspec's) for what is none."""
    return msgspec.json.decode(text, type=str | tuple[str | int, ...])


def start_text(rooms: Sequence[Settings], software: str) -> str:
    """What a server core is made from, as JSON text."""
    return json.dumps({"rooms": msgspec.to_builtins(rooms), "software": software})


def start_of(text: str) -> tuple[list[Settings], str]:
    """The way back. Raises ValueError (msgspec's among them) or KeyError for anything else."""
    table = json.loads(text)
    return msgspec.convert(table["rooms"], list[Settings]), str(table["software"])
