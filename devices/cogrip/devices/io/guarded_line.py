"""A serial line with a guard process behind it, for boards that hold their last torque for ever."""

import mmap
import os
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack

import msgspec

from cogrip.devices.device import DeviceError
from cogrip.devices.io.guard import BEATS, PUSHING, READY, STEPPED_IN, WORDS, Goodbye
from cogrip.devices.io.platform import CAN_SHARE
from cogrip.devices.io.serial_line import SerialLine

START_S = 1.5  # longest wait for the guard to start: less than a server waits for a client that says nothing
END_S = 2.0
LOOK_WRITES = 64  # writes from one look whether the guard still lives to the next


def any_number() -> int:
    """A number that another process, or a later one, does not get."""
    return time.time_ns() // 1_000_000_000 + os.getpid()


class GuardedLine(SerialLine):
    """See `ByteLine`. goodbye: what the guard says; asked for when the line is opened.

    A write is the driver's sign of life. After the guard has stepped in, read and write raise once, and no frame but zero
    torque goes out until the line was closed and opened again.
    """

    def __init__(self, path: str, scheme: str, goodbye: Callable[[], Goodbye]) -> None:
        super().__init__(path, scheme)
        self._goodbye = goodbye
        self._zero = b""
        self._stall_ms = 0
        self._words = memoryview(bytearray(8 * WORDS)).cast("Q")
        self._seen = 0
        self._stopped = False
        self._until_look = LOOK_WRITES
        self._end = ExitStack()
        self._guard: subprocess.Popen[bytes] | None = None
        self._keep = -1  # the pipe whose end tells the guard that this process ended
        self._ready = -1  # and the one that ends with the guard

    @property
    def guard_pid(self) -> int | None:
        return self._guard.pid if self._guard is not None else None

    def open(self) -> None:
        """See `SerialLine.open`. Raises DeviceError too where the guard does not start: then there is no force."""
        if not CAN_SHARE:
            raise DeviceError(
                f"{self.name}: its firmware holds the last torque for ever, and the guard process that would take it off"
                " needs a port that two processes share, which this system has not; use it on Linux or macOS"
            )
        super().open()
        try:
            self._start_guard()
        except OSError as error:
            self.close()
            raise DeviceError(
                f"{self.name}: its guard process cannot be started ({error.strerror}), and without it there is no force;"
                f" see that {sys.executable!r} is Python"
            ) from None
        except BaseException:
            self.close()
            raise

    def _start_guard(self) -> None:
        assert self._line is not None
        goodbye, end = self._goodbye(), self._end
        with tempfile.TemporaryFile() as memory:
            memory.truncate(8 * WORDS)
            page = end.enter_context(mmap.mmap(memory.fileno(), 8 * WORDS))
            self._words = end.enter_context(end.enter_context(memoryview(page)).cast("Q"))
            pipe, self._keep = os.pipe()
            self._ready, say = os.pipe()
            end.callback(os.close, self._ready)
            handed = (self._line.fileno(), pipe, say, memory.fileno())
            reported = msgspec.json.encode(goodbye).hex()
            try:
                self._guard = subprocess.Popen(
                    [
                        sys.executable,
                        "-P",
                        "-m",
                        "cogrip.devices.io.guard",
                        str(os.getpid()),
                        *map(str, handed),
                        reported,
                    ],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    pass_fds=handed,
                    start_new_session=True,  # what the terminal sends to its foreground does not reach it
                )
            finally:
                os.close(pipe)
                os.close(say)
        if not select.select([self._ready], [], [], START_S)[0] or os.read(self._ready, 1) != READY:
            raise DeviceError(
                f"{self.name}: its guard process did not start within {START_S:g} s, and without it there is no force;"
                " see what it says on the standard error, then try again"
            )
        self._zero, self._stall_ms = goodbye.zero, goodbye.stall_ns // 1_000_000
        self._seen, self._stopped, self._until_look = 0, False, LOOK_WRITES

    def write(self, frame: bytes) -> None:
        words = self._words
        words[BEATS] += 1
        if words[STEPPED_IN] != self._seen:
            self._step_in()
        self._until_look -= 1
        if self._until_look <= 0:
            self._look()
        if frame != self._zero:
            if self._stopped:
                frame = self._zero
                self.counts["zero torque sent instead"] += 1
            else:
                words[PUSHING] = 1  # before the torque, as it is taken back after the zero
                return super().write(frame)
        super().write(frame)
        words[PUSHING] = 0

    def read(self, wait_s: float = 0.0) -> bytes:
        if self._words[STEPPED_IN] != self._seen:
            self._step_in()
        try:
            return super().read(wait_s)
        except DeviceError:
            if self._words[STEPPED_IN] != self._seen:  # the guard has dropped what this end was about to read
                self._step_in()
            raise

    def _step_in(self) -> None:
        """The loop stood still, and the torque was taken off. Raises DeviceError, once."""
        self.counts["guard stepped in"] += self._words[STEPPED_IN] - self._seen
        self._seen = self._words[STEPPED_IN]
        self._stop()
        raise DeviceError(
            f"{self.name}: nothing was written for {self._stall_ms} ms with a torque on the motors, so its guard took it off;"
            " see that the loop is not held up, then re-arm"
        )

    def _look(self) -> None:
        """Raises DeviceError, once, where there is no guard any more."""
        self._until_look = LOOK_WRITES
        if not self._stopped and self._guard is not None and select.select([self._ready], [], [], 0.0)[0]:
            self.counts["guard lost"] += 1
            self._stop()
            raise DeviceError(
                f"{self.name}: its guard process (pid {self._guard.pid}) has ended; nothing may be pushed without it, re-arm"
            )

    def _stop(self) -> None:
        """A write that was under way when the guard stepped in may have come after it."""
        self._stopped = True
        super().write(self._zero)
        self._words[PUSHING] = 0

    def close(self) -> None:
        """The guard sees its pipe end, says goodbye once more, and ends."""
        guard, self._guard = self._guard, None
        keep, self._keep = self._keep, -1
        if keep >= 0:
            os.close(keep)
        if guard is not None:
            if not select.select([self._ready], [], [], END_S)[0]:
                self.counts["guard had to be ended"] += 1
                guard.kill()
            guard.wait()
        self._words = memoryview(bytearray(8 * WORDS)).cast("Q")
        self._end.close()
        super().close()
