"""Public socket of a front, whoever serves its rooms: opened, and what it dropped."""

import socket
from contextlib import ExitStack

from cogrip.cli.serving.served_rooms import Say
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.server.hosting.placement import Served
from cogrip.server.hosting.public_socket import PublicSocket
from cogrip.server.hosting.workers.steering import open_public
from cogrip.server.io.udp_socket import HostError, ServeError, cannot_listen


def front_socket(served: Served, stack: ExitStack, wait_s: float = 0.0) -> socket.socket:
    """Return the socket, open until `stack` is left. wait_s: for which a port in use is waited for. Raises Problem."""
    with Problem.of(ServeError), BadInput.of(HostError):
        try:
            return stack.enter_context(open_public(served.host, served.port, wait_s))
        except OSError as error:
            raise cannot_listen(served.host, served.port, error) from None


def say_drops(front: PublicSocket, say: Say) -> None:
    """Say what the front dropped, if anything."""
    dropped = [f"{name}: {count}" for name, count in sorted(front.drops().items()) if count]
    if dropped:
        say(f"at the front: {', '.join(dropped)}")
