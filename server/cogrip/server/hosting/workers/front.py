"""Front process of a server with several workers: it has the public socket and the tokens, and no room.

    datagram of an unknown peer --handshake--> message --hello: verdict, room--> its worker --welcome--> a path of its own
    datagram of a seated peer: the kernel gives it to the worker; one that is here already goes after it as a stray

A worker that ends takes its paths with it: its people resume with a new handshake, here, in the worker that has their rooms
by then.
"""

import selectors
import socket
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from cogrip.machine.stop import Stop
from cogrip.protocol.io.dtls_session import SessionKeys
from cogrip.protocol.secure.channel import Address
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.texts import named
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import PROTOCOL_VERSION, Hello, MalformedError, Welcome
from cogrip.server.admission.admission import Authenticator, Denied, Grant
from cogrip.server.events import ServerEvent
from cogrip.server.hosting.link import (
    Answered,
    AnyToFront,
    Ask,
    Astray,
    EndRooms,
    Forget,
    HelloByPath,
    LinkEndedError,
    NewSnapshot,
    Path,
    PeerAddress,
    Ready,
    Released,
    RevokeToken,
    RoomOnDemand,
    Say,
    SeatGiven,
    Stray,
)  # fmt: skip
from cogrip.server.hosting.public_socket import FrontChannel as FrontChannel
from cogrip.server.hosting.public_socket import PublicSocket
from cogrip.server.hosting.workers.pool import Worker, WorkerPool
from cogrip.server.hosting.workers.steering import Steering, open_path
from cogrip.server.io.dtls_channel import DtlsListener
from cogrip.server.snapshot import decode

ASKED_NS = 1_000_000_000  # longest wait for a worker's answer about a hello, which it gives at its next tick
DEATHS_NS, MOST_DEATHS = 10_000_000_000, 10
DYING = "stopped (the workers die again and again)"


class Seated(NamedTuple):
    """A peer that a worker has. user: "" of an observer. token: public id."""

    worker: Worker
    room: str
    user: str
    token: str


class Waiting(NamedTuple):
    """A hello that waits for the answer to another one with the same token. by: worker by whose path it came, if one."""

    message: bytes
    token: str
    by: Worker | None
    arrived_ns: int
    since_ns: int


