"""A worker's port: a socket to which its people are steered, and the front for all who are not yet.

Where the kernel steers nobody there is a socket for each of them. Where it is compiled all is sent by one socket, many
datagrams in a system call: the address that they come from is the same.
"""

import socket
from collections import Counter, deque
from collections.abc import Sequence
from contextlib import suppress

from cogrip.machine.addition import add_integers
from cogrip.machine.datagrams import open_arrivals, open_batched, open_datagrams
from cogrip.machine.platform import system
from cogrip.machine.receive_buffer import overrun
from cogrip.machine.stop import Stop
from cogrip.protocol.io.dtls_session import DtlsSession, SessionKeys
from cogrip.protocol.secure.channel import Address
from cogrip.server.hosting.link import (
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
from cogrip.server.hosting.workers.orders import LinkOrders
from cogrip.server.hosting.workers.verdicts import FrontVerdicts

MOST_ADDRESSES = 4096


class OpenPath:
    """One path. session: None without encryption. seated_ns: when its peer was last seen with a seat.

    socket, arrivals  None where the peer is steered to the worker's own socket
    sender            the peer's address as it came with the last datagram
    closed            its descriptor may be another file's by now
    """

    __slots__ = ("address", "arrivals", "closed", "seated_ns", "sender", "session", "socket")

    def __init__(self, address: PeerAddress, own: socket.socket | None, keys: SessionKeys | None, now_ns: int) -> None:
        self.address, self.socket = address, own
        self.sender: Address = None
        if own is not None:
            own.setblocking(False)
        self.arrivals = None if own is None else open_arrivals(own)
        self.session = None if keys is None else DtlsSession(keys)
        self.seated_ns = now_ns
        self.closed = False


class WorkerPort:
    """`DatagramPort` of a worker.

    paths       by the peer's address
    from_front  what `receive` returned last is a message, which the front has decrypted
    is_stray    it is a datagram that came to the front
    arrived_ns  when it came
    renewed     addresses whose path is over, as somebody has made a new association from there
    """

    def __init__(
        self, link: Link, stop: Stop, verdicts: FrontVerdicts, orders: LinkOrders, shared: socket.socket | None = None,
        own: bool = False,
    ) -> None:  # fmt: skip
        """shared: a socket at the public port, to send by. own: it is this worker's, and peers are steered to it."""
        self.paths: dict[Address, OpenPath] = {}
        self.from_front = self.is_stray = False
        self.arrived_ns = 0
        self.renewed: deque[Address] = deque()
        self.dropped: Counter[str] = Counter()
        self._link, self._stop, self._verdicts, self._orders = link, stop, verdicts, orders
        self._front_has_said = system.arrival_check(link.socket)
        self._drain_ns = -1  # when the drain began that goes on; -1: it has come to its end
        self._ask_front = self._ask_own = self._begun = self._own_first = False
        self._untried: list[OpenPath] = []  # from the last one on
        self._tried: list[OpenPath] = []  # of which something came: they have another turn after all others
        self._addresses: dict[PeerAddress, PeerAddress] = {}  # as they were told first
        self._asked = False  # the message before came with a verdict
        self._overran = 0 if shared is None or not own else -overrun(shared)  # of the worker that had it before
        self._shared, self._own = shared, shared if own else None
        self._ends = None if shared is None else open_datagrams(shared) if own else open_batched(shared)

    def receive(self, most_bytes: int, now_ns: int) -> tuple[bytes, Address, int]:
        """Return what the front has sent, then one datagram of each path that has some, in turn.

        now_ns: the same during a drain. Raises BlockingIOError, at the end of each, once no path has anything left.
        """
        self.is_stray = False
        if self._asked:
            self._asked = False
            self._verdicts.newest = self._verdicts.newest_shown = (
                None  # it is of the message before, which nothing else may use it for
            )
        if now_ns != self._drain_ns:  # a drain begins; the one before may have been cut short
            self._drain_ns, self._begun = now_ns, False
            self._ask_front, self._ask_own = bool(self._front_has_said()), self._own is not None
            self._own_first = not self._own_first
        found = self._of_front(now_ns) if self._ask_front else None
        if found is None and self._ask_own and self._own_first:
            found = self._of_own(most_bytes, now_ns)
        if found is None:
            found = self._of_path(most_bytes, now_ns)
        if found is None and self._ask_own:
            found = self._of_own(most_bytes, now_ns)
        if found is None:
            self._drain_ns = -1
            raise BlockingIOError
        self.arrived_ns = found[2]
        return found

    def _of_front(self, now_ns: int) -> tuple[bytes, Address, int] | None:
        try:
            return self._take_of_front(now_ns)
        except BlockingIOError:
            self._ask_front = False
            return None

    def _of_own(self, most_bytes: int, now_ns: int) -> tuple[bytes, Address, int] | None:
        """Return what has come to the worker's own socket; its sender may have no path."""
        assert self._ends is not None
        try:
            datagram, sender, arrived_ns = self._ends.receive(most_bytes, now_ns)
        except BlockingIOError:
            self._ask_own = False
            return None
        path = self.paths.get(sender)
        return datagram, sender if path is None else path.address, arrived_ns

    def _of_path(self, most_bytes: int, now_ns: int) -> tuple[bytes, Address, int] | None:
        """Return one datagram of the path whose turn it is, of those with a socket of their own."""
        if not self._begun:
            self._begin()
        while self._untried or self._tried:
            if not self._untried:
                self._untried, self._tried = self._tried, []
            path = self._untried.pop()
            if path.closed:
                continue
            assert path.arrivals is not None
            self._tried.append(path)
            try:
                datagram, sender, arrived_ns = path.arrivals.receive(most_bytes, now_ns)
            except BlockingIOError:
                self._tried.pop()
                continue
            if sender is not path.sender:
                if sender != path.address and tuple(sender[:2]) != path.address[:2]:
                    self.dropped["of another peer"] += 1  # it came before the path was connected
                    continue
                path.sender = sender
            return datagram, path.address, arrived_ns
        return None

    def _begin(self) -> None:
        """Let each path with a socket have a turn in this drain, first those that had none in the one before.

        A try costs less than to ask the kernel where something has come: in most frames it has from everybody.
        """
        self._begun = True
        waiting, self._untried = self._untried, [path for path in self.paths.values() if path.arrivals is not None]
        if waiting:
            first = set(waiting)
            self._untried = [path for path in self._untried if path not in first] + waiting
        self._tried = []

    def send(self, datagram: bytes, address: Address) -> None:
        """Send a datagram by a path; one whose path has gone meanwhile is counted."""
        path = self.paths.get(address)
        if path is None:
            self.dropped["path has gone"] += 1
        elif path.socket is not None:
            path.socket.send(datagram)
        elif self._own is not None:
            self._own.sendto(datagram, path.address)

    def send_all(self, outbox: deque[tuple[Address, bytes]]) -> list[str]:
        """Send all (address, datagram) of a queue, and return for each that the system refused why it did."""
        if self._ends is not None:
            return self._ends.send_all(outbox)
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
        sockets = [self._own, *(path.socket for path in self.paths.values())]
        return self._overran + add_integers(overrun(each) for each in sockets if each is not None)

    def close(self) -> None:
        """Close all paths."""
        for address in list(self.paths):
            self.drop(address)

    def _take_of_front(self, now_ns: int) -> tuple[bytes, Address, int]:
        """Return the next datagram or message of the front, and when it came; do what else it says.

        Raises BlockingIOError, LinkEndedError.
        """
        while True:
            given, descriptors = self._link.take_at_worker()
            if isinstance(given, Ask):
                self._verdicts.newest, self._verdicts.newest_shown = given.verdict, given.shown
                self.from_front = self._asked = True
                return given.message, self._same(given.address), min(given.arrived_ns, now_ns)
            if isinstance(given, Stray):
                self.is_stray = True
                return given.datagram, given.address, now_ns
            self._follow(given, descriptors, now_ns)

    def _same(self, address: PeerAddress) -> PeerAddress:
        """Return the equal address that was told first: what is the same object is found faster, several times a frame."""
        if len(self._addresses) >= MOST_ADDRESSES:
            self._addresses.clear()
        return self._addresses.setdefault(address, address)

    def _follow(self, given: AnyToWorker, descriptors: Sequence[int], now_ns: int) -> None:
        match given:
            case Path() if descriptors or given.steered:
                self.drop(given.address)
                address = self._same(given.address)
                own = socket.socket(fileno=descriptors[0]) if descriptors else None
                self.paths[address] = OpenPath(address, own, given.keys, now_ns)
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
            path.closed = True
            if path.socket is not None:
                with suppress(OSError):
                    self._overran += overrun(path.socket)
                path.socket.close()
