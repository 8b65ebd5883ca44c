"""A worker's channel: DTLS associations that the front has begun, and messages through the front before that."""

from collections import Counter, deque
from collections.abc import Callable, Sequence
from contextlib import suppress

from cogrip.protocol.secure.channel import Address
from cogrip.protocol.secure.dtls_records import CHANGE_CIPHER_SPEC, HANDSHAKE
from cogrip.protocol.wire.messages import MAX_DATAGRAM_BYTES
from cogrip.server.events import ServerEvent
from cogrip.server.hosting.link import Asked, Astray, Link, Released, Say
from cogrip.server.hosting.workers.paths import OpenPath, WorkerPort
from cogrip.server.rate_limit import RateLimiter
from cogrip.server.unencrypted_channel import looks_like_hello

RELEASE_NS = 5_000_000_000  # time for which a path without a seat is kept: a goodbye may be repeated
SWEEP_EVERY_NS = 500_000_000


class WorkerChannel:
    """`ServerChannel` of a worker. seated: says whether somebody in a session is at an address (`ServerCore.knows`)."""

    def __init__(
        self, link: Link, port: WorkerPort, rate_limiter: RateLimiter, seated: Callable[[Address], bool]
    ) -> None:
        self.outbox: deque[tuple[Address, bytes]] = deque()
        self.events: deque[ServerEvent] = deque()
        self.renewed = port.renewed
        self.failed = ""
        self._link, self._port, self._rate_limiter, self._seated = link, port, rate_limiter, seated
        self._counts: Counter[str] = Counter()
        self._sweep_ns = 0

    @property
    def dropped(self) -> Counter[str]:
        """Counts of channel, port and link, by reason."""
        return self._counts + self._port.dropped + self._link.dropped

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        """Return the messages of what the port returned last."""
        if self._port.from_front:
            self._port.from_front = False
            return (datagram,)
        path = self._port.paths.get(address)
        if reason := self._fault(datagram, address, now_ns):
            self._counts[reason] += 1
            return ()
        if path is None:
            self._hand_back(datagram, address)
            return ()
        if path.session is None:
            messages = [datagram]
        elif datagram[0] in (HANDSHAKE, CHANGE_CIPHER_SPEC):
            self._link.send(Astray(path.address, datagram))
            return ()
        elif not (messages := path.session.receive(datagram)):
            self._counts["not authentic"] += 1
            if path.session.closed:
                self._release(path)
        return [each for each in messages if not self._is_for_front(path, each)]

    def send(self, message: bytes, address: Address) -> bool:
        """Send a message: by the peer's path, or through the front."""
        path = self._port.paths.get(address)
        if path is None:
            if not isinstance(address, tuple):
                self._counts["no address"] += 1
                return False
            return self._link.send(Say(address, message))
        self.outbox.append((address, message if path.session is None else path.session.send(message)))
        return True

    def ready(self, address: Address) -> bool:
        """Return True: whom the worker knows, it reaches."""
        return True

    def poll(self, now_ns: int) -> None:
        """Release the paths of people who have been without a seat for a while."""
        if now_ns < self._sweep_ns:
            return
        self._sweep_ns = now_ns + SWEEP_EVERY_NS
        for path in list(self._port.paths.values()):
            if self._seated(path.address):
                path.seated_ns = now_ns
            elif now_ns - path.seated_ns >= RELEASE_NS:
                self.close(path.address)

    def close(self, address: Address) -> None:
        """Close a path, and tell the other end."""
        if path := self._port.paths.get(address):
            if path.session is not None:
                with suppress(OSError):
                    self._port.send(path.session.close(), address)
            self._release(path)

    def _hand_back(self, datagram: bytes, address: Address) -> None:
        """Let the front judge what is of no path: its sender may be anew there, or have the hash of one that is steered.

        What the front gave is not given back: it takes the sender for one that is seated here, and has to hear otherwise.
        """
        assert isinstance(address, tuple)
        if self._port.is_stray:
            self._counts["path has gone"] += 1
            self._link.send(Released(address))
        else:
            self._link.send(Astray(address, datagram))

    def _fault(self, datagram: bytes, address: Address, now_ns: int) -> str:
        if not datagram or len(datagram) > MAX_DATAGRAM_BYTES:
            return self._rate_limiter.size(datagram)
        return self._rate_limiter.peer(address, now_ns)

    def _is_for_front(self, path: OpenPath, message: bytes) -> bool:
        """Ask the front about a hello: it alone knows the tokens. One that finds no room in the link is lost, and repeated."""
        if not looks_like_hello(message):
            return False
        self._link.send(Asked(path.address, message, self._port.arrived_ns))
        return True

    def _release(self, path: OpenPath) -> None:
        self._port.drop(path.address)
        self._link.send(Released(path.address))