class Front(PublicSocket):
    """Front of some rooms. open_channel: returns the channel, given what says whether an address has a path or has asked.

    seated: peers with a path
    """

    def __init__(
        self, public: socket.socket, rooms: Sequence[Settings], pool: WorkerPool, stop: Stop,
        say: Callable[[ServerEvent], None], open_channel: Callable[[Callable[[Address], bool]], FrontChannel],
        authenticator: "Authenticator | None" = None, steering: Steering | None = None,
        templates: Mapping[str, Settings] = MappingProxyType({}),
    ) -> None:  # fmt: skip
        """steering: None where each path is a socket of its own. templates: settings of rooms on demand."""
        # worker, token, when, and room, of hellos without an answer
        self._asking: dict[Address, tuple[Worker, str, int, str]] = {}
        self._templates = templates
        self._waiting: dict[PeerAddress, Waiting] = {}  # newest of each address, in their order
        channel = open_channel(lambda address: address in self._asking)
        super().__init__(public, rooms, pool, stop, say, channel, authenticator)
        self.pool = pool
        self._steering = steering
        self.seated: dict[Address, Seated] = {}
        self._deaths: deque[int] = deque(maxlen=MOST_DEATHS)
        for worker in pool.workers:
            self._watch(worker)

    def drops(self) -> dict[str, int]:
        """Return the drop counts by reason: of kernel, channel, links and front."""
        counts = Counter(super().drops())
        for worker in self.pool.workers:
            counts += worker.link.dropped
        return dict(counts)

    def rooms_of(self, user: str) -> set[str]:
        """Return the rooms where this person has a seat."""
        return {each.room for each in self.seated.values() if each.user == user}

    def await_ready(self, limit_s: float) -> bool:
        """Return whether all workers serve their rooms within this time; then start the spare. Raises OSError.

        Whoever comes meanwhile makes the handshake, and has a seat once that room is there, without waiting for the others.
        """
        until_s = time.monotonic() + limit_s
        while not self._all_ready():
            if self._stop.reason or self.pool.replaced or time.monotonic() >= until_s:
                return False
            self._turn()
        self._watch(self.pool.add())
        return True

    def _all_ready(self) -> bool:
        return all(worker.state == "ready" for worker in self.pool.workers if worker.rooms)

    def _watch(self, worker: Worker) -> None:
        self._selector.register(worker.link.socket, selectors.EVENT_READ, worker)

    def run(self, seconds: float | None = None) -> None:
        """Serve until stopped, at most for `seconds`."""
        super().run(seconds)
        for worker in self.pool.workers:
            worker.link.send(EndRooms(self._stop.reason))

    def _poll(self, now_ns: int) -> None:
        self._asking = {at: each for at, each in self._asking.items() if now_ns - each[2] < ASKED_NS}
        for at in [at for at, each in self._waiting.items() if now_ns - each.since_ns >= ASKED_NS]:
            del self._waiting[at]
            self.dropped["token is asked about"] += 1  # whoever is there says hello again
        for token in {each.token for each in self._waiting.values()}:
            self._ask_next(token, now_ns)

    def _wait(self, limit_s: float) -> None:
        """Take in what has come, of workers first."""
        ready = self._selector.select(limit_s)
        for key, _ in ready:
            if key.data is not None:
                self._take_of(key.data)
        if any(key.data is None for key, _ in ready):
            self._drain()
        if self._steering is not None:
            self._steering.refresh()
        self._flush()
        self._report()

    def _arrived(self, datagram: bytes, address: PeerAddress, now_ns: int, arrived_ns: int) -> None:
        if seated := self.seated.get(address):
            seated.worker.link.send(Stray(address, datagram))
        else:
            self._take(datagram, address, now_ns, arrived_ns)

    def _take(self, datagram: bytes, address: PeerAddress, now_ns: int, arrived_ns: int) -> None:
        for message in self._channel.receive(datagram, address, now_ns):
            if seated := self._unseat(address):  # a new association, from the same address
                seated.worker.link.send(Forget(address))
            self._ask(message, address, now_ns, arrived_ns)
        self._channel.renewed.clear()  # nobody here has a seat

    def _ask(
        self, message: bytes, address: PeerAddress, now_ns: int, arrived_ns: int, by: Worker | None = None
    ) -> None:
        """Hand a message over to the worker that answers it. by: the one by whose path it came."""
        try:
            hello = messages.decode(message)
        except MalformedError:  # also a hello of another version, which every worker can refuse
            worker = next((each for each in self.pool.workers if each.state == "ready"), None)
            if worker is not None:
                worker.link.send(Ask(address, message, None, arrived_ns))
            return
        if not isinstance(hello, Hello):
            if asked := self._asking.get(address):
                asked[0].link.send(Ask(address, message, None, arrived_ns))
            else:
                self.dropped["not seated"] += 1
            return
        verdict = self._authenticator.admit(hello)
        if verdict is None:
            self.dropped["hello not judged yet"] += 1
            return
        token = verdict.token if isinstance(verdict, Grant) else ""
        anew = by is None and address not in self._asking and not hello.ticket and hello.version == PROTOCOL_VERSION
        if anew and isinstance(verdict, Denied):  # no worker has to judge a wrong token
            self._refuse(hello, verdict, address)
            return
        room = self.room_for(hello, verdict, {(each.room, each.user) for each in self.seated.values()})
        if isinstance(room, Denied):
            self._refuse(hello, room, address)
            return
        if isinstance(verdict, Grant) and (denied := self._too_many(token, room, address)):
            verdict = denied
        worker = self.pool.home(room)
        if worker is None:
            self.dropped["room not there yet"] += 1  # its worker has died: the hello comes again
        elif by not in (None, worker):
            self._refuse(hello, Denied("room", f"room {room!r} is reached by a new connection; join anew"), address)
        elif token and any(other != address and each[1] == token for other, each in self._asking.items()):
            self._waiting[address] = Waiting(
                message, token, by, arrived_ns, now_ns
            )  # the token may be good for one time
        else:
            self._waiting.pop(address, None)
            self._asking[address] = worker, token, now_ns, room
            shown = self._authenticator.shown(hello) if hello.ticket else None
            worker.link.send(Ask(address, message, verdict, arrived_ns, shown))

    def _ask_next(self, token: str, now_ns: int) -> None:
        """Ask about the hello that waits for this token, if none is asked about: many people may come by one link at once."""
        for address in [at for at, each in self._waiting.items() if each.token == token]:
            if any(each[1] == token for each in self._asking.values()):
                return
            waiting = self._waiting.pop(address)
            self._ask(waiting.message, address, now_ns, waiting.arrived_ns, waiting.by)

    def _too_many(self, token: str, room: str, address: Address) -> Denied | None:
        """Return a refusal where the token holds as many seats in other workers as it may in all."""
        settings = self.opened.get(room) or self.rooms[room]
        home, most = self.pool.home(room), settings.admission.seats_per_token
        others = [each for at, each in self.seated.items() if each.token == token and each.user and at != address]
        if not token or len(others) < most or all(each.worker is home for each in others):
            return None
        words = f"this token holds {most} seats already (admission.seats_per_token): ask for a link of your own"
        return Denied("token", words)

    def _send(self, message: bytes, address: Address) -> None:
        if address in self.seated:  # the worker has a path by now, and repeats what is needed
            self.dropped["path is the worker's"] += 1
        else:
            self._channel.send(message, address)

    def _take_of(self, worker: Worker) -> None:
        try:
            while True:
                self._follow(worker, worker.link.take_at_front())
        except BlockingIOError:
            pass
        except LinkEndedError:
            self._replace(worker)

    def _follow(self, worker: Worker, given: AnyToFront) -> None:
        now_ns = time.monotonic_ns()
        match given:
            case Ready():
                worker.state = "ready"
                for called, (group, _) in list(self.pool.opened.items()):
                    if group == worker.group and called not in worker.told:  # of the one before, without a checkpoint
                        self._close_room(called)
                text = f"worker {worker.number} (process {worker.process.pid}) serves {named(worker.rooms)}"
                self.say(ServerEvent("notice", text))
            case Say():
                asked = self._asking.get(given.address)
                self._answer(worker, given)
                if asked and asked[1]:
                    self._ask_next(asked[1], now_ns)
            case HelloByPath():
                self._ask(given.message, given.address, now_ns, given.arrived_ns, worker)
            case Astray():
                self._take_back(worker, given, now_ns)
            case Released():
                if self._is_at(given.address, worker):
                    self._unseat(given.address)
            case NewSnapshot():
                worker.snapshot = decode(given.snapshot)
            case _:
                self._follow_administration(worker, given)

    def _follow_administration(self, worker: Worker, given: AnyToFront) -> None:
        match given:
            case SeatGiven():
                self._authenticator.admitted(given.grant)
            case RevokeToken():
                self.revoke(given.token)
            case Answered():
                self.answered(given)
            case RoomOnDemand():
                self._follow_room(worker, given)

    def _follow_room(self, worker: Worker, given: RoomOnDemand) -> None:
        """Take in that a room was opened, or is about to be closed: its links are then void."""
        if given.is_open:
            worker.told.add(given.called)
            self.pool.opened[given.called] = worker.group, given.template
            self.opened[given.called] = self._templates[given.template]
        elif given.called in self.pool.opened:
            self._close_room(given.called)

    def _close_room(self, called: str) -> None:
        del self.pool.opened[called], self.opened[called]
        self.revoke_room(called)

    def _is_at(self, address: Address, worker: Worker) -> bool:
        """Return whether a peer has its seat at this worker."""
        seated = self.seated.get(address)
        return seated is not None and seated.worker is worker

    def _take_back(self, worker: Worker, given: Astray, now_ns: int) -> None:
        """Take in what came to a worker and is not its: a handshake, or a datagram without a path there."""
        if self._is_at(given.address, worker) and not isinstance(self._channel, DtlsListener):
            worker.link.send(Stray(given.address, given.datagram))  # it was faster than its path
        else:
            self._take(given.datagram, given.address, now_ns, now_ns)

    def _answer(self, worker: Worker, said: Say) -> None:
        """Send a worker's message; with a welcome the peer gets a path to it."""
        address = said.address
        asked = self._asking.pop(address, None)
        message = messages.decode(said.message)
        if not isinstance(message, Welcome):
            self._send(said.message, address)
            return
        keys = None
        if isinstance(self._channel, DtlsListener):
            keys = self._channel.hand_over(address, said.message)
            if keys is None:
                return  # the association has ended: whoever it was says hello again
        else:
            self._channel.send(said.message, address)
        self._flush()  # before the worker's first datagram
        if self._open_path(worker, address, keys):
            settings = message.settings
            user = settings.user if message.role == "player" else ""
            room, token = (asked[3], asked[1]) if asked else (settings.room, "")
            self.seated[address] = Seated(worker, room, user, token)

    def _open_path(self, worker: Worker, address: PeerAddress, keys: SessionKeys | None) -> bool:
        """Let a worker have a peer's datagrams from now on. Return False, with a count, where it cannot."""
        if self._steering is not None and self._steering.add(address, worker.group):
            if worker.link.send(Path(address, keys, True)):
                return True
            self._steering.remove(lambda each: each == address)
            return False
        try:
            with open_path(self._public, address) as path:
                return worker.link.send(Path(address, keys, False), [path.fileno()])
        except OSError as error:
            self.dropped[f"path: {error.strerror}"] += 1
            return False

    def _unseat(self, address: Address) -> Seated | None:
        """Take in a peer's datagrams again. Return what it was."""
        seated = self.seated.pop(address, None)
        if seated and self._steering is not None:
            self._steering.remove(lambda each: each == address)
        return seated

    def _replace(self, worker: Worker) -> None:
        """Let another process have the rooms of a worker that has ended."""
        self._selector.unregister(worker.link.socket)
        if self._stop.reason:
            return
        now_ns = time.monotonic_ns()
        if len(self._deaths) == MOST_DEATHS and now_ns - self._deaths[0] < DEATHS_NS:
            self._stop.reason = DYING
            return
        self._deaths.append(now_ns)
        before = set(self.pool.workers)
        rooms = self.pool.replace(worker)
        for added in set(self.pool.workers) - before:
            self._watch(added)
        if self._steering is not None:
            lost = {at for at, each in self.seated.items() if each.worker is worker}
            self._steering.remove(lambda each: each in lost)
        self.seated = {at: each for at, each in self.seated.items() if each.worker is not worker}
        self._asking = {at: each for at, each in self._asking.items() if each[0] is not worker}
        self._waiting = {at: each for at, each in self._waiting.items() if each.by is not worker}
        if rooms:
            text = f"worker {worker.number} has ended; another one goes on with {named(rooms)}"
            self.say(ServerEvent("trouble", text))


def shares(rooms: Sequence[str], workers: int) -> list[list[str]]:
    """Return the rooms of each worker: in turn, so that rooms that are used together are divided."""
    return [list(rooms[number::workers]) for number in range(workers)]
