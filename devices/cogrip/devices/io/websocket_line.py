"""A line whose messages are a websocket's: a non-blocking socket, and the package `websockets` without I/O of its own.

No thread runs besides the loop, and no verb but `open` waits for the other end. The package is imported as a line is opened: a
list of devices makes lines that nobody opens.
"""

import select
import socket
import time
from collections import Counter
from contextlib import suppress

from cogrip.devices.device import DeviceError

OPEN_S = 3.0  # longest time for connection and handshake
MOST_BYTES = 65536  # most bytes of a message, and of what the other end has not taken: some hundred messages
MOST_AT_ONCE = 16  # most reads at once: an end that sends without a stop must not hold the loop up


class WebsocketLine:
    """See `ByteLine`: `write` sends one message, `read` gives the newest that waits."""

    def __init__(self, name: str, host: str, port: int) -> None:
        self.name = name
        self.counts: Counter[str] = Counter()
        self._where = host, port
        self._socket: socket.socket | None = None
        self._late = b""  # what the system did not take at once
        self._parts: list[bytes] = []  # of a message in several frames

    def open(self) -> None:
        if self._socket is not None:
            raise DeviceError(f"{self.name}: is open already; close it first")
        from websockets.client import ClientProtocol
        from websockets.exceptions import WebSocketException
        from websockets.uri import parse_uri

        host, port = self._where
        self._late, self._parts = b"", []
        try:
            self._socket = socket.create_connection(self._where, OPEN_S)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._protocol = ClientProtocol(parse_uri(f"ws://{host}:{port}/"), max_size=MOST_BYTES)
            self._shake_hands(self._socket)
        except (OSError, WebSocketException) as error:
            self.close()
            raise DeviceError(
                f"{self.name}: no service at {host}:{port} ({error}); start Haply's Inverse service, or name its HOST:PORT"
            ) from None
        self._socket.setblocking(False)

    def _shake_hands(self, connection: socket.socket) -> None:
        """Raises OSError or WebSocketException."""
        from websockets.protocol import State

        protocol, until_s = self._protocol, time.monotonic() + OPEN_S
        protocol.send_request(protocol.connect())
        for data in protocol.data_to_send():
            connection.sendall(data)
        while protocol.state is State.CONNECTING:
            connection.settimeout(max(1e-3, until_s - time.monotonic()))
            data = connection.recv(MOST_BYTES)
            if not data:
                raise OSError("it hung up")
            protocol.receive_data(data)
            if protocol.handshake_exc is not None:
                raise protocol.handshake_exc

    def write(self, frame: bytes) -> None:
        connection = self._need()
        self._protocol.send_text(frame)
        self._flush(connection)

    def _flush(self, connection: socket.socket) -> None:
        self._late += b"".join(self._protocol.data_to_send())
        try:
            if self._late:
                self._late = self._late[connection.send(self._late) :]
        except BlockingIOError:
            self.counts["message waits for the one before"] += 1
        except OSError as error:
            raise self._lost(error.strerror or str(error)) from None
        if len(self._late) > MOST_BYTES:
            raise self._lost(f"it takes no messages: {len(self._late)} bytes wait")

    def read(self, wait_s: float = 0.0) -> bytes:
        connection = self._need()
        newest = self._receive(connection)
        if not newest and wait_s > 0.0:
            until_s = time.perf_counter() + wait_s
            while not newest and (rest_s := until_s - time.perf_counter()) > 0.0:
                if select.select([connection], [], [], rest_s)[0]:
                    newest = self._receive(connection)
        return newest

    def _receive(self, connection: socket.socket) -> bytes:
        """Return the newest whole message, b"" for none. Raises DeviceError where the other end is gone."""
        protocol, gone = self._protocol, ""
        try:
            for _ in range(MOST_AT_ONCE):
                data = connection.recv(MOST_BYTES)
                if not data:
                    gone = "it hung up"
                    break
                protocol.receive_data(data)
        except BlockingIOError:
            pass
        except OSError as error:
            gone = error.strerror or str(error)
        newest = self._newest()
        if protocol.close_rcvd is not None:
            gone = gone or "it closed the connection"
        if protocol.parser_exc is not None:
            gone = gone or f"what it sends is no websocket: {protocol.parser_exc}"
        if gone and not newest:
            raise self._lost(gone)
        if not gone:
            self._flush(connection)  # pongs
        return newest

    def _newest(self) -> bytes:
        """Return the newest whole message among what was received, b"" for none."""
        from websockets.frames import Frame, Opcode

        newest = b""
        for event in self._protocol.events_received():
            if not isinstance(event, Frame) or event.opcode not in (Opcode.TEXT, Opcode.BINARY, Opcode.CONT):
                continue  # the response to the handshake, or a control frame
            self._parts.append(bytes(event.data))
            if event.fin:
                if newest:
                    self.counts["older message passed over"] += 1
                newest = b"".join(self._parts)
                self._parts.clear()
        return newest

    def _need(self) -> socket.socket:
        if self._socket is None:
            raise DeviceError(f"{self.name}: is closed; open it first")
        return self._socket

    def _lost(self, why: str) -> DeviceError:
        return DeviceError(f"{self.name}: lost the service: {why}; start it again, then re-arm")

    def close(self) -> None:
        connection, self._socket = self._socket, None
        if connection is None:
            return
        from websockets.exceptions import WebSocketException

        with suppress(OSError, WebSocketException):
            self._protocol.send_close()
            connection.send(self._late + b"".join(self._protocol.data_to_send()))
        connection.close()

    def stamp(self) -> str:
        """Return "": a service does not say when its device was plugged in."""
        return ""
