"""Sockets that share the public port: the kernel gives each peer with a path to its worker, all others to the front.

Each worker has a socket there, and a program finds it by a datagram's source (`steering_program`). Where the kernel takes no
such program, or may not (`replaces_safely`), and for peers beyond its size, a path is a socket of its own: a connected UDP
socket gets its peer's datagrams before any that is not connected (Linux, `udp4_lib_lookup2`). It is bound before it is
connected: what others send in those microseconds may come to it, and a worker drops that; handshakes and hellos are repeated.
"""

import ctypes
import errno
import math
import re
import secrets
import socket
import struct
from collections.abc import Callable
from contextlib import ExitStack, suppress

from cogrip.machine.platform import time
from cogrip.machine.receive_buffer import enlarge
from cogrip.machine.server_platform import share_port
from cogrip.server.hosting.link import PeerAddress
from cogrip.server.hosting.workers.steering_program import hash_of, program

SO_ATTACH_REUSEPORT_CBPF = 51  # option of sockets, of asm-generic/socket.h; no right is needed
MOST_STEERED = 4096  # most peers that are steered: a program has at most as many instructions
MENDED = {(5, 10): 259, (5, 15): 210, (6, 1): 177, (6, 6): 143, (6, 18): 36}
"""Releases of longterm kernels that were seen to have what `replaces_safely` asks for."""
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


def replaces_safely(release: str) -> bool:
    """Return whether a kernel of this release waits for a program that runs before it frees it ("bpf: Free reuseport cBPF prog
    after RCU grace period", Linux 7.1). Older ones may crash where one is replaced while datagrams come.
    """
    found = re.match(r"(\d+)\.(\d+)(?:\.(\d+))?", release)
    if found is None:
        return False
    major, minor, patch = (int(part or 0) for part in found.groups())
    return (major, minor) >= (7, 1) or patch >= MENDED.get((major, minor), math.inf)


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
        self._most = MOST_STEERED
        self._stale = False  # somebody has left since the program was made
        self._attach({})  # without it the kernel would divide all peers over all sockets
        self.own: list[socket.socket] = []
        for _ in range(workers):
            made = stack.enter_context(_shared(public.family))
            made.bind(public.getsockname())
            made.setblocking(False)
            self.own.append(made)

    def add(self, address: PeerAddress, worker: int) -> bool:
        """Steer a peer to the socket of a worker. Return False where it cannot be: nothing has changed then."""
        with suppress(OSError):  # the host is no number
            found = hash_of(address, self._multiplier)
            if found in self._places and self._hashes.get(address) != found:
                return False  # another peer has the same one
            places = {**self._places, found: worker + 1}
            if len(places) > self._most:
                return False
            try:
                self._attach(places)
            except OSError:
                self._most = len(self._places)  # it is too long for this kernel
                return False
            self._hashes[address], self._places = found, places
            return True
        return False

    def remove(self, leaves: Callable[[PeerAddress], bool]) -> None:
        """Let the peers for whom this is true come to the front again, from the next `refresh` on."""
        for address in [each for each in self._hashes if leaves(each)]:
            del self._places[self._hashes.pop(address)]
            self._stale, self._most = True, MOST_STEERED  # there is room again, or what was refused had another reason

    def refresh(self) -> None:
        """Let the kernel know who has left, of all since the last call. Where it refuses, the next call tries again."""
        if self._stale:
            with suppress(OSError):
                self._attach(self._places)

    def _attach(self, places: dict[int, int]) -> None:
        steps = [struct.pack("=HBBI", *step) for step in program(places, self._multiplier)]
        kept = ctypes.create_string_buffer(b"".join(steps))
        self._public.setsockopt(
            socket.SOL_SOCKET, SO_ATTACH_REUSEPORT_CBPF, struct.pack("@HP", len(steps), ctypes.addressof(kept))
        )
        self._stale = False
