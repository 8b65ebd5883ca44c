"""Sockets that share the public port: the kernel gives each peer with a path to its worker, all others to the front.

A connected UDP socket gets its peer's datagrams before any that is not connected (Linux, `udp4_lib_lookup2`): no program runs
for that. But a socket is bound before it is connected, and meanwhile it would get a share of everybody's datagrams: a classic
BPF program of one instruction, which needs no right, returns the first socket of the group, which is the front's.
"""

import ctypes
import socket
import struct

from cogrip.protocol.io.receive_buffer import enlarge
from cogrip.server.io.platform import share_port
from cogrip.server.io.workers.link import PeerAddress

SO_ATTACH_REUSEPORT_CBPF = 51
_RETURN_FIRST = struct.pack("=HBBI", 0x06, 0, 0, 0)  # BPF_RET | BPF_K, 0


def open_public(host: str, port: int) -> socket.socket:
    """Return the front's socket, alone at its port so far. Raises OSError."""
    family = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    with socket.socket(family[0], socket.SOCK_DGRAM) as alone:  # another server of this user could share it unnoticed
        alone.bind(family[4])
        bound = alone.getsockname()
    public = _shared(family[0])
    try:
        public.bind(bound)
        _attach(public)
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


def _attach(first: socket.socket) -> None:
    instruction = ctypes.create_string_buffer(_RETURN_FIRST)
    program = struct.pack("@HP", 1, ctypes.addressof(instruction))
    first.setsockopt(socket.SOL_SOCKET, SO_ATTACH_REUSEPORT_CBPF, program)
