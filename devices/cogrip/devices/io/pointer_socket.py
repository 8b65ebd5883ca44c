"""Socket to the process that serves a page: whole messages, never waited for."""

import socket
from contextlib import suppress

from cogrip.devices.device import DeviceError

MOST_BYTES = 4096
MOST_AT_ONCE = 16  # most messages taken in a tick: a page sends a few hundred a second


class PointerSocket:
    """Device's end of the link. closed: True once the other end is."""

    def __init__(self, fd: int, where: str) -> None:
        """fd: inherited from the process that started this one. Raises DeviceError where it is no socket."""
        try:
            self._socket = socket.socket(fileno=fd)
        except OSError as error:
            raise DeviceError(
                f"{where}: fd={fd} is no socket ({error.strerror}); leave the key out: `cogrip join --device web` sets it"
            ) from None
        self._socket.setblocking(False)
        self.closed = False

    def receive(self) -> list[bytes]:
        """Return the messages that have come."""
        messages: list[bytes] = []
        while len(messages) < MOST_AT_ONCE and not self.closed:
            try:
                message = self._socket.recv(MOST_BYTES)
            except BlockingIOError:
                break
            except OSError:
                message = b""
            if message:
                messages.append(message)
            else:  # no message is empty: the other end is closed
                self.closed = True
        return messages

    def send(self, message: bytes) -> None:
        """Send a message, or leave it out where the other end is slow or gone."""
        with suppress(OSError):
            self._socket.send(message)

    def close(self) -> None:
        """Close this end."""
        self._socket.close()
