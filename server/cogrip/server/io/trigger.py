"""Trigger line on a serial port: each marker raises RTS or DTR for a while, or sends a byte, for an amplifier of EEG.

A thread of its own writes, so that no loop waits for a port. What it measures is when the write returned; a converter on USB
and the amplifier's own sampling come on top.
"""

import errno
import os
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from queue import SimpleQueue
from typing import Literal, NamedTuple, get_args

import serial

Signal = Literal["rts", "dtr", "byte"]

BAUD = 115_200
PULSE_S = 0.01  # time for which a line stays up, or until 0 follows a byte
CODES = 255  # number of codes, bytes 1 to 255 in turn; 0 is rest
MOST_WAITING = 64
WRITE_LIMIT_S = 0.5
END_S = 2.0
ANY = "*"
"""Marker that stands for all that have no code of their own."""


class TriggerError(Exception):
    """The port cannot be had. The text says why and what to do."""


class Written(NamedTuple):
    """A marker that reached the port: at_ns, of `monotonic_ns`, and after_ns from when it was asked for."""

    text: str
    code: int
    after_ns: int
    at_ns: int


class TriggerLine:
    """A serial port as a trigger. `raise_` and `rest` block for as long as the port does."""

    def __init__(self, address: str) -> None:
        """address: rts:PORT, dtr:PORT or byte:PORT. Raises TriggerError."""
        signal, colon, path = address.partition(":")
        if not colon or not path or signal not in get_args(Signal):
            raise TriggerError(
                f"{address!r} is no trigger; give rts:PORT, dtr:PORT or byte:PORT, such as rts:/dev/ttyUSB0"
            )
        self.address = address
        self._signal = signal
        line = self.line = serial.Serial(baudrate=BAUD, timeout=0, write_timeout=WRITE_LIMIT_S, exclusive=True)
        line.port = path
        line.rts = line.dtr = False
        try:
            line.open()
            self.rest()
        except (OSError, ValueError) as error:  # SerialException is an OSError
            line.close()
            raise TriggerError(f"{address}: {_reason(error, signal)}") from None

    def raise_(self, code: int) -> None:
        """Raise the line, or send the byte `code`. Raises OSError."""
        if self._signal == "byte":
            self.line.write(bytes([code]))
            self.line.flush()
        else:
            setattr(self.line, self._signal, True)

    def rest(self) -> None:
        """Lower the line, or send 0. Raises OSError."""
        if self._signal == "byte":
            self.line.write(b"\0")
        else:
            setattr(self.line, self._signal, False)

    def close(self) -> None:
        """Lower the line, and close the port."""
        with suppress(OSError):
            self.rest()
        self.line.close()


def _reason(error: Exception, signal: str) -> str:
    number = getattr(error, "errno", None)
    if number in (errno.ENOTTY, errno.EINVAL) and signal != "byte":
        return f"has no line {signal.upper()}; take byte:PORT, or a real serial port"
    reason = os.strerror(number) if number else str(error).splitlines()[0]
    if number == errno.EACCES:
        return f"{reason}; give yourself the right to it (the group dialout)"
    if number in (errno.EBUSY, errno.EAGAIN):
        return f"{reason}; close the program that uses it"
    return f"{reason}; plug it in, or name another port"


class Trigger:
    """Writes markers to a line, in a thread. counts: those that were not, by reason; trouble: why the first was not, once."""

    def __init__(self, line: TriggerLine, codes: Mapping[str, int] | None = None) -> None:
        """codes: by the words of a marker, of which those without one are not written; none: all are, by codes in turn."""
        self.counts: Counter[str] = Counter()
        self.trouble = ""
        self._line = line
        self._codes = codes or {}
        self._asked: SimpleQueue[tuple[str, int, int] | None] = SimpleQueue()
        self._written: deque[Written] = deque(maxlen=MOST_WAITING)
        self._thread = threading.Thread(target=self._run, name="trigger", daemon=True)
        self._thread.start()

    def fire(self, text: str) -> None:
        """Ask for a pulse for a marker; returns at once."""
        words = text.partition("marker: ")[2]
        code = self._codes.get(words, self._codes.get(ANY, 0))
        if self._codes and not code:
            return
        if self._asked.qsize() >= MOST_WAITING:
            self.counts["trigger: too many markers"] += 1
        else:
            self._asked.put((text, code, time.monotonic_ns()))

    def take(self) -> list[Written]:
        """Return what was written since the last call."""
        found = []
        while self._written:
            found.append(self._written.popleft())
        return found

    def close(self) -> None:
        """Write what is still asked for, and close the port; a port that hangs is left to itself."""
        self._asked.put(None)
        self._thread.join(END_S)

    def _run(self) -> None:
        turn = 0
        while (asked := self._asked.get()) is not None:
            text, code, asked_ns = asked
            turn = turn % CODES + 1
            code = code or turn
            try:
                self._line.raise_(code)
                now_ns = time.monotonic_ns()
                self._written.append(Written(text, code, now_ns - asked_ns, now_ns))
                time.sleep(PULSE_S)
                self._line.rest()
            except Exception as error:  # noqa: BLE001 (a port that is pulled out while it drains raises termios.error)
                self.counts["trigger not written"] += 1
                self.trouble = self.trouble or f"{self._line.address}: {_reason(error, '')}: markers reach it no more"
        self._line.close()


def measure(line: TriggerLine, times: int) -> tuple[list[float], list[float]]:
    """Return the times [s] that writes took, and until they came back: a byte on RX, RTS on CTS, DTR on DSR, by a bridged plug.

    The second list is empty where nothing comes back.
    """
    port = line.line
    answers: dict[str, Callable[[], bool]] = {
        "rts": lambda: port.cts, "dtr": lambda: port.dsr, "byte": lambda: port.in_waiting > 0
    }  # fmt: skip
    came_back = answers[line.address.partition(":")[0]]
    writes: list[float] = []
    loops: list[float] = []
    for turn in range(times):
        began_ns = time.monotonic_ns()
        line.raise_(turn % CODES + 1)
        writes.append(1e-9 * (time.monotonic_ns() - began_ns))
        while (
            not (came := came_back()) and time.monotonic_ns() - began_ns < WRITE_LIMIT_S * 1e9 and (loops or not turn)
        ):
            time.sleep(0)
        if came:
            loops.append(1e-9 * (time.monotonic_ns() - began_ns))
        time.sleep(PULSE_S)
        line.rest()
        time.sleep(PULSE_S)
        if port.in_waiting:
            port.reset_input_buffer()
    return writes, loops
