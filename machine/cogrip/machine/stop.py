"""The stop flag of a loop: signals set it, loops read it once a tick."""

import os
import signal
import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from types import FrameType
from typing import Literal

from cogrip.machine.platform import system

TETHERED = "COGRIP_TETHERED"
"""Environment variable of a child whose standard input is a pipe from its parent: it is to end when that does."""


MOST_TYPED_BYTES = 4096  # most bytes of typed lines that are kept until the line ends: the last ones


@dataclass(slots=True)
class Stop:
    """Requests to a loop.

    reason  why the loop should end, such as "stopped (SIGTERM)"; "" until then
    rearm   leave a fault
    reload  read files anew
    typed   other lines that were typed at the terminal
    """

    reason: str = ""
    signals: int = 0
    rearm: bool = False
    reload: bool = False
    typed: list[str] = field(default_factory=list)

    def take_rearm(self) -> bool:
        """Return whether re-arming was asked for since the last call: by SIGUSR1, or with `r` and Enter at a terminal."""
        self._read()
        if not self.rearm:  # looked at before it is taken back: a signal may come between any two steps
            return False
        self.rearm = False
        return True

    def take_typed(self) -> list[str]:
        """Return the lines other than `r` that were typed at the terminal since the last call."""
        self._read()
        return [self.typed.pop(0) for _ in range(len(self.typed))]  # a thread may append meanwhile

    def _read(self) -> None:
        self.take(system.typed().decode("utf-8", "replace").splitlines())

    def take(self, lines: Iterable[str]) -> None:
        """Take in lines that were typed, here or at the parent's terminal."""
        for line in lines:
            if line.strip().lower() == "r":
                self.rearm = True
            elif line.strip():
                self.typed.append(line.strip())

    def take_reload(self) -> bool:
        """Return whether reloading was asked for since the last call, by SIGHUP."""
        if not self.reload:
            return False
        self.reload = False
        return True


@contextmanager
def on_signals(stop: Stop, hangup: Literal["terminate", "reload"] = "terminate") -> Iterator[Stop]:
    """Let Ctrl-C, SIGTERM and a terminal that closes set `stop`, and SIGUSR1 ask to re-arm, within the context.

    hangup: meaning of a SIGHUP that is not the end of a terminal. A third signal to end interrupts whatever hangs.
    """
    had_terminal = system.has_terminal()
    if os.environ.pop(TETHERED, "") and sys.stdin:
        threading.Thread(target=_follow_parent, args=(stop, sys.stdin.fileno()), daemon=True).start()

    def handle(number: int, frame: FrameType | None) -> None:
        stop.signals += 1
        stop.reason = stop.reason or f"stopped ({signal.Signals(number).name})"
        if stop.signals >= 3:
            raise KeyboardInterrupt

    def hang_up(number: int, frame: FrameType | None) -> None:
        if hangup == "reload" and not (had_terminal and not system.has_terminal()):
            stop.reload = True
        else:
            handle(number, frame)

    def rearm(number: int, frame: FrameType | None) -> None:
        stop.rearm = True

    handlers = dict.fromkeys(system.END_SIGNALS, handle)
    if system.REARM_SIGNAL is not None:
        handlers[system.REARM_SIGNAL] = rearm
    if (
        system.HANGUP_SIGNAL is not None and signal.getsignal(system.HANGUP_SIGNAL) is not signal.SIG_IGN
    ):  # not under nohup
        handlers[system.HANGUP_SIGNAL] = hang_up
    before = [(number, signal.signal(number, handler)) for number, handler in handlers.items()]
    try:
        yield stop
    finally:
        for number, handler in before:
            signal.signal(number, handler)


def _follow_parent(stop: Stop, pipe: int) -> None:
    """Take the parent's lines as if they were typed, until the pipe ends: its `kill -9` must not leave a hand with a force."""
    with suppress(OSError):
        rest = b""
        while piece := os.read(pipe, 1024):
            *lines, rest = (rest + piece)[-MOST_TYPED_BYTES:].split(b"\n")
            stop.take(line.decode("utf-8", "replace") for line in lines)
    stop.reason = stop.reason or "stopped (its parent has ended)"
