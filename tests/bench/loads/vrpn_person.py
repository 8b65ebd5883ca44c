"""Person of a VRPN server (`vrpn.cpp`): speaks VRPN's protocol, as its own `Format_Of_Protocol.txt` describes it."""

import socket
import struct
import time
from contextlib import suppress

from cogrip.protocol.secure.channel import Channel
from cogrip.protocol.wire.messages import Hello, Stamp

from tests.bench.loads.people import Echoed, Swing

HEADER = struct.Struct(">IIIiiI")  # length with this header, time [s, µs], sender, type, padding
LENGTH = struct.Struct(">I")
ALIGN = 8
COOKIE_BYTES = 24
SENDER, TYPE, UDP = -1, -2, -3  # types of the messages that describe one, and the port for datagrams
ASK_AGAIN_NS = 200_000_000  # the server takes one request at a time and forgets the others
MOST_BYTES = 4096


def message(sender: int, kind: int, payload: bytes) -> bytes:
    """Return this message as VRPN sends it: header and payload, each filled up to 8 bytes."""
    now_us = time.time_ns() // 1000
    header = HEADER.pack(HEADER.size + len(payload), *divmod(now_us, 1_000_000), sender, kind, 0)
    return header + payload + bytes(-len(payload) % ALIGN)


class VrpnPerson(Echoed):
    """Asks the server by a datagram to connect, and exchanges datagrams with it once both have told their ports."""

    def __init__(self, name: str, hello: Hello, server: tuple[str, int], channel: Channel, source: str = "") -> None:
        super().__init__(name, hello, server, channel, source)
        self._asks = self.socket  # for a connection
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((source or server[0], 0))
        self.socket.setblocking(False)
        self._listening = socket.create_server((source or server[0], 0))
        self._listening.setblocking(False)
        self._stream: socket.socket | None = None
        self._read = b""
        self._greeted = False
        self._failed = ""
        self._ask_at_ns = 0
        self._server: tuple[str, int] | None = None  # where its datagrams go

    @property
    def state(self) -> str:
        if self.socket.fileno() < 0:
            return "closed"
        return "seated" if self._server else "joining"

    @property
    def failed(self) -> str:
        return self._failed

    def tend(self, now_ns: int) -> None:
        """Ask for a connection, accept it, and read where datagrams go."""
        if self._stream is None:
            if now_ns >= self._ask_at_ns:
                self._ask_at_ns = now_ns + ASK_AGAIN_NS
                host, port = self._listening.getsockname()
                with suppress(OSError):
                    self._asks.send(f"{host} {port}".encode() + b"\0")
            with suppress(BlockingIOError):
                self._stream, _ = self._listening.accept()
                self._stream.setblocking(False)
        elif self._server is None:
            try:
                came = self._stream.recv(MOST_BYTES)
                self._read += came
                self._failed = "" if came else "VRPN closed the connection"
                self._greet()
            except BlockingIOError:
                return  # it comes later
            except OSError as error:
                self._failed = f"the connection to VRPN broke: {error.strerror}"

    def _greet(self) -> None:
        """Answer the server's cookie with the same, and with a description of this end; then look for the server's."""
        assert self._stream is not None
        if len(self._read) < COOKIE_BYTES:
            return
        if not self._greeted:
            self._greeted = True
            host, port = self.socket.getsockname()
            self._stream.sendall(
                self._read[:COOKIE_BYTES] + message(port, UDP, host.encode() + b"\0")
                + message(0, SENDER, _named(b"hand")) + message(0, TYPE, _named(b"waves"))
            )  # fmt: skip
        rest = self._read[COOKIE_BYTES:]
        while len(rest) >= HEADER.size:
            length, _, _, sender, kind, _ = HEADER.unpack_from(rest)
            if not HEADER.size <= length <= MOST_BYTES:
                self._failed = f"VRPN sent a message of {length} bytes"
            if self._failed or len(rest) < length:
                return
            if kind == UDP:
                self._server = (rest[HEADER.size : length].split(b"\0")[0].decode(), sender)
                return
            rest = rest[length + -length % ALIGN :]

    def say(self, line: Swing, now_ns: int) -> None:
        assert self._server is not None
        waves = line.message(self.number, line.frames, Stamp(now_ns, now_ns, now_ns)) + self.padding
        with suppress(OSError):
            self.socket.sendto(message(0, 0, waves), self._server)
        self.sent += 1

    def close(self) -> None:
        super().close()
        for each in (self._asks, self._listening, self._stream):
            if each is not None:
                each.close()


def _named(name: bytes) -> bytes:
    return LENGTH.pack(len(name) + 1) + name + b"\0"
