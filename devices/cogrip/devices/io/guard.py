"""A process that takes the torque off a board without a watchdog when the driver cannot: `python -m cogrip.devices.io.guard`.

It inherits the line, a page of memory and a pipe. The driver counts its writes in the page; the pipe ends when the driver does,
whatever it died of. Then, or when a driver that left a torque on the motors has not written for STALL_NS, the guard writes zero
torque. After the end of its driver it ends too; after a stall it goes on guarding, and says so in the page.

It is in a session of its own and ignores signals, so that what a terminal sends to all does not reach it. POSIX only.

    python -m cogrip.devices.io.guard DRIVER_PID PORT_FD PIPE_FD READY_FD PAGE_FD GOODBYE     `Goodbye` as JSON in hex
"""

import mmap
import os
import select
import signal
import sys
import time
from contextlib import suppress

import msgspec

from cogrip.devices.io.platform import IGNORED_BY_GUARD

BEATS, PUSHING, STEPPED_IN = 0, 1, 2
"""Words of the page: writes of the driver; whether the last left a torque on; how often the guard stepped in."""

WORDS = 3
STALL_NS = 36_000_000
"""Longest time between two writes while a torque is on. With LOOK_S before and after, the torque is off within 50
ms."""
LOOK_S = 0.005
REPLY_S = 0.02
TRIES = 5
GOOD = 3  # replies that show that zero was understood: one may be to a request before, one to a frame that was cut off
READY = b"r"


class Goodbye(msgspec.Struct, frozen=True):
    """zero: the frame for no torque; a reply to it begins with reply_head and has reply_bytes bytes.

    last_resort: frames, each in one write, that take the torque off a board that does not understand `zero` any more.
    stall_ns: how long a torque may stay on without a write; reply_s: how long a reply is waited for, and a write.
    """

    zero: bytes
    reply_head: bytes
    reply_bytes: int
    last_resort: tuple[bytes, ...] = ()
    stall_ns: int = STALL_NS
    reply_s: float = REPLY_S


class StallWatch:
    """Tells a driver that stopped with a torque on the motors from one that has nothing to say."""

    def __init__(self, stall_ns: int) -> None:
        self._stall_ns = stall_ns
        self._beats = -1
        self._since_ns = 0
        self._reported = False

    def stalled(self, beats: int, pushing: bool, now_ns: int) -> bool:
        """True once a stall."""
        if beats != self._beats:
            self._beats, self._since_ns, self._reported = beats, now_ns, False
        if self._reported or not pushing or now_ns - self._since_ns < self._stall_ns:
            return False
        self._reported = True
        return True


def take_off(line: int, goodbye: Goodbye) -> bool:
    """Zero torque, until the board has shown that it understood. False where it did not, and got the last resort."""
    good = 0
    for _ in range(TRIES):
        _drop_input(line)
        _write(line, goodbye.zero, goodbye.reply_s)
        good += _reply(line, goodbye)
        if good >= GOOD:
            return True
    for frame in goodbye.last_resort:
        _write(line, frame, goodbye.reply_s)
        select.select([], [], [], 0.002)  # the board reads a frame at a time
    return False


def _write(line: int, frame: bytes, within_s: float) -> None:
    """Write as much as the line takes in that time."""
    until_s = time.monotonic() + within_s
    while frame and (rest_s := until_s - time.monotonic()) > 0.0:
        if select.select([], [line], [], rest_s)[1]:
            with suppress(BlockingIOError):
                frame = frame[os.write(line, frame) :]


def _drop_input(line: int) -> None:
    with suppress(BlockingIOError):
        while select.select([line], [], [], 0.0)[0] and os.read(line, 4096):
            pass


def _reply(line: int, goodbye: Goodbye) -> bool:
    """Return True if a valid reply came in time."""
    data = b""
    until_s = time.monotonic() + goodbye.reply_s
    while len(data) < goodbye.reply_bytes and (rest_s := until_s - time.monotonic()) > 0.0:
        if select.select([line], [], [], rest_s)[0]:
            with suppress(BlockingIOError):
                received = os.read(line, 4096)
                if not received:
                    break
                data += received
    return len(data) >= goodbye.reply_bytes and data.startswith(goodbye.reply_head)


def guard(driver: int, line: int, pipe: int, page: memoryview, goodbye: Goodbye) -> None:
    """Until the process `driver`, its parent, ends."""
    watch = StallWatch(goodbye.stall_ns)
    while True:
        ended = bool(select.select([pipe], [], [], LOOK_S)[0])
        # a child of the driver may have inherited the pipe and hold it open
        if ended or os.getppid() != driver:
            take_off(line, goodbye)
            return
        if watch.stalled(page[BEATS], bool(page[PUSHING]), time.monotonic_ns()):
            page[STEPPED_IN] += 1  # first: a driver that wakes up now must not write over the zero
            take_off(line, goodbye)


def main(arguments: list[str]) -> int:
    for number in IGNORED_BY_GUARD:
        signal.signal(number, signal.SIG_IGN)
    driver, line, pipe, ready, memory = map(int, arguments[:5])
    goodbye = msgspec.json.decode(bytes.fromhex(arguments[5]), type=Goodbye)
    with mmap.mmap(memory, 8 * WORDS) as page, memoryview(page) as raw, raw.cast("Q") as words:
        os.write(ready, READY)
        with suppress(OSError):  # the line is gone, and the torque with the power
            guard(driver, line, pipe, words, goodbye)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
