"""Path of datagrams through a server: from its port through the channel to the core, and back."""

from cogrip.machine.platform import time
from cogrip.protocol.wire.messages import MAX_DATAGRAM_BYTES
from cogrip.server import inputs
from cogrip.server.core import ServerCore
from cogrip.server.io.udp_port import DatagramPort, ServerChannel

MOST_AT_ONCE = 1024  # most datagrams that are received before a tick: a flood beyond that is the kernel's to drop
CLOCK_EVERY = 32  # number of datagrams between two readings of the clock
EARLY_CLOCK_EVERY = 4  # number of datagrams between two readings ahead of a step: so many may make it late
AWAY_NS = 500_000_000  # lateness of a loop that had no processor: its people have become silent, and try other paths
AWAY_LIMIT_NS, AWAY_MOST = 100_000_000, 4096
"""Bounds on time and datagrams in place of the usual ones after such a lateness; more than a socket's buffer holds."""


class DatagramPath:
    """Path of one port. limit_ns: for how long datagrams are received before a tick.

    received, sent  datagrams so far, at the socket
    cut_short       times that some datagrams were left for the next tick
    """

    def __init__(self, port: DatagramPort, channel: ServerChannel, core: ServerCore, limit_ns: int) -> None:
        self._port, self._channel, self._core, self._limit_ns = port, channel, core, limit_ns
        self.received = self.sent = self.cut_short = 0

    def drain(self, now_ns: int, late_ns: int = 0, until_ns: int = 0) -> None:
        """Take in what has come, and send what the channel answers by itself.

        late_ns: of the loop; until_ns: when the step is due that this drain is ahead of: the one at the step takes the rest.
        After a loop was away all of it is taken in, or a step between two hellos of a person would end the seat session that
        the second one resumes.
        """
        limit_ns, most = self._limit_ns, MOST_AT_ONCE
        if late_ns >= AWAY_NS:
            limit_ns, most = AWAY_LIMIT_NS, AWAY_MOST
        every = CLOCK_EVERY
        if until_ns:
            limit_ns, every = until_ns - now_ns, EARLY_CLOCK_EVERY  # it must not make the step late
        core, receive, decrypt = self._core, self._port.receive, self._channel.receive
        renewed, most_bytes = self._channel.renewed, MAX_DATAGRAM_BYTES + 1
        for count in range(most):
            if count % every == every - 1 and time.monotonic_ns() - now_ns > limit_ns:
                self.received += count
                self.cut_short += not until_ns
                break
            try:
                datagram, address, arrived_ns = receive(most_bytes, now_ns)
            except BlockingIOError:
                self.received += count
                break
            except OSError as error:  # an earlier datagram of ours found no one: nothing of this one is lost
                self._core.handle(inputs.SocketFailed(str(error.strerror)), now_ns)
                continue
            carried = decrypt(datagram, address, now_ns)
            while renewed:
                self._core.handle(inputs.UnbindAddress(renewed.popleft()), now_ns)  # type: ignore[arg-type]
            for message in carried:
                core.receive(message, address, arrived_ns)
        else:
            self.received += most
        self.flush()

    def send(self) -> None:
        """Send the core's messages."""
        outbox, encrypt = self._core.outbox, self._channel.send
        while outbox:
            address, message = outbox.popleft()
            if address is None:  # somebody else has it now, and whoever had it is silent
                self._core.dropped["no address"] += 1
            else:
                encrypt(message, address)
        self.flush()

    def flush(self) -> None:
        """Send the channel's datagrams."""
        outbox = self._channel.outbox
        if outbox:
            self.sent += len(outbox)
            for refused in self._port.send_all(outbox):
                self._core.handle(inputs.SocketFailed(refused), time.monotonic_ns())
