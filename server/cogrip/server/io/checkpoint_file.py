"""Checkpoint files: a kill at any moment leaves the newest whole version, or the one before."""

import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from cogrip.server.io.state_folder import StateError, read_private, write_private

END_LIMIT_S = 5.0
STACK_BYTES = 1 << 18


class CheckpointWriter:
    """Writes the newest content that `put` hands over, in a thread: `put` never waits. One thread puts.

    written, overtaken, failures  counts of what was put
    say                           reports the first failure, in the thread that puts
    """

    def __init__(self, path: Path, say: Callable[[str], None] = lambda text: None) -> None:
        self.path = path
        self.written = self.overtaken = self.failures = 0
        self._say = say
        self._trouble = ""
        self._reported = False
        self._newest: deque[tuple[int, bytes]] = deque(maxlen=1)
        self._put = self._taken = 0
        self._closing = False
        self._news = threading.Lock()  # locked: nothing new. The loop releases it, the thread locks it
        self._news.acquire()
        self._thread: threading.Thread | None = None

    def put(self, data: bytes) -> None:
        """Write this as soon as possible, in place of what still waits."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name=f"writer of {self.path.name}", daemon=True)
            before = threading.stack_size(STACK_BYTES)  # locked in memory with the rest of the process
            try:
                self._thread.start()
            finally:
                threading.stack_size(before)
        self._put += 1
        self._newest.append((self._put, data))
        self._wake()
        self._report()

    def _report(self) -> None:
        if self._trouble and not self._reported:
            self._reported = True
            self._say(self._trouble)

    def _wake(self) -> None:
        if self._news.locked():  # only the thread locks it, only this end releases it: no race
            self._news.release()

    def _run(self) -> None:
        while True:
            self._news.acquire()
            if self._newest:
                self._write(*self._newest.pop())
            if self._closing and not self._newest:
                return

    def _write(self, number: int, data: bytes) -> None:
        self.overtaken += number - self._taken - 1
        self._taken = number
        try:
            write_private(self.path, data)
            self.written += 1
        except StateError as error:
            self.failures += 1
            self._trouble = f"a server that is started again will not find the object where it is: {error}"

    def read(self) -> bytes | None:
        """Return what is there, None for nothing. Raises StateError."""
        return read(self.path)

    def remove(self) -> None:
        """Remove what is there. Raises OSError."""
        remove(self.path)

    def close(self) -> None:
        """Write what waits, and end the thread; a disk that hangs costs END_LIMIT_S at most."""
        self._closing = True
        if self._thread is not None:
            self._wake()
            self._thread.join(END_LIMIT_S)
            self._thread = None
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
