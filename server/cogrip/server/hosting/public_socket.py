"""Public socket of a server whose rooms other processes serve: the channel to unauthenticated peers, and what it drops."""

import selectors
import socket
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence, Set
from contextlib import suppress
from typing import Protocol

from cogrip.machine.arrivals import Arrivals
from cogrip.machine.receive_buffer import OVERRUN, overrun
from cogrip.machine.stop import Stop
from cogrip.protocol.secure.channel import Address, Channel, place_text
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.wire.messages import MAX_DATAGRAM_BYTES, Hello
from cogrip.protocol.wire.session import SECONDS_OVER, refusal
from cogrip.server.admission.admission import AdmitAll, Authenticator, Denied, Grant
from cogrip.server.events import UNAUTHENTICATED_EVENTS, ServerEvent
from cogrip.server.hosting.link import Answered, PeerAddress
from cogrip.server.hosting.placement import Homes
from cogrip.server.rate_limit import Buckets, Budget

POLL_EVERY_NS = 50_000_000
MOST_AT_ONCE = 256  # most datagrams between two looks at the workers
REPORTED = Budget(1, 40)


class FrontChannel(Channel, Protocol):
    """Channel of the front: `DtlsListener` or `UnencryptedListener`."""

    renewed: deque[Address]
    events: deque[ServerEvent]


class PublicSocket:
    """Front of some rooms, wherever they run.

    opened    settings of each room that was opened on demand, by the name that it has now
    homes     processes that serve them
    chores    called some 20 times a second with the time [ns]
    answered  called with the number of an order and its answer; revoke: with the id of a token that a room revokes;
              revoke_room: with the name of a room that is closed
    """

    def __init__(
        self, public: socket.socket, rooms: Sequence[Settings], homes: Homes, stop: Stop, say: Callable[[ServerEvent], None],
        channel: FrontChannel, authenticator: "Authenticator | None" = None,
    ) -> None:  # fmt: skip
        self.rooms = {room.name: room for room in rooms}
        self.opened: dict[str, Settings] = {}
        self.homes = homes
        self.chores: list[Callable[[int], None]] = []
        self.answered: Callable[[Answered], None] = lambda answer: None
        self.revoke: Callable[[str], None] = lambda token: None
        self.revoke_room: Callable[[str], None] = lambda room: None
        self.dropped: Counter[str] = Counter()
        self.received = 0
        self.sent = 0
        self._public, self._stop, self.say, self._channel = public, stop, say, channel
        self._arrivals = Arrivals(public)
        self._authenticator = authenticator or AdmitAll()
        self._selector = selectors.DefaultSelector()
        self._selector.register(public, selectors.EVENT_READ)
        self._budget = Buckets(len(UNAUTHENTICATED_EVENTS), REPORTED)
        self._poll_ns = 0

    def drops(self) -> dict[str, int]:
        """Return the drop counts by reason: of kernel, channel and front."""
        counts = self.dropped + Counter(self._channel.dropped)
        with suppress(OSError):
            counts += Counter({OVERRUN: overrun(self._public)})
        return dict(counts)

    def rooms_of(self, user: str) -> set[str]:
        """Return the rooms where this person has a seat."""
        raise NotImplementedError

    def run(self, seconds: float | None = None) -> None:
        """Serve until stopped, at most for `seconds`."""
        end_ns = None if seconds is None else time.monotonic_ns() + round(seconds * 1e9)
        while not self._stop.reason:
            if end_ns is not None and time.monotonic_ns() >= end_ns:
                self._stop.reason = f"stopped ({SECONDS_OVER})"
            self._turn()

    def _turn(self) -> None:
        """Wait for what comes next, at most until a look at channel and chores is due."""
        self._wait(POLL_EVERY_NS * 1e-9)
        now_ns = time.monotonic_ns()
        if now_ns >= self._poll_ns:
            self._poll_ns = now_ns + POLL_EVERY_NS
            self._channel.poll(now_ns)
            self._poll(now_ns)
            for chore in self.chores:
                chore(now_ns)
            self._flush()

    def _poll(self, now_ns: int) -> None:
        """Forget what has become old."""

    def _wait(self, limit_s: float) -> None:
        """Take in what has come."""
        if self._selector.select(limit_s):
            self._drain()
        self._flush()
        self._report()

    def _arrived(self, datagram: bytes, address: PeerAddress, now_ns: int, arrived_ns: int) -> None:
        """Take in a datagram. arrived_ns: when it came, which is long before now where this process stood still."""
        raise NotImplementedError

    def _drain(self) -> None:
        now_ns = time.monotonic_ns()
        for _ in range(MOST_AT_ONCE):
            try:
                datagram, address, arrived_ns = self._arrivals.receive(MAX_DATAGRAM_BYTES + 1, now_ns)
            except BlockingIOError:
                return
            except OSError as error:
                self.dropped[f"socket: {error.strerror}"] += 1
                continue
            self.received += 1
            self._arrived(datagram, address, now_ns, arrived_ns)

    def room_for(self, hello: Hello, verdict: Grant | Denied, taken: Set[tuple[str, str]]) -> str | Denied:
        """Return the room that a hello is for: of those that it lets us choose the first with a seat that is free.

        taken: names of the seats that are not, with their rooms
        """
        grant = verdict if isinstance(verdict, Grant) else None
        wanted = hello.room or (grant.room if grant else "")
        if wanted:
            if wanted in self.rooms or wanted in self.opened:
                return wanted
            there = ", ".join(self.rooms) or "none"  # of those on demand nobody hears who has not been given the name
            none = Denied("room", f"there is no room {wanted!r} here; there is: {there}")
            return verdict if isinstance(verdict, Denied) else none
        name = hello.name or (grant.user if grant else "")
        with_name = [room for room in self.rooms.values() if not name or any(user.name == name for user in room.users)]
        for room in with_name:
            if any((room.name, user.name) not in taken and name in ("", user.name) for user in room.users):
                return room.name
        if not self.rooms:
            return Denied("room", "there are rooms on demand alone here; name the one that was opened")
        return (with_name or list(self.rooms.values()))[0].name

    def _refuse(self, hello: Hello, denied: Denied, address: PeerAddress) -> None:
        self.dropped[f"refused: {denied.code}"] += 1
        where = place_text(address)
        self._event(
            ServerEvent("refused", f"refused {where}: {denied.reason} [{denied.code}]", address=where, code=denied.code)
        )
        self._send(refusal(hello.nonce, denied.code, denied.reason), address)

    def _send(self, message: bytes, address: Address) -> None:
        self._channel.send(message, address)

    def _flush(self) -> None:
        outbox = self._channel.outbox
        while outbox:
            address, datagram = outbox.popleft()
            try:
                self._public.sendto(datagram, address)  # type: ignore[call-overload]  # addresses are the socket's own
                self.sent += 1
            except OSError as error:
                self.dropped[f"socket: {error.strerror}"] += 1

    def _report(self) -> None:
        while self._channel.events:
            self._event(self._channel.events.popleft())

    def _event(self, event: ServerEvent) -> None:
        """Say what unauthenticated peers can cause, a bounded number of times."""
        if self._budget.take(UNAUTHENTICATED_EVENTS.index(event.event), time.monotonic_ns()):
            self.say(event)
        else:
            self.dropped[f"event not said: {event.event}"] += 1
