"""Sockets that share the public port: the kernel gives each peer with a path to its worker, all others to the front.

A connected UDP socket gets its peer's datagrams before any that is not connected (Linux, `udp4_lib_lookup2`): no right and no
program are needed. A path is bound before it is connected: what others send in those microseconds may come to it, or to a
path that is bound with it. So a worker drops what is not of a path's peer (`WorkerPort`); handshakes and hellos are repeated.
"""

import errno
import socket

from cogrip.protocol.io.platform import time
from cogrip.protocol.io.receive_buffer import enlarge
from cogrip.server.io.platform import share_port
from cogrip.server.io.workers.link import PeerAddress

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
