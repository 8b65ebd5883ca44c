"""The live observer: one thread that waits for datagrams, no device and no recording."""

from collections.abc import Callable
from dataclasses import dataclass
from select import select

from cogrip.client.inputs import Leave, Poll, Reached
from cogrip.client.io.paths import POLL_S, Paths, session_change
from cogrip.client.observer import ObserverCore
from cogrip.machine.platform import time
from cogrip.machine.stop import Stop

SHOW_S = 0.02


@dataclass(slots=True)
class LiveObserver:
    """`run` blocks until the session has ended.

    show: called with core and time [ns], at once when something came, every SHOW_S at least.
    """

    core: ObserverCore
    paths: Paths
    stop: Stop
    say: Callable[[str], None]
    show: Callable[[ObserverCore, int], None]
    seconds: float | None = None

    def run(self) -> str:
        """Return why it ended badly, "" if it did not. Raises JoinError when there is no place to be had."""
        core, session = self.core, self.core.session
        if session.state == "idle":
            self.paths.connect(core, self.stop)
        end_ns = None if self.seconds is None else time.monotonic_ns() + round(self.seconds * 1e9)
        state = session.state
        while session.state != "closed" and not self.stop.reason:
            now_ns = time.monotonic_ns()
            if end_ns is not None and now_ns >= end_ns:
                break
            self._exchange(now_ns)
            if session.state != state:
                if text := session_change(session, state, session.state):
                    self.say(text)
                state = session.state
            self.show(core, now_ns)
            select([path.socket for path in self.paths.paths], (), (), SHOW_S)
        core.handle(Leave(self.stop.reason or "seen enough"), time.monotonic_ns())
        while session.state == "leaving":
            self._exchange(time.monotonic_ns())
            time.sleep(POLL_S)
        return self.paths.explained(session.failed)

    def _exchange(self, now_ns: int) -> None:
        core, session, paths = self.core, self.core.session, self.paths
        core.handle(Poll(), now_ns)
        while core.outbox:
            message = core.outbox.popleft()
            paths.send(message, message == session.hello)
        paths.drain(now_ns, core.receive, session.is_welcome, session.redirect)
        if paths.poll(now_ns, session.state == "resuming"):
            core.handle(Reached(), now_ns)
