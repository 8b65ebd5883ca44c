"""A worker's port: a socket for each of its people, and the front for all who have none yet.

Where it is compiled, all is sent by the front's socket, many datagrams in a system call: the address that they come from is
the same.
"""

import socket
from collections import Counter, deque
from collections.abc import Sequence
from contextlib import suppress

from cogrip.protocol.channel import Address
from cogrip.protocol.io.datagrams import open_arrivals, open_batched
from cogrip.protocol.io.dtls_session import DtlsSession, SessionKeys
from cogrip.protocol.io.receive_buffer import overrun
from cogrip.protocol.io.stop import Stop
from cogrip.server.io.platform import Readable
from cogrip.server.io.workers.link import (
    AnyToWorker,
    Ask,
    End,
    Forget,
    Link,
    Obey,
    Path,
    PeerAddress,
    Stray,
    Void,
)  # fmt: skip
from cogrip.server.io.workers.orders import LinkOrders
from cogrip.server.io.workers.verdicts import FrontVerdicts

TRIED_EVERY_NS = 4_000_000  # half a frame of 128 Hz: from one round without asking the kernel to the next
MOST_ADDRESSES = 4096


class OpenPath:
    """One path. session: None without encryption. seated_ns: when its peer was last seen with a seat.

    sender: the peer's address as it came with the last datagram
    """

    __slots__ = ("address", "arrivals", "seated_ns", "sender", "session", "socket")

    def __init__(self, address: PeerAddress, owned: socket.socket, keys: SessionKeys | None, now_ns: int) -> None:
        owned.setblocking(False)
        self.address, self.socket = address, owned
        self.sender: Address = None
        self.arrivals = open_arrivals(owned)
        self.session = None if keys is None else DtlsSession(keys)
        self.seated_ns = now_ns


