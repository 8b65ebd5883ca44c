"""Ports that stay free: what a test leaves unbound for a while, no socket of another test may be given meanwhile."""

import os
import socket
from itertools import count

FIRST, PORTS = 20_000, 10_000  # below those that systems give to sockets that ask for any
_numbers = count(os.getpid() * 37)  # another process begins elsewhere


def free_port(host: str = "127.0.0.1") -> int:
    """A UDP port that nobody has, and that nobody gets who does not ask for it by its number."""
    for number in _numbers:
        port = FIRST + number % PORTS
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind((host, port))
            except OSError:
                continue
            return port
    raise AssertionError
