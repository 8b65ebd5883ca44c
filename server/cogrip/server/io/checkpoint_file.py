"""Checkpoint files: a kill at any moment leaves the newest whole version, or the one before.

A loss of power leaves a whole version, too, perhaps one of half a minute before.

A file has three slots of SLOT_BYTES, each a header (magic, number of the version, length and CRC-32) and the content. One
write of WHOLE_EVERY replaces the file, with the first slot alone, and waits for the disk. Those in between overwrite the other
two in turns, in a hundredth of the processor time, and leave the two versions before as they are. The newest version is the
whole one with the highest number.
"""

import struct
import threading
import zlib
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from cogrip.server.io.state_folder import MOST_BYTES, StateError, overwrite_private, read_private, write_private

END_LIMIT_S = 5.0
STACK_BYTES = 1 << 18
WHOLE_EVERY = 64
SLOTS, SLOT_BYTES = 3, MOST_BYTES // 4
MAGIC = b"cogripCP"
HEADER = struct.Struct("<8sQLL")


class WriterThread:
    """A thread in which any number of writers write, one after the other; `begin` or the first `call` starts it.

    Rooms share one: its stack is locked in memory with the rest of the process. A real-time loop calls `begin` ahead: a start
    waits until the new thread, an ordinary one, has had a processor, on a busy machine for some 0.1 s.
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
        self.begin()
        self._wake()

    def begin(self) -> None:
        """Start the thread, unless it is there."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="checkpoints", daemon=True)
            before = threading.stack_size(STACK_BYTES)
            try:
                self._thread.start()
            finally:
                threading.stack_size(before)

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
    trouble                       why the newest one is not written; "" where it is
    say                           reports the first failure of several in a row, in the thread that puts
    thread                        which others share; its own if not given
    whole_every                   one write of so many replaces the file: 1 where other hosts read it
    """

    def __init__(
        self,
        path: Path,
        say: Callable[[str], None] = lambda text: None,
        thread: WriterThread | None = None,
        whole_every: int = WHOLE_EVERY,
    ) -> None:
        self.path = path
        self._whole_every = whole_every
        self.written = self.overtaken = self.failures = 0
        self._say = say
        self.trouble = ""
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
        trouble = self.trouble
        if trouble and not self._reported:
            self._say(f"a server that is started again will not find the object where it is: {trouble}")
        self._reported = bool(trouble)

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
            self._write_slot(self.written % self._whole_every, _slot(self.written, data))
            self.written += 1
            self.trouble = ""
        except Exception as error:  # noqa: BLE001 - whatever it is: the thread goes on, for other rooms and for this one
            self.failures += 1
            self.trouble = str(error) or type(error).__name__

    def _write_slot(self, turn: int, slot: bytes) -> None:
        """Write a version: as a new file at turn 0 or where there is none, else into the slot of this turn.

        A disk without room for a new file may have it in the old one: there no block is new.
        """
        at = SLOT_BYTES * (1 + turn % (SLOTS - 1))
        if turn:
            with suppress(FileNotFoundError):
                overwrite_private(self.path, slot, at)
                return
        try:
            write_private(self.path, slot, durable=False)
        except StateError as full:
            if self.written < SLOTS or self._whole_every == 1:
                raise
            try:
                overwrite_private(self.path, slot, at)
            except FileNotFoundError:
                raise full from None

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


def _slot(number: int, data: bytes) -> bytes:
    """Return a slot with this version. Raises StateError where it has no room for it."""
    if HEADER.size + len(data) > SLOT_BYTES:
        raise StateError(f"a checkpoint of {len(data)} bytes is too long: {SLOT_BYTES - HEADER.size} at most")
    return HEADER.pack(MAGIC, number, len(data), _sum_of(number, data)) + data


def _sum_of(number: int, data: bytes) -> int:
    return zlib.crc32(data, zlib.crc32(number.to_bytes(8, "little")))


def read(path: Path) -> bytes | None:
    """Return the newest whole version, None where there is no file. Raises StateError."""
    try:
        content = read_private(path)
    except FileNotFoundError:
        return None
    newest = max(filter(None, (_version_in(content, slot * SLOT_BYTES) for slot in range(SLOTS))), default=None)
    if newest is None:
        raise StateError(f"{path}: holds no whole checkpoint; it is damaged, or of another version of cogrip")
    return newest[1]


def _version_in(content: bytes, at: int) -> tuple[int, bytes] | None:
    """Return the number and content of the version in a slot, None where there is none, or a torn one."""
    if len(content) < at + HEADER.size:
        return None
    magic, number, length, total = HEADER.unpack_from(content, at)
    data = content[at + HEADER.size :][:length]
    whole = magic == MAGIC and len(data) == length <= SLOT_BYTES - HEADER.size and total == _sum_of(number, data)
    return (number, data) if whole else None


def remove(path: Path) -> None:
    """Remove the file, and a half-written one beside it, where they exist. Raises OSError."""
    for each in (path, path.with_name(f"{path.name}.new")):
        with suppress(FileNotFoundError):
            each.unlink()
