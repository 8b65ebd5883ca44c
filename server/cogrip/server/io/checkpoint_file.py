"""Checkpoint files: a kill at any moment leaves the newest whole version, or the one before.

A loss of power leaves a whole version, too, perhaps one of some seconds before.
"""

import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from cogrip.server.io.state_folder import read_private, write_private

END_LIMIT_S = 5.0
STACK_BYTES = 1 << 18


class WriterThread:
    """A thread in which any number of writers write, one after the other; the first `call` starts it.

    Rooms share one: its stack is locked in memory with the rest of the process.
    """

    def __init__(self) -> None:
        self._due: deque[Callable[[], None]] = deque()
        self._closing = False
        self._news = threading.Lock()  # locked: nothing new. The loop releases it, the thread locks it
        self._news.acquire()
        self._thread: threading.Thread | None = None

    def call(self, write: Callable[[], None]) -> None:
        """Call this in the thread, as soon as possible."""
        self._due.append(write)
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="checkpoints", daemon=True)
            before = threading.stack_size(STACK_BYTES)
            try:
                self._thread.start()
            finally:
                threading.stack_size(before)
        self._wake()

    def _wake(self) -> None:
        if self._news.locked():  # only the thread locks it, only this end releases it: no race
            self._news.release()

    def _run(self) -> None:
        while True:
            self._news.acquire()
            while self._due:
                self._due.popleft()()
            if self._closing:
                return

    def close(self) -> None:
        """Write what waits, and end the thread; a disk that hangs costs END_LIMIT_S at most."""
        if self._thread is not None:
            self._closing = True
            self._wake()
            self._thread.join(END_LIMIT_S)
            self._thread, self._closing = None, False


class CheckpointWriter:
    """Writes the newest content that `put` hands over, in a thread: `put` never waits. One thread puts.

    written, overtaken, failures  counts of what was put
    say                           reports the first failure, in the thread that puts
    thread                        which others share; its own if not given
    """

    def __init__(
        self, path: Path, say: Callable[[str], None] = lambda text: None, thread: WriterThread | None = None
    ) -> None:
        self.path = path
        self.written = self.overtaken = self.failures = 0
        self._say = say
        self._trouble = ""
        self._reported = False
        self._newest: deque[tuple[int, bytes]] = deque(maxlen=1)
        self._put = self._taken = 0
        self._waits = False  # the thread has yet to write
        self._thread = thread or WriterThread()

    def put(self, data: bytes) -> None:
        """Write this as soon as possible, in place of what still waits."""
        self._put += 1
        self._newest.append((self._put, data))
        if not self._waits:
            self._waits = True
            self._thread.call(self._write_newest)
        self._report()

    def _report(self) -> None:
        if self._trouble and not self._reported:
            self._reported = True
            self._say(self._trouble)

    def _write_newest(self) -> None:
        self._waits = False  # before it is looked for: what is put from now on is written by the next call
        try:
            number, data = self._newest.pop()
        except IndexError:  # a call before has written it, or it was removed
            return
        self._write(number, data)

    def _write(self, number: int, data: bytes) -> None:
        self.overtaken += number - self._taken - 1
        self._taken = number
        try:
            write_private(self.path, data, durable=False)
            self.written += 1
        except Exception as error:  # noqa: BLE001 - whatever it is: the thread goes on, for other rooms and for this one
            self.failures += 1
            self._trouble = f"a server that is started again will not find the object where it is: {error}"

    def read(self) -> bytes | None:
        """Return what is there, None for nothing. Raises StateError."""
        return read(self.path)

    def remove(self) -> None:
        """Remove what is there, and what waits. Raises OSError."""
        self._newest.clear()
        remove(self.path)

    def close(self) -> None:
        """Write what waits, and end the thread (`WriterThread.close`)."""
        self._thread.close()
        self._report()


def read(path: Path) -> bytes | None:
    """Return the file's content, None where there is none. Raises StateError."""
    try:
        return read_private(path)
    except FileNotFoundError:
        return None


def remove(path: Path) -> None:
    """Remove the file, and a half-written one beside it, where they exist. Raises OSError."""
    for each in (path, path.with_name(f"{path.name}.new")):
        with suppress(FileNotFoundError):
            each.unlink()
