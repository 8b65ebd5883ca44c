"""Sockets that share the public port: the kernel gives each peer with a path to its worker, all others to the front.

Each worker has a socket there, and a program finds it by a datagram's source (`steering_program`). Where the kernel takes no
such program, and for peers beyond its size, a path is a socket of its own: a connected UDP socket gets its peer's datagrams
before any that is not connected (Linux, `udp4_lib_lookup2`). It is bound before it is connected: what others send in those
microseconds may come to it. So a worker drops what is not of a path's peer (`WorkerPort`); handshakes and hellos are repeated.
"""

import ctypes
import errno
import secrets
import socket
import struct
from collections.abc import Callable
from contextlib import ExitStack

from cogrip.protocol.io.platform import time
from cogrip.protocol.io.receive_buffer import enlarge
from cogrip.server.io.platform import share_port
from cogrip.server.io.workers.link import PeerAddress
from cogrip.server.io.workers.steering_program import hash_of, program

SO_ATTACH_REUSEPORT_CBPF = 51  # asm-generic/socket.h; no right is needed
TRY_EVERY_S = 0.05


def open_public(host: str, port: int, wait_s: float = 0.0) -> socket.socket:
    """Return the front's socket, alone at its port so far. wait_s: for which a port in use is waited for. Raises OSError."""
    until_s = time.monotonic() + wait_s
    while True:
        try:
            return _open_public(host, port)
        except OSError as error:
            if error.errno != errno.EADDRINUSE or time.monotonic() >= until_s:
                raise
        time.sleep(TRY_EVERY_S)


def _open_public(host: str, port: int) -> socket.socket:
    family = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    with socket.socket(family[0], socket.SOCK_DGRAM) as alone:  # another server of this user could share it unnoticed
        alone.bind(family[4])
        bound = alone.getsockname()
    public = _shared(family[0])
    try:
        public.bind(bound)
    except BaseException:
        public.close()
        raise
    public.setblocking(False)
    return public


def open_path(public: socket.socket, address: PeerAddress) -> socket.socket:
    """Return a socket at the public port for this peer alone. Raises OSError."""
    path = _shared(public.family)
    try:
        path.bind(public.getsockname())
        path.connect(address)
    except BaseException:
        path.close()
        raise
    return path


def _shared(family: int) -> socket.socket:
    made = socket.socket(family, socket.SOCK_DGRAM)
    try:
        share_port(made)
    except OSError:
        made.close()
        raise
    enlarge(made)
    return made


class Steering:
    """Sockets of some workers at the public port, and the peers of each. Raises OSError where the kernel takes no program.

    own: a socket for each worker; a program counts them from 1. They stay when a worker ends: the next one takes it.
    """

    def __init__(self, public: socket.socket, workers: int, stack: ExitStack) -> None:
        """stack: closes the sockets."""
        self._public = public
        self._multiplier = secrets.randbits(32) | 1
        self._hashes: dict[PeerAddress, int] = {}
        self._places: dict[int, int] = {}
        self._attach({})  # without it the kernel would divide all peers over all sockets
        self.own: list[socket.socket] = []
        for _ in range(workers):
            made = stack.enter_context(_shared(public.family))
            made.bind(public.getsockname())
            made.setblocking(False)
            self.own.append(made)

    def add(self, address: PeerAddress, worker: int) -> bool:
        """Steer a peer to the socket of a worker. Return False where it cannot be: nothing has changed then."""
        try:
            found = hash_of(address, self._multiplier)
            if found in self._places and self._hashes.get(address) != found:
                return False  # another peer has the same one
            self._attach({**self._places, found: worker + 1})
        except OSError:  # the program is too long
            return False
        self._hashes[address] = found
        self._places[found] = worker + 1
        return True

    def remove(self, leaves: Callable[[PeerAddress], bool]) -> None:
        """Give the peers for whom this is true to the front again."""
        gone = [self._places.pop(self._hashes.pop(address)) for address in list(self._hashes) if leaves(address)]
        if gone:
            self._attach(self._places)

    def _attach(self, places: dict[int, int]) -> None:
        steps = [struct.pack("=HBBI", *step) for step in program(places, self._multiplier)]
        kept = ctypes.create_string_buffer(b"".join(steps))
        self._public.setsockopt(
            socket.SOL_SOCKET, SO_ATTACH_REUSEPORT_CBPF, struct.pack("@HP", len(steps), ctypes.addressof(kept))
        )
