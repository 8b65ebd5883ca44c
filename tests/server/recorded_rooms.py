"""A recorded server called as the live loop calls it, and people of all kinds who talk to it."""

import math
import zlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import count

import msgspec

from cogrip.machine.tick_count import TickCount
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.recording.records import Input
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Hello, Leave, Stamp, Welcome
from cogrip.protocol.wire.session import LOST_NS, make_hello
from cogrip.server.admission.admission import AdmissionServices, Denied, Grant
from cogrip.server.inputs import CloseLedger, Idle, Kick, Revoke, ServerInput, Stop, UnbindAddress, decode
from cogrip.server.recorder import INPUT, KINDS, RecordedServer

from tests.recorded_end import Put, RecordedEnd, mangled, next_frame, well_formed

FRAME_NS = 1_000_000_000 // 128
STEP = len(KINDS)
ADDRESSES: list[str | tuple[str | int, ...]] = [
    ("127.0.0.1", 4001),
    ("127.0.0.1", 4002),
    ("::1", 4003, 0, 0),
    "person 3",
    ("10.0.0.7", 65535),
]
TICKET = "secret-of-a-seat-"
TOKEN = "secret-of-a-room-1234"
Word = tuple[int, str, int, float]  # who, what, which of that kind, how large


def a_room(name: str = "lab", people: str = "ab", **tables: object) -> Settings:
    return resolve({"name": name, "users": [{"name": person} for person in people], **tables})


class Tokens:
    """Lets a token in as what its first letter says, and answers "l" later; none as well."""

    def admit(self, hello: Hello) -> Grant | Denied | None:
        if hello.token.startswith("l"):
            return None
        if hello.token.startswith("w"):
            return Denied("token", "this token is not known")
        return Grant("observer" if hello.token.startswith("o") else "player", hello.token[:1])

    def shown(self, hello: Hello) -> str | None:
        return None if hello.token.startswith("w") else hello.token[:1]

    def admitted(self, grant: Grant) -> None:
        """Nothing is used up."""


