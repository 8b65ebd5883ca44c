"""Datagrams of a server: one UDP socket, or the sockets of its people that a front process hands over."""

import errno
import socket
from collections import deque
from typing import Any, NamedTuple, Protocol

from cogrip.machine.datagrams import open_datagrams
from cogrip.machine.receive_buffer import enlarge, overrun
from cogrip.protocol.secure.channel import Address, Channel, place_text
from cogrip.server.events import ServerEvent


class ServeError(Exception):
    """The server cannot listen. The text says why and what to do."""


class HostError(ServeError):
    """There is no such address here, and there will be none."""


class DatagramPort(Protocol):
    """Datagrams of many peers."""

    def receive(self, most_bytes: int, now_ns: int) -> tuple[bytes, Address, int]:
        """Return a datagram, its sender, and when it came. Raises BlockingIOError where there is none, OSError."""

    def send_all(self, outbox: deque[tuple[Address, bytes]]) -> list[str]:
        """Send all (address, datagram) of a queue, and return for each that the system refused why it did."""

    def overruns(self) -> int:
        """Return the datagrams that the kernel dropped for want of room. Raises OSError once it is closed."""

    def close(self) -> None:
        """Close all sockets."""


class PortRange(NamedTuple):
    """UDP ports of which a server takes one that is free. Both ends belong to it."""

    first: int
    last: int


class ServerChannel(Channel, Protocol):
    """renewed: addresses with a new DTLS association, perhaps of somebody else; events: to be reported."""

    renewed: deque[Address]
    events: deque[ServerEvent]


class UdpPort:
    """One bound UDP socket. place: its host and port. Raises ServeError."""

    def __init__(self, host: str, port: int, ports: PortRange | None = None) -> None:
        """ports: to take one of, in place of `port`."""
        try:
            family = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._socket = made = socket.socket(family[0], socket.SOCK_DGRAM)
        except OSError as error:
            raise cannot_listen(host, port, error) from None
        try:
            enlarge(made)
            if ports is None:
                made.bind(family[4])
            else:
                _bind_one(made, host, family[4], ports)
        except OSError as error:
            made.close()
            raise cannot_listen(host, port, error) from None
        made.setblocking(False)
        self.place: tuple[str, int] = made.getsockname()[:2]
        ends = open_datagrams(made)
        self.receive, self.send_all = ends.receive, ends.send_all

    def overruns(self) -> int:
        return overrun(self._socket)

    def close(self) -> None:
        self._socket.close()


def _bind_one(made: socket.socket, host: str, address: tuple[Any, ...], ports: PortRange) -> None:
    """Bind to the first port of a range that is free. Raises OSError, ServeError."""
    for port in range(ports.first, ports.last + 1):
        try:
            made.bind((address[0], port, *address[2:]))
            return
        except OSError as error:
            if error.errno not in (errno.EADDRINUSE, errno.EACCES):
                raise
    made.close()
    raise ServeError(
        f"none of the UDP ports {ports.first}-{ports.last} is free at {host}, and each room needs one, for a moment two while "
        "it moves: give more --room-ports, or more hosts"
    )


def cannot_listen(host: str, port: int, error: OSError) -> ServeError:
    """Return the error of an address that cannot be bound."""
    why = error.strerror or error
    if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
        return HostError(
            f"--host {host} is no address of this machine ({why}); 0.0.0.0 is all of its addresses, 127.0.0.1 itself alone"
        )
    return ServeError(
        f"cannot listen on {place_text((host, port))}: {why}; choose another --port, or end the program that has it"
    )
