"""The writer of one recording: `python -m cogrip.protocol.io.recording_process RING FILE`, its task on standard input.

It ends when the loop has marked the end of its messages, or is gone: then its end of standard input closes. Meanwhile it
reads the ring twenty times a second and flushes whole chunks at least four times a second.
"""

import json
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO, cast

from cogrip.machine.platform import system, time
from cogrip.machine.ring import Ring
from cogrip.protocol.recording.header import header_of
from cogrip.protocol.recording.records import Clock, Gap
from cogrip.protocol.recording.sink import encode, text_of
from cogrip.protocol.recording.writer import RecordingWriter

TAKE_EVERY_S = 0.05
FLUSH_EVERY_S = 0.2
CLOCK_EVERY_S = 1.0
MOST_HELD_BYTES = 1 << 20


class WholePieces:
    """The output file: keeps data until `flush`, which writes all of it or, when the disk is full, nothing."""

    def __init__(self, fd: int) -> None:
        self.fd = fd
        self._held = bytearray()
        self._at = 0

    @property
    def held_bytes(self) -> int:
        return len(self._held)

    def write(self, data: bytes) -> int:
        self._held += data
        if len(self._held) >= MOST_HELD_BYTES:
            self.flush()
        return len(data)

    def tell(self) -> int:
        return self._at + len(self._held)

    def flush(self) -> None:
        held, self._held = self._held, bytearray()
        piece = memoryview(held)
        try:
            while piece:
                piece = piece[os.write(self.fd, piece) :]
        except OSError:
            os.ftruncate(self.fd, self._at)
            raise
        self._at += len(held)


class RecordingTask:
    """One recording, from its first message to its last."""

    def __init__(self, ring: Ring, fd: int, task: dict[str, object]) -> None:
        self.ring = ring
        self._path = Path(str(task["path"]))
        metadata = task["header"]
        assert isinstance(metadata, dict)
        header = header_of(metadata)
        self._gap, self._clock = header.topics.index(f"/{header.who}/gap"), header.topics.index(f"/{header.who}/clock")
        self._lost = self._put = self._dated = 0
        self._last_ns = 0
        self._floor_bytes = int(str(task.get("floor_bytes", 0)))
        self._well = True
        self._gone = False
        self._stream = WholePieces(fd)
        self._writer = RecordingWriter(cast(IO[bytes], self._stream), header, self._path.parent)
        self._try(self._writer.flush)

    def _try(self, act: Callable[..., None], *arguments: object) -> None:
        if not self._well:
            return
        try:
            act(*arguments)
        except OSError as error:
            self._well = False
            self.ring.say(f"{self._path}: {error.strerror}; what was written before stays readable")

    def take(self) -> None:
        """Write the messages of the ring; without a file drop them, so that the loop's count stays true."""
        for topic, time_ns, payload in self.ring.take():
            self._last_ns = time_ns
            if self.ring.missed > self._lost:
                self._note_gap(self.ring.missed - self._lost)
            try:
                text = text_of(payload)
            except Exception:  # noqa: BLE001 - one record that cannot be read ends no recording
                self._put_gap(1, "a record could not be read")
                continue
            self._try(self._writer.put, topic, time_ns, text)
            self._put += self._well
            if self._stream.held_bytes >= MOST_HELD_BYTES // 2:
                self.flush()  # before the stream does it by itself: what is in the file is counted

    def anchor(self) -> None:
        """Record both clocks together, if there are messages since the last time."""
        if self._put == self._dated:
            return
        self._dated = self._put
        now_ns = time.monotonic_ns()
        self._try(self._writer.put, self._clock, now_ns, encode(Clock(now_ns, time.time_ns())))

    def flush(self) -> None:
        self._try(self._writer.flush)
        self._keep_the_file()
        self._count()
        self._keep_room()

    def _keep_room(self) -> None:
        """Close the file while others still have room: the floor is for what a server cannot do without."""
        if not (self._well and self._floor_bytes):
            return
        free_bytes = system.free_bytes(self._stream.fd)
        if free_bytes is None or free_bytes >= self._floor_bytes:
            return
        self._try(self._writer.finish, False)
        self._try(self._stream.flush)
        self._count()
        if self._well:
            self._well = False
            self.ring.say(
                f"{self._path}: {free_bytes / 1e9:.2f} GB are free there, less than {self._floor_bytes / 1e9:g}; "
                "make room and start anew; what was written before is whole"
            )

    def _keep_the_file(self) -> None:
        """Put the file back if it was removed meanwhile, else count nothing of it as saved."""
        if self._gone or not system.removed(self._stream.fd):
            return
        try:
            self._rescue()
        except OSError as error:
            self._well, self._gone = False, True
            self.ring.saved = 0
            self.ring.say(f"{self._path}: the file is gone: it was removed and cannot be put back: {error.strerror}")

    def _count(self) -> None:
        if self._well:
            self.ring.saved = self._put

    def _rescue(self) -> None:
        """Restore the file from its descriptor. Raises OSError: what a disk had room for stays there, and is not counted."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        fd = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o644)
        try:
            system.copy(self._stream.fd, fd)
            os.dup2(fd, self._stream.fd)
        finally:
            os.close(fd)
        with suppress(OSError):
            system.lock(self._stream.fd)

    def finish(self, cut: bool) -> None:
        """Write what is left and close the file. cut: the loop is gone, perhaps between two messages that belong together."""
        self.take()
        if self.ring.lost_there > self._lost:
            self._note_gap(self.ring.lost_there - self._lost)
        self.anchor()
        self._try(self._writer.flush)
        self._count()
        self._try(self._writer.finish, cut)
        self._try(self._stream.flush)
        self._keep_the_file()

    def _note_gap(self, messages: int) -> None:
        self._lost += messages
        self._put_gap(messages, "the ring was full")

    def _put_gap(self, messages: int, reason: str) -> None:
        self._try(self._writer.put, self._gap, self._last_ns, encode(Gap(messages, reason)))


def main(arguments: list[str]) -> int:
    system.ignore_end_signals()  # it ends when the loop does, not before
    system.ordinary_priority()
    ring, file = map(system.descriptor_of, map(int, arguments))
    source = sys.stdin.buffer
    task = RecordingTask(Ring(ring), file, json.loads(source.readline()))
    ended = system.end_of_input(source)
    if not system.LOCKS_ARE_INHERITED:
        with suppress(OSError):
            system.lock(file)
    flushed = anchored = 0.0
    while not task.ring.finished:
        now = time.monotonic()
        task.take()
        if now - anchored >= CLOCK_EVERY_S:
            anchored = now
            task.anchor()
        if now - flushed >= FLUSH_EVERY_S - TAKE_EVERY_S:
            flushed = now
            task.flush()
        if ended(TAKE_EVERY_S):  # closed: nobody is left on the other side
            break
    task.finish(cut=not task.ring.finished)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
