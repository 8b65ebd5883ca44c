"""The live observer: one thread, some fifty looks a second, no device and no recording."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from cogrip.client.inputs import Leave, Poll
from cogrip.client.io.paths import POLL_S, Paths
from cogrip.client.observer import ObserverCore
from cogrip.protocol.io.stop import Stop

LOOK_S = 0.02


@dataclass(slots=True)
class LiveObserver:
    """`run` blocks until the looking on has ended. show: called after every look with the core and the time [ns]."""

    core: ObserverCore
    calls: Paths
    stop: Stop
    say: Callable[[str], None]
    show: Callable[[ObserverCore, int], None]
    seconds: float | None = None

    def run(self) -> str:
        """Why it ended badly, "" if it did not. Raises JoinError when there is no place to be had."""
        core, session = self.core, self.core.session
        if session.state == "idle":
            self.calls.call(core, self.stop)
        end_ns = None if self.seconds is None else time.monotonic_ns() + round(self.seconds * 1e9)
        told = session.state
        while session.state != "closed" and not self.stop.reason:
            now_ns = time.monotonic_ns()
            if end_ns is not None and now_ns >= end_ns:
                break
            self._exchange(now_ns)
            if session.state != told:
                self._tell(told, session.state)
                told = session.state
            self.show(core, now_ns)
            time.sleep(LOOK_S)
        core.handle(Leave(self.stop.reason or "seen enough"), time.monotonic_ns())
        while session.state == "leaving":
            self._exchange(time.monotonic_ns())
            time.sleep(POLL_S)
        trouble = self.calls.failed
        return f"{session.failed}; the last way to it: {trouble}" if session.failed and trouble else session.failed

    def _exchange(self, now_ns: int) -> None:
        core, session, calls = self.core, self.core.session, self.calls
        core.handle(Poll(), now_ns)
        while core.outbox:
            message = core.outbox.popleft()
            calls.send(message, message == session.hello)
        calls.drain(now_ns, core.receive, session.answers)
        calls.poll(now_ns, session.state == "resuming")

    def _tell(self, before: str, after: str) -> None:
        if after == "resuming":
            self.say("the server is silent: trying to come back")
        elif before == "resuming" and after == "seated":
            self.say(f"back after {self.core.session.away_ns / 1e9:.1f} s")
