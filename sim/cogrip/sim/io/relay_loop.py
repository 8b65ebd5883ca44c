"""The live relay: one thread, one socket for the clients, and one towards the server for each of them.

It sleeps in `select` until a datagram arrives or is due, forwards at once what is not delayed, and asks for the same real-time
measures as the loops of client and server. `python3 dev.py bench relay` measures the delay that it adds.
"""

import errno
import select
import socket
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from ipaddress import ip_address
from typing import Any

from cogrip.machine.addition import add_integers
from cogrip.machine.platform import system, time
from cogrip.machine.realtime import Measure, engage, release
from cogrip.machine.receive_buffer import OVERRUN, enlarge, overrun
from cogrip.machine.stop import Stop
from cogrip.protocol.secure.channel import place_text
from cogrip.sim.relay import Flow, Lane, Relay

MOST_BYTES = 65_535  # longest datagram
MOST_AT_ONCE = 32  # most datagrams of one socket before what is due gets its turn
POLL_S = 0.1  # time between two checks of `stop`
CHORES_NS = 1_000_000_000


class RelayError(Exception):
    """The relay cannot listen; the text says why and what to do."""


class PlaceError(RelayError):
    """An address that does not exist."""


def resolve(flag: str, host: str, port: int) -> tuple[socket.AddressFamily, Any]:
    """Return family and address of a host and port. Raises PlaceError."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    except (OSError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or error
        raise PlaceError(f"{flag} {place_text((host, port))}: {why}; check the name, or give an address") from None
    return found[0], found[4]


@dataclass(slots=True)
class LiveRelay:
    """The loop between `listen` and `to`: `open`, then `run` until `stop` is set; `close` where it is not run.

    each_second: called every second with the time [ns]; it must be quick, for nothing is relayed meanwhile.
    """

    relay: Relay
    listen: tuple[str, int]
    to: tuple[str, int]
    stop: Stop
    say: Callable[[str], None]
    each_second: Callable[[int], None] = lambda now_ns: None
    seconds: float | None = None
    counts: Counter[str] = field(init=False, default_factory=Counter)
    measures: list[Measure] = field(init=False, default_factory=list)
    bound: tuple[str, int] = field(init=False, default=("", 0))
    far: tuple[str, int] = field(init=False, default=("", 0))
    started_ns: int = field(init=False, default=0)
    _clients: socket.socket = field(init=False)
    _far: tuple[socket.AddressFamily, Any] = field(init=False)
    _sockets: dict[Flow, socket.socket] = field(init=False, default_factory=dict)
    _flows: dict[socket.socket, Flow] = field(init=False, default_factory=dict)
    _overran: int = field(init=False, default=0)  # count of datagrams that sockets which are closed had dropped

    def open(self) -> None:
        """Look up both places, and bind. Raises RelayError."""
        self._far = resolve("--to", *self.to)
        self.far = self._far[1][:2]
        family, address = resolve("--listen", *self.listen)
        self._clients = socket.socket(family, socket.SOCK_DGRAM)
        try:
            enlarge(self._clients)
            self._clients.setblocking(False)
            self._clients.bind(address)
        except OSError as error:
            self._clients.close()
            raise _cannot_listen(self.listen, error) from None
        self.bound = self._clients.getsockname()[:2]
        if self._goes_to_itself():
            self._clients.close()
            raise PlaceError(f"--to {place_text(self.far)} is where the relay itself listens; give the server's place")

    def _goes_to_itself(self) -> bool:
        (here, port), (there, far_port) = self.bound, self.far
        if port != far_port:
            return False
        own, other = (ip_address(text.partition("%")[0]) for text in (here, there))
        if own.is_unspecified:
            return own.version >= other.version and _is_ours(*self._far)
        if other.is_unspecified:  # who sends there comes to loopback
            return own == ip_address("127.0.0.1" if other.version == 4 else "::1")
        return own == other

    def close(self) -> None:
        for each in (self._clients, *self._sockets.values()):
            each.close()

    def run(self) -> None:
        """Relay until stopped."""
        self.measures = engage()
        self.started_ns = time.monotonic_ns()
        try:
            self._loop()
        finally:
            release(self.measures)
            overran = self._overrun()
            self.close()
            if overran:
                self.counts[OVERRUN] += overran

    @property
    def elapsed_s(self) -> float:
        return (time.monotonic_ns() - self.started_ns) * 1e-9

    def _loop(self) -> None:
        relay, clock = self.relay, time.monotonic_ns
        end_ns = None if self.seconds is None else self.started_ns + round(self.seconds * 1e9)
        chores_ns = self.started_ns + CHORES_NS
        buffer = memoryview(bytearray(MOST_BYTES))
        while not self.stop.reason:
            next_ns, now_ns = relay.next_ns, clock()
            if end_ns is not None and now_ns >= end_ns:
                self.stop.reason = "the time is over"
                break
            wait_s = POLL_S if next_ns is None else min(POLL_S, max(0.0, (next_ns - now_ns) * 1e-9))
            for ready in select.select([self._clients, *self._flows], [], [], wait_s)[0]:
                self._receive(ready, buffer)
            now_ns = clock()
            next_ns = relay.next_ns
            if next_ns is not None and next_ns <= now_ns:
                relay.due(now_ns)
                self._flush()
            if now_ns >= chores_ns:
                chores_ns = max(chores_ns + CHORES_NS, now_ns)
                for flow in relay.expire(now_ns):
                    self._end(flow)
                self.each_second(now_ns)

    def _receive(self, ready: socket.socket, buffer: memoryview) -> None:
        relay, clock = self.relay, time.monotonic_ns
        flow = self._flows.get(ready)
        for _ in range(MOST_AT_ONCE):
            try:
                size, address = ready.recvfrom_into(buffer)
            except BlockingIOError:
                return
            except OSError as error:  # of an earlier datagram; this one is not lost
                self._failed(flow.up if flow is not None else None, error)
                return
            datagram, now_ns = bytes(buffer[:size]), clock()
            if flow is not None:
                relay.from_server(datagram, flow, now_ns)
            elif (client := relay.from_client(datagram, address, now_ns)) is not None and client not in self._sockets:
                self._begin(client)
            if (next_ns := relay.next_ns) is not None and next_ns <= now_ns:
                relay.due(now_ns)
                self._flush()

    def _begin(self, flow: Flow) -> None:
        """Open the socket towards the server for a new client."""
        try:
            server = socket.socket(self._far[0], socket.SOCK_DGRAM)
            server.setblocking(False)
            enlarge(server)
            server.connect(self._far[1])
        except OSError as error:
            self._failed(flow.up, error)
            return
        self._sockets[flow] = server
        self._flows[server] = flow
        self.say(f"flow {flow.number}: {_text(flow.address)} by way of {_text(server.getsockname())}")

    def _end(self, flow: Flow) -> None:
        self.say(f"flow {flow.number}: {_text(flow.address)} was idle for too long, and is over")
        server = self._sockets.pop(flow, None)
        if server is not None:
            self._overran += overrun(server)
            del self._flows[server]
            server.close()

    def _flush(self) -> None:
        outbox = self.relay.outbox
        while outbox:
            lane, datagram = outbox.popleft()
            if lane.direction == "up":
                self._send_up(lane, datagram)
                continue
            try:
                self._clients.sendto(datagram, lane.flow.address)  # type: ignore[call-overload]  # the socket's own
            except OSError as error:
                lane.not_sent += 1
                self.counts[f"to a client: {error.strerror}"] += 1

    def _send_up(self, lane: Lane, datagram: bytes) -> None:
        server = self._sockets.get(lane.flow)
        if server is None:
            lane.not_sent += 1
            return
        try:
            server.send(datagram)
        except system.NOBODY_LISTENS as error:  # of an earlier datagram, reported now; the socket takes the next
            self._failed(lane, error)
            try:
                server.send(datagram)
            except OSError as again:
                self._failed(lane, again)
                lane.not_sent += 1
        except OSError as error:
            lane.not_sent += 1
            self.counts[f"to the server: {error.strerror}"] += 1

    def _failed(self, lane: Lane | None, error: OSError) -> None:
        """Count the failure of an earlier datagram, as ICMP reported it."""
        if lane is not None and isinstance(error, system.NOBODY_LISTENS):
            lane.refused += 1
        else:
            self.counts[f"{'to a client' if lane is None else 'to the server'}: {error.strerror}"] += 1

    def _overrun(self) -> int:
        return self._overran + add_integers(overrun(each) for each in (self._clients, *self._sockets.values()))


def _is_ours(family: socket.AddressFamily, address: Any) -> bool:
    """Return whether an address is of this machine: only those can be bound."""
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((address[0], 0, *address[2:]))
        except OSError:
            return False
    return True


def _text(address: Any) -> str:
    return place_text(address[:2])


def _cannot_listen(place: tuple[str, int], error: OSError) -> RelayError:
    why = error.strerror or error
    if error.errno == errno.EADDRNOTAVAIL:
        return PlaceError(
            f"--listen {place_text(place)} is no address of this machine ({why}); 0.0.0.0 is all of its addresses, "
            "127.0.0.1 itself alone"
        )
    return RelayError(
        f"cannot listen on {place_text(place)}: {why}; choose another port, or end the program that has it"
    )
