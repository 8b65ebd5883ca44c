"""Exchange of a live client: messages of its core to the network and back, through the emulated link where there is one."""

from typing import Protocol

from cogrip.client.io.paths import Paths
from cogrip.client.recorder import RecordedClient


class EmulatedDirection(Protocol):
    """An emulated direction; `cogrip.sim.link.LinkEmulator` is one."""

    @property
    def next_ns(self) -> int | None: ...
    def send(self, payload: bytes, now_ns: int) -> None: ...
    def due(self, now_ns: int) -> list[bytes]: ...


class DatagramExchange:
    """Exchange of one client. up, down: the emulated directions, None without, set once the settings of the seat are known.

    half_tick_ns: by which the emulated link is early, so that a message goes at the nearest tick
    """

    def __init__(self, core: RecordedClient, paths: Paths) -> None:
        self._session, self._paths = core.session, paths
        self._outbox = core.session.outbox
        self._receive, self._answers, self._redirect = core.receive, core.session.is_welcome, core.session.redirect
        self.up: EmulatedDirection | None = None
        self.down: EmulatedDirection | None = None
        self.half_tick_ns = 0

    def send(self, now_ns: int) -> None:
        """Send the messages that the core leaves."""
        outbox, up = self._outbox, self.up
        while outbox:
            message = outbox.popleft()
            if up is None:
                self._paths.send(message, message == self._session.hello)
            else:
                up.send(message, now_ns)
        if up is not None and up.next_ns is not None:
            for message in up.due(now_ns + self.half_tick_ns):
                self._paths.send(message, message == self._session.hello)

    def drain(self, now_ns: int) -> None:
        """Give the core what has come."""
        down = self.down
        self._paths.drain(now_ns, self._receive if down is None else down.send, self._answers, self._redirect)
        if down is not None and down.next_ns is not None:
            for message in down.due(now_ns + self.half_tick_ns):
                self._receive(message, now_ns)
