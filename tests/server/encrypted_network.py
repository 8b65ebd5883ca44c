"""Encrypted server and its clients on one wire, in virtual time, with faults as verbs.

OpenSSL's own timers run on the machine's clock and never fire in so short a time: what is repeated here, the call repeats.
"""

from collections.abc import Callable, Sequence
from heapq import heappop, heappush
from itertools import count
from pathlib import Path

from cogrip.protocol.io.dtls import is_client_hello
from cogrip.protocol.io.dtls_client import DtlsClient
from cogrip.protocol.secure.channel import PEER, Address
from cogrip.server.io.dtls_channel import DtlsListener
from cogrip.server.rate_limit import Budget, Limits, RateLimiter

STEP_NS = 5_000_000
ON_THE_WAY_NS = 10_000_000
LATE_NS = 640_000_000  # the call has begun anew by then
SWAPPED_NS = 40_000_000
PLENTY = Budget(1_000_000, 1_000_000_000)
NO_LIMITS = Limits(PLENTY, PLENTY, PLENTY, PLENTY)
UP, DOWN = b"a message to the server", b"a message to a client"  # long: no ciphertext holds them by chance
ANNA, BEN = ("10.0.0.1", 4001), ("10.0.0.2", 4002)
FAULTS: dict[str, tuple[int, ...]] = {  # when the copies of a datagram arrive
    "pass": (ON_THE_WAY_NS,),
    "drop": (),
    "twice": (ON_THE_WAY_NS, ON_THE_WAY_NS),
    "again late": (ON_THE_WAY_NS, LATE_NS),
    "late": (LATE_NS,),
    "swapped": (SWAPPED_NS,),
}


class Wire:
    """`heard` is what the server's side delivered, `answers` what each caller's did, `log` all that was put on the wire."""

    def __init__(
        self,
        folder: Path,
        limits: Limits = NO_LIMITS,
        *,
        fault: Callable[[int], str] = lambda _: "pass",
        most: int = 1024,
    ) -> None:
        self.seats: set[Address] = {ANNA, BEN}
        self.listener = DtlsListener(folder, RateLimiter(b"s" * 16, limits), self.seats.__contains__, most=most)
        self.now_ns = 1_000_000_000
        self.calls: dict[Address, DtlsClient] = {}
        self.heard: list[tuple[Address, bytes]] = []
        self.answers: dict[Address, list[bytes]] = {}
        self.log: list[tuple[bool, Address, bytes]] = []  # to the server?
        self._fault = fault
        self._numbers = count()
        self._flying: list[tuple[int, int, bool, Address, bytes]] = []

    def call(self, address: Address = ANNA, fingerprint: str = "") -> DtlsClient:
        """Someone begins to call; nothing has moved yet."""
        self.calls[address] = call = DtlsClient(fingerprint or self.listener.fingerprint)
        self.answers.setdefault(address, [])
        return call

    def seal(self, address: Address = ANNA) -> DtlsClient:
        """Let a client connect until it has an association."""
        call = self.call(address)
        self.until(lambda: call.ready(PEER) and self.listener.ready(address))
        return call

    def hellos(self) -> list[bytes]:
        """Return the client hellos that were put on the wire."""
        return [datagram for *_, datagram in self.log if is_client_hello(datagram)]

    def record(self, message: bytes, address: Address = ANNA) -> bytes:
        """A client's message in a record that has not arrived yet."""
        assert self.calls[address].send(message, PEER)
        return self.calls[address].outbox.pop()[1]

    def answer(self, message: bytes, address: Address = ANNA) -> bytes:
        """The server's, likewise."""
        assert self.listener.send(message, address)
        return self.listener.outbox.pop()[1]

    def step(self, by_ns: int = STEP_NS) -> None:
        self.now_ns += by_ns
        for call in self.calls.values():
            call.poll(self.now_ns)
        self.listener.poll(self.now_ns)
        self.move()

    def until(self, done: Callable[[], object], within_s: float = 4.0) -> None:
        end_ns = self.now_ns + round(within_s * 1e9)
        while not done():
            assert self.now_ns < end_ns, (self.listener.dropped, [(c.failed, c.dropped) for c in self.calls.values()])
            self.step()

    def rest(self, seconds: float = 0.1) -> None:
        end_ns = self.now_ns + round(seconds * 1e9)
        while self.now_ns < end_ns:
            self.step()

    def move(self) -> None:
        """Take up what was sent, hand over what is due."""
        self._take_up()
        while self._flying and self._flying[0][0] <= self.now_ns:
            _, _, to_server, address, datagram = heappop(self._flying)
            if to_server:
                self.inject(datagram, address)
            elif address in self.calls:
                self.answers[address] += self.calls[address].receive(datagram, PEER, self.now_ns)
            self._take_up()

    def inject(self, datagram: bytes, address: Address) -> Sequence[bytes]:
        """A datagram arrives at the server; what it says of the address is not checked by anyone."""
        messages = self.listener.receive(datagram, address, self.now_ns)
        self.heard += [(address, message) for message in messages]
        return messages

    def _take_up(self) -> None:
        for address, call in self.calls.items():
            while call.outbox:
                self._put(True, address, call.outbox.popleft()[1])
        outbox = self.listener.outbox
        while outbox:
            self._put(False, *outbox.popleft())

    def _put(self, to_server: bool, address: Address, datagram: bytes) -> None:
        self.log.append((to_server, address, datagram))
        for way_ns in FAULTS[self._fault(len(self.log) - 1)]:
            heappush(self._flying, (self.now_ns + way_ns, next(self._numbers), to_server, address, datagram))

    def talk(self, address: Address = ANNA) -> None:
        """A message each way passes, and nothing else."""
        before, said = len(self.heard), len(self.answers[address])
        assert self.calls[address].send(UP, PEER)
        assert self.listener.send(DOWN, address)
        self.until(lambda: len(self.heard) > before and len(self.answers[address]) > said)
        assert self.heard[before:] == [(address, UP)]
        assert self.answers[address][said:] == [DOWN]
