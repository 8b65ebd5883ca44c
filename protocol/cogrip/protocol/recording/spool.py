"""Bytes kept until the end of a recording, however long it is: the last in memory, the others in a file without a name."""

import tempfile
from collections.abc import Iterator
from io import FileIO
from pathlib import Path

HELD_BYTES = 64 * 1024


class Spool:
    """Keeps what is appended, in order. Short recordings make no file; a killed process leaves none behind."""

    def __init__(self, folder: Path | None) -> None:
        """The file lies in `folder` where it can, else where the system keeps such files."""
        self._folder = folder
        self._held = bytearray()
        self._file: FileIO | None = None
        self._flush_above = HELD_BYTES
        self.length = 0  # bytes, of all that was appended

    @property
    def held_bytes(self) -> int:
        """Bytes in memory: at most HELD_BYTES, but for what could not be written to the file."""
        return len(self._held)

    def append(self, data: bytes) -> None:
        """Append bytes. Where the file cannot be made or is full, all stay in memory until another try HELD_BYTES later.

        Raises OSError only where half a write cannot be taken back: a broken disk.
        """
        self._held += data
        self.length += len(data)
        if len(self._held) > self._flush_above:
            self._flush_above = HELD_BYTES if self._flush() else len(self._held) + HELD_BYTES

    def _flush(self) -> bool:
        """Move all from memory to the file; return False, with both unchanged, where that fails."""
        try:
            if self._file is None:
                self._file = _file_in(self._folder)
        except OSError:
            return False
        at = self.length - len(self._held)
        self._file.seek(at)
        rest = memoryview(bytes(self._held))
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError:  # a full disk takes a part first
            self._file.truncate(at)
            return False
        self._held.clear()
        return True

    def pieces(self) -> Iterator[bytes]:
        """Yield all bytes, in pieces of HELD_BYTES at most, at least one piece. Raises OSError."""
        if self._file is not None:
            self._file.seek(0)
            while piece := self._file.read(HELD_BYTES):
                yield piece
        yield bytes(self._held[:HELD_BYTES])
        for begin in range(HELD_BYTES, len(self._held), HELD_BYTES):
            yield bytes(self._held[begin : begin + HELD_BYTES])

    def close(self) -> None:
        """Drop everything."""
        self._held.clear()
        if self._file is not None:
            self._file.close()


def _file_in(folder: Path | None) -> FileIO:
    try:
        return tempfile.TemporaryFile("w+b", buffering=0, dir=folder)
    except OSError:  # the folder may have been removed: it comes back only when the recording is flushed
        return tempfile.TemporaryFile("w+b", buffering=0)