class WorkerPort:
    """`DatagramPort` of a worker.

    paths       by the peer's address
    from_front  what `receive` returned last is a message, which the front has decrypted
    arrived_ns  when it came
    renewed     addresses whose path is over, as somebody has made a new association from there
    """

    def __init__(
        self, link: Link, stop: Stop, verdicts: FrontVerdicts, orders: LinkOrders, public: socket.socket | None = None
    ) -> None:
        """public: the front's socket, to send by."""
        self.paths: dict[Address, OpenPath] = {}
        self.from_front = False
        self.arrived_ns = 0
        self.renewed: deque[Address] = deque()
        self.dropped: Counter[str] = Counter()
        self._link, self._stop, self._verdicts, self._orders = link, stop, verdicts, orders
        self._by_descriptor: dict[int, OpenPath] = {}
        self._front = link.socket.fileno()
        self._readable = Readable()
        self._readable.add(self._front)
        self._waiting: list[int] = []  # descriptors
        self._busy: dict[int, None] = {}  # those from which something has come since they were tried; when that was:
        self._tried_ns, self._looked = 0, True  # the second: the kernel has been asked since
        self._addresses: dict[PeerAddress, PeerAddress] = {}  # as they were told first
        self._asked = False  # the message before came with a verdict
        self._overran = 0
        self._batched = None if public is None else open_batched(public)

    def receive(self, most_bytes: int, now_ns: int) -> tuple[bytes, Address, int]:
        """Return one datagram of each path that has some, in turn, and what the front has sent."""
        if self._asked:
            self._asked = False
            self._verdicts.newest = None  # it is of the message before, which nothing else may use it for
        looked = False
        while self._waiting or not looked:
            if not self._waiting:
                looked = self._look(now_ns)
                continue
            ready = self._waiting.pop()
            path = self._by_descriptor.get(ready)
            try:
                if ready == self._front:
                    datagram, address, self.arrived_ns = self._take_of_front(now_ns)
                    self._waiting.append(ready)  # there may be more, and it comes first
                    return datagram, address, self.arrived_ns
                if path is None:
                    continue
                datagram, sender, self.arrived_ns = path.arrivals.receive(most_bytes, now_ns)
            except BlockingIOError:
                continue
            if sender is not path.sender:
                if sender != path.address and tuple(sender[:2]) != path.address[:2]:
                    self.dropped["of another peer"] += 1  # it came before the path was connected
                    continue
                path.sender = sender
            self._busy[ready] = None
            return datagram, path.address, self.arrived_ns
        raise BlockingIOError

    def _look(self, now_ns: int) -> bool:
        """Set where to receive from, in turn. Return whether the kernel was asked: else it is where something came lately.

        To ask costs as much as half a receive, and in most frames something has come from everybody. It is asked between two
        such rounds at least: the front, and whoever was quiet, have their turn where each round takes longer than a drain may.
        """
        self._looked = not (self._looked and self._busy and now_ns - self._tried_ns >= TRIED_EVERY_NS)
        if self._looked:
            self._waiting = self._readable.ready()
        else:
            self._waiting, self._tried_ns = list(self._busy), now_ns
            self._busy.clear()
        return self._looked

    def send(self, datagram: bytes, address: Address) -> None:
        """Send a datagram by a path; one whose path has gone meanwhile is counted."""
        if path := self.paths.get(address):
            path.socket.send(datagram)
        else:
            self.dropped["path has gone"] += 1

    def send_all(self, outbox: deque[tuple[Address, bytes]]) -> list[str]:
        """Send all (address, datagram) of a queue, and return for each that the system refused why it did."""
        if self._batched is not None:
            return self._batched.send_all(outbox)
        refused = []
        while outbox:
            address, datagram = outbox.popleft()
            try:
                self.send(datagram, address)
            except OSError as error:
                refused.append(str(error.strerror))
        return refused

    def overruns(self) -> int:
        """Return the datagrams that the kernel dropped for want of room, of all paths so far."""
        return self._overran + sum(overrun(path.socket) for path in self.paths.values())

    def close(self) -> None:
        """Close all paths."""
        for address in list(self.paths):
            self.drop(address)
        self._readable.close()

    def _take_of_front(self, now_ns: int) -> tuple[bytes, Address, int]:
        """Return the next datagram or message of the front, and when it came; do what else it says.

        Raises BlockingIOError, LinkEndedError.
        """
        while True:
            given, descriptors = self._link.take_at_worker()
            if isinstance(given, Ask):
                self._verdicts.newest = given.verdict
                self.from_front = self._asked = True
                return given.message, self._same(given.address), min(given.arrived_ns, now_ns)
            if isinstance(given, Stray):
                return given.datagram, given.address, now_ns
            self._follow(given, descriptors, now_ns)

    def _same(self, address: PeerAddress) -> PeerAddress:
        """Return the equal address that was told first: what is the same object is found faster, several times a frame."""
        if len(self._addresses) >= MOST_ADDRESSES:
            self._addresses.clear()
        return self._addresses.setdefault(address, address)

    def _follow(self, given: AnyToWorker, descriptors: Sequence[int], now_ns: int) -> None:
        match given:
            case Path() if descriptors:
                self.drop(given.address)
                address = self._same(given.address)
                path = OpenPath(address, socket.socket(fileno=descriptors[0]), given.keys, now_ns)
                self.paths[address] = self._by_descriptor[path.socket.fileno()] = path
                self._readable.add(path.socket.fileno())
            case Forget():
                self.drop(given.address)
                self.renewed.append(given.address)
            case Obey():
                self._orders.add(given.number, given.order)
            case Void():
                self._verdicts.void(given.revoked, given.expired)
            case End():
                self._stop.reason = self._stop.reason or given.reason

    def drop(self, address: Address) -> None:
        """Close a path."""
        if path := self.paths.pop(address, None):
            with suppress(OSError):
                self._overran += overrun(path.socket)
            del self._by_descriptor[path.socket.fileno()]
            path.socket.close()  # which ends its being watched
