"""The kernel's receive buffer of a UDP socket: its size, and the datagrams that it dropped."""

import socket
import sys

from cogrip.machine.platform import system

RECEIVE_BUFFER_BYTES = 1 << 20
SO_MEMINFO, DROPS = 55, 8
"""Linux: socket option, and the place in its answer of the count of datagrams that the buffer dropped."""
OVERRUN = "socket: receive buffer full"  # reason under which dropped datagrams are counted


def enlarge(receiver: socket.socket) -> None:
    """Ask for RECEIVE_BUFFER_BYTES; the system may give less."""
    receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)


def overrun(receiver: socket.socket) -> int:
    """Return the datagrams dropped so far because the buffer was full; 0 if unknown. Raises OSError once it is closed."""
    if not system.LINUX:
        return 0
    info = receiver.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, 4 * (DROPS + 1))
    return int.from_bytes(info[-4:], sys.byteorder) if len(info) == 4 * (DROPS + 1) else 0