class Server(RecordedEnd):
    role, who, file, rate_hz = "server", "server", "server.mcap", 128
    core: RecordedServer
    records_late = False  # a step, once its messages are sent

    def __init__(self, *rooms: Settings) -> None:
        self.rooms = rooms or (a_room(),)
        sessions, asked = count(2**63 - 1000), count(1)
        tickets = count(1)
        services = AdmissionServices(
            lambda: next(sessions), Tokens(), lambda: f"{TICKET}{next(tickets):05}",
            lambda ticket: f"hash{zlib.crc32(ticket.encode()):08x}",
        )  # fmt: skip
        core = RecordedServer(self.rooms, "test", services)
        super().__init__(core, core.topics)
        for room in self.core.rooms:  # the pacer of a live loop tells more every time
            self.core.count_ticks(room, lambda: TickCount(due=(number := next(asked)), run=number))
        self.now_ns = 1_000_000_000
        self.lines = [LineSender(self.rooms[0].object.axes, 4) for _ in ADDRESSES]
        self.session = [1 for _ in ADDRESSES]
        self.said: list[bytes] = [b""]
        self.tickets = [""]

    def ticks_in(self, noted: Sequence[Put]) -> int:
        """Return the number of steps, those of deserted rooms too."""
        inputs = [
            decode(msgspec.json.decode(payload, type=Input).value) for topic, _, payload in noted if topic == INPUT
        ]
        return sum(topic >= STEP for topic, *_ in noted) + sum(each.steps for each in inputs if isinstance(each, Idle))

    def hello(self, who: int, **changed: object) -> bytes:
        given: dict[str, object] = {
            "software": "test", "nonce": who + 1, "room": "", "name": "", "digest": "", "device": "sim:ideal", "axes": 3,
            "rate_hz": 1024.0,
        }  # fmt: skip
        ticket = str(changed.pop("ticket", ""))
        made = make_hello(**{**given, **changed})  # type: ignore[arg-type]
        return messages.padded(msgspec.structs.replace(made, ticket=ticket))

    def frame(self, who: int, value: float) -> bytes:
        """The next frame of this person's line up."""
        row, kind = (value,) * self.rooms[0].object.axes, self.rooms[0].coupling.kind
        stamp = Stamp(self.now_ns - 1, self.now_ns - 9_000_000, 2_000_000)
        return next_frame(self.lines[who], self.session[who], row, stamp, kind, up=True)

    def word(self, who: int, kind: str, number: int, value: float) -> bytes:
        """A datagram as it may arrive; `number` tells which of that kind."""
        row, session = (value,) * self.rooms[0].object.axes, self.session[who]
        made: dict[str, Callable[[], bytes]] = {
            "next": lambda: self.frame(who, value),
            "leave": lambda: messages.encode(Leave(session, "bored")),
            **self.hellos(who, number),
        }
        known = {**mangled(self.said, number), **well_formed(session, number, row, value)}
        datagram = made[kind]() if kind in made else known[kind]
        self.said.append(datagram)
        return datagram

    def hellos(self, who: int, number: int) -> dict[str, Callable[[], bytes]]:
        """Return the hellos of people who may join and of people who may not."""
        names = [user.name for room in self.rooms for user in room.users]
        ticket = self.tickets[-1 - number % len(self.tickets)]
        return {
            "hello": lambda: self.hello(who),
            "another hello": lambda: self.hello(who, nonce=number),
            "hello by name": lambda: self.hello(who, name=[*names, "nobody"][number % (len(names) + 1)]),
            "hello to a room": lambda: self.hello(
                who, room=[*(room.name for room in self.rooms), "attic"][number % 3 % 2]
            ),
            "other settings": lambda: self.hello(who, digest="other"),
            "too few axes": lambda: self.hello(who, axes=1),
            "too slow": lambda: self.hello(who, rate_hz=100.0),
            "newer": lambda: self.hello(who).replace(b"cogrip" + bytes([messages.PROTOCOL_VERSION]), b"cogrip\x63", 1),
            "short hello": lambda: self.hello(who)[:-1],
            "by token": lambda: self.hello(who, token=f"{'powl'[number % 4]}{TOKEN}", nonce=number + 50),
            "observes": lambda: self.hello(who, role="observer", token=f"p{TOKEN}"),
            "comes back": lambda: self.hello(who, ticket=ticket),
            "comes back with another device": lambda: self.hello(who, ticket=ticket, device="sim:phantom"),
        }

    def hear(self, *words: Word) -> None:
        for word in words:
            self.core.receive(self.word(*word), ADDRESSES[word[0]], self.now_ns)
        for address, datagram in self.core.outbox:
            if address is None:  # its seal is another's now
                continue
            with suppress(messages.MalformedError):  # of a room that went wild
                answer = messages.decode(datagram)
                if isinstance(answer, Welcome):
                    self.tickets.append(answer.ticket)
                    self._welcomed(ADDRESSES.index(address), answer.session)  # type: ignore[arg-type]
        self.core.outbox.clear()

    def handle(self, given: ServerInput) -> None:
        self.core.handle(given, self.now_ns)

    def _welcomed(self, who: int, session: int) -> None:
        if self.session[who] != session:
            self.session[who] = session
            self.lines[who] = LineSender(self.rooms[0].object.axes, 4)

    def tick(self, number: int, words: Sequence[Word] = (), frames: int = 1, later_ns: int = FRAME_NS) -> None:
        """Receive what came, then step a room."""
        self.now_ns += later_ns
        self.hear(*words)
        room = self.core.rooms[number % len(self.core.rooms)]
        self.core.timing[room.name] = (number, frames * 10, frames - 1)
        (self.core.step if self.records_late else self.core.tick)(room, self.now_ns, frames)
        self.core.events.clear()
        self.hear()

    def run(self, ticks: int, who: Sequence[int] = (0, 1)) -> None:
        """Some people swing, all rooms are stepped."""
        for step in range(ticks):
            words = [(each, "next", 0, 0.3 * math.sin(0.1 * step + each)) for each in who]
            for number in range(len(self.rooms)):
                self.tick(number, [] if number else words, later_ns=0 if number else FRAME_NS)


def scripted(records_late: bool = False) -> Server:
    """A session with every kind of message and every input, in two rooms."""
    server = Server(a_room("lab", "ab", object={"axes": 2}), a_room("hall", "z", object={"axes": 2}))
    server.records_late = records_late
    server.hear((0, "hello", 0, 0.0), (1, "hello", 0, 0.0), (1, "hello", 0, 0.0), (4, "newer", 0, 0.0))
    server.hear((2, "hello by name", 2, 0.0), (3, "hello", 0, 0.0), (4, "garbage", 7, 0.0))
    server.run(16, (0, 1, 2))
    server.tick(0, [(0, "again", 3, 0.0)], frames=3)
    server.run(6, (0,))
    server.hear((0, "leave", 0, 0.0), (0, "leave", 0, 0.0))
    server.tick(1, later_ns=LOST_NS + 1)
    server.hear((4, "hello by name", 0, 0.0))
    server.run(10, (1, 4))
    server.hear((2, "by token", 1, 0.0), (3, "by token", 2, 0.0))
    server.run(8, (1, 4))
    server.handle(UnbindAddress(ADDRESSES[1]))
    server.tick(0)
    server.hear((3, "comes back with another device", 1, 0.0), (3, "comes back", 1, 0.0))
    server.run(6, (3, 4))
    server.handle(Kick("b", "lab", "too rough"))
    server.hear((0, "observes", 0, 0.0), (2, "next", 0, 0.1))
    server.handle(Revoke(("p", "q")))
    server.tick(0)
    server.handle(Stop("the time is over"))
    server.hear((4, "leave", 0, 0.0))
    server.handle(CloseLedger())
    return server


SCRIPT = scripted()
