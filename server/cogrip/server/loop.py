"""The live server: one thread, one UDP socket, many rooms (design: Server process).

A tick of a room: drain the socket, step, send one datagram a user. Rooms may have different rates.
"""

import secrets
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cogrip.protocol.io.pacing import SPIN_NS, Pacer
from cogrip.protocol.io.realtime import engage, release
from cogrip.protocol.io.stop import Stop
from cogrip.protocol.io.trace import TraceWriter, open_trace
from cogrip.protocol.messages import MAX_DATAGRAM_BYTES
from cogrip.protocol.settings import Settings
from cogrip.protocol.version import VERSION
from cogrip.server import trace_row
from cogrip.server.core import ServerCore
from cogrip.server.room import Room

RECEIVE_BUFFER_BYTES = 1 << 20
LINGER_NS = 300_000_000  # after the goodbye, for the clients' accounts
TRACE_SECONDS = 300.0


class ServeError(Exception):
    """The server cannot listen. The text says why and what to do."""


@dataclass(slots=True)
class LiveServer:
    """A daemon for some rooms. `listen`, then `run` until `stop` is set."""

    rooms: Sequence[Settings]
    host: str
    port: int
    stop: Stop
    say: Callable[[str], None]
    trace_at: Callable[[str], Path | None]
    seconds: float | None = None
    core: ServerCore = field(init=False)
    _socket: socket.socket = field(init=False)
    _start_ns: int = field(init=False, default=0)

    def listen(self) -> tuple[str, int]:
        """Bind, and give the address. Raises ServeError."""
        try:
            family = socket.getaddrinfo(self.host, self.port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family[0], socket.SOCK_DGRAM)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
            self._socket.bind(family[4])
        except OSError as error:
            raise ServeError(
                f"cannot listen on {self.host}:{self.port}: {error.strerror or error}; "
                "choose another --port, or end the program that has it"
            ) from None
        self._socket.setblocking(False)
        host, port = self._socket.getsockname()[:2]
        self.core = ServerCore(self.rooms, VERSION, lambda: secrets.randbelow(2**63 - 1) + 1)
        return host, port

    @property
    def elapsed_s(self) -> float:
        """How long the rooms have been running."""
        return (time.monotonic_ns() - self._start_ns) * 1e-9

    def run(self) -> None:
        """Serve until stopped, say goodbye, and leave with the socket closed."""
        traces: dict[str, TraceWriter] = {}
        for room in self.core.rooms:
            trace = open_trace(
                self.trace_at(room.name), trace_row.columns(room.world.axes, len(room.seats)),
                rate_hz=room.settings.rates.network_hz, seconds=max(TRACE_SECONDS, room.settings.seconds), who=room.name,
                say=self.say,
            )  # fmt: skip
            if trace is not None:
                traces[room.name] = trace
        measures = engage()
        self._start_ns = time.monotonic_ns()
        pacers = {}
        for room in self.core.rooms:
            pacers[room.name] = pacer = Pacer(room.settings.rates.network_hz, self._start_ns)
            room.ticks = pacer.count
            if room.name in traces:
                traces[room.name].begin(self._start_ns)
        try:
            with self._socket:
                self._loop(pacers, traces)
                self._farewell()
        finally:
            release(measures)
            for trace in traces.values():
                trace.close()

    def _loop(self, pacers: dict[str, Pacer], traces: dict[str, TraceWriter]) -> None:
        core, clock = self.core, time.monotonic_ns
        last = dict.fromkeys(pacers, -1)
        work_us = dict.fromkeys(pacers, 0.0)
        end_ns = None if self.seconds is None else self._start_ns + round(self.seconds * 1e9)
        while not self.stop.reason:
            if end_ns is not None and clock() >= end_ns:
                self.stop.reason = "the time is over"
            due_ns = min(pacer.next_due_ns for pacer in pacers.values())
            remaining_ns = due_ns - SPIN_NS - clock()
            if remaining_ns > 0:
                time.sleep(remaining_ns * 1e-9)
            while (now_ns := clock()) < due_ns:
                pass
            ticks = {room.name: pacers[room.name].take(now_ns) for room in core.rooms}
            self._drain(now_ns)
            for room in core.rooms:
                pacer, tick = pacers[room.name], ticks[room.name]
                if tick is None:
                    continue
                core.tick(room, now_ns, tick - last[room.name])
                last[room.name] = tick
                self._send()
                if room.name in traces:
                    traces[room.name].append(self._row(room, tick, pacer, work_us[room.name]))
                work_us[room.name] = (clock() - now_ns) * 1e-3
                pacer.done()
            while core.events:
                self.say(core.events.popleft())

    def _row(self, room: Room, tick: int, pacer: Pacer, work_us: float) -> list[float]:
        return trace_row.row(room, tick / pacer.rate_hz, pacer.late_ns * 1e-3, work_us, pacer.skipped)

    def _farewell(self) -> None:
        self.core.stop(self.stop.reason)
        self._send()
        until_ns = time.monotonic_ns() + LINGER_NS
        while (now_ns := time.monotonic_ns()) < until_ns and self.core.awaits_accounts:
            self._drain(now_ns)
            self._send()
            time.sleep(0.002)

    def _drain(self, now_ns: int) -> None:
        receive, take = self._socket.recvfrom, self.core.receive
        while True:
            try:
                datagram, address = receive(MAX_DATAGRAM_BYTES + 1)
            except BlockingIOError:
                return
            except OSError as error:  # an earlier datagram of ours found no one: nothing of this one is lost
                self.core.drop(f"socket: {error.strerror}")
                continue
            take(datagram, address, now_ns)

    def _send(self) -> None:
        outbox, put = self.core.outbox, self._socket.sendto
        while outbox:
            address, datagram = outbox.popleft()
            try:
                put(datagram, address)  # type: ignore[call-overload]  # addresses are the socket's own
            except OSError as error:
                self.core.drop(f"socket: {error.strerror}")
