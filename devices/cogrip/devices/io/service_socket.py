"""An emulated service behind a websocket on loopback, by the package `websockets` without I/O of its own."""

import socket
from collections.abc import Callable, Sequence
from contextlib import suppress

from websockets.exceptions import WebSocketException
from websockets.frames import Frame, Opcode
from websockets.http11 import Request
from websockets.protocol import State
from websockets.server import ServerProtocol

from cogrip.devices.emulated.firmware import Firmware
from cogrip.devices.io.served_firmware import ServedFirmware

MOST_BYTES = 65536


class ServiceSocket(ServedFirmware):
    """See `ServedFirmware`. One program at a time: another one is hung up on. port: 0 for any that is free."""

    def __init__(self, firmware: Firmware, port: int, say: Callable[[str], None]) -> None:
        super().__init__(firmware, say)
        self._port = port
        self._listener: socket.socket | None = None
        self._host: socket.socket | None = None

    @property
    def plugged(self) -> bool:
        return self._listener is not None

    def plug(self) -> None:
        listener = socket.create_server(("127.0.0.1", self._port))
        listener.setblocking(False)
        self._listener, self._port = listener, listener.getsockname()[1]
        self.path = f"localhost:{self._port}"

    def unplug(self) -> None:
        """The service is killed: its sockets close without a word."""
        self._hang_up()
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    def _hang_up(self) -> None:
        if self._host is not None:
            self._host.close()
            self._host = None

    def sources(self) -> Sequence[int]:
        return [end.fileno() for end in (self._listener, self._host) if end is not None]

    def received(self, ready: Sequence[int]) -> Sequence[bytes]:
        messages: list[bytes] = []
        if self._host is not None and self._host.fileno() in ready:
            messages = self._messages(self._host)
        if self._listener is not None and self._listener.fileno() in ready:
            with suppress(OSError):  # whoever connected has gone
                self._meet(self._listener.accept()[0])
        return messages

    def _meet(self, host: socket.socket) -> None:
        if self._host is not None:
            host.close()
            return
        host.setblocking(False)
        host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._host, self._protocol = host, ServerProtocol(max_size=MOST_BYTES)

    def _messages(self, host: socket.socket) -> list[bytes]:
        protocol, messages = self._protocol, list[bytes]()
        try:
            data = host.recv(MOST_BYTES)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        if not data:
            self._hang_up()
            return []
        protocol.receive_data(data)
        for event in protocol.events_received():
            if isinstance(event, Request):
                protocol.send_response(protocol.accept(event))
                if protocol.state is State.OPEN:
                    self._firmware.connect()
            elif isinstance(event, Frame) and event.opcode in (Opcode.TEXT, Opcode.BINARY):
                messages.append(bytes(event.data))
        self._flush()
        return messages

    def tell(self, replies: Sequence[bytes]) -> None:
        if self._host is None:
            return
        with suppress(WebSocketException):  # it is closing
            for reply in replies:
                self._protocol.send_text(reply)
        self._flush()

    def _flush(self) -> None:
        data = b"".join(self._protocol.data_to_send())
        if data and self._host is not None:
            with suppress(OSError):  # it does not read, or has gone
                self._host.send(data)
        if self._protocol.state is State.CLOSED or self._protocol.close_expected():
            self._hang_up()
