"""A shared-memory ring of fixed rows: what a loop did, tick by tick, for whoever wants to look.

The loop's cost is one pack and one counter. Readers (a live table, a report, a recorder) map the same file from other
processes and never slow the writer; what they are too slow for is overwritten, and they can tell by `count`.

    0      8 bytes   magic "cogrip01"
    8      u64       rows written so far; row r stands at HEADER_BYTES + (r % capacity) * 8 * columns
    16     u32       length of the JSON that follows: {"columns", "capacity", "rate_hz", "who", "start_ns"}
    20     JSON, padded with zeros to HEADER_BYTES
"""

import json
import mmap
import os
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

MAGIC = b"cogrip01"
HEADER_BYTES = 32_768
MAX_BYTES = 256 * 2**20  # a longer run overwrites its oldest rows


class TraceWriter:
    """Makes the file at `path`. Rows are float64, shape (columns,).

    Raises FileExistsError rather than overwrite a file, OSError where there is no room for the whole ring: a mapped file
    that runs out of disk later would kill the loop.
    """

    __slots__ = ("_about", "_capacity", "_count", "_map", "_row", "_width", "columns")

    def __init__(
        self, path: Path, columns: Sequence[str], *, rate_hz: int, seconds: float, who: str, start_ns: int = 0
    ) -> None:
        width = 8 * len(columns)
        wanted = int(seconds * rate_hz) + 2 * rate_hz
        self._capacity = max(1, min(wanted, MAX_BYTES // width))
        self._width = width
        self._row = struct.Struct(f"<{len(columns)}d")
        self._count = 0
        self.columns = tuple(columns)
        self._about: dict[str, Any] = {
            "columns": list(columns), "capacity": self._capacity, "rate_hz": rate_hz, "who": who, "start_ns": start_ns
        }  # fmt: skip
        size = HEADER_BYTES + self._capacity * width
        with path.open("x+b") as file:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, size)
            else:
                file.truncate(size)
            self._map = mmap.mmap(file.fileno(), 0)
        self._map[0:8] = MAGIC
        struct.pack_into("<Q", self._map, 8, 0)
        self._write_header()

    def _write_header(self) -> None:
        text = json.dumps(self._about).encode()
        if len(text) > HEADER_BYTES - 20:
            raise ValueError(f"{len(self.columns)} columns do not fit the header of {HEADER_BYTES} bytes; use fewer")
        struct.pack_into("<I", self._map, 16, len(text))
        self._map[20:HEADER_BYTES] = text.ljust(HEADER_BYTES - 20, b"\0")

    def begin(self, start_ns: int) -> None:
        """The clock's reading [ns] at which `time_s` is 0, once it is known."""
        self._about["start_ns"] = start_ns
        self._write_header()

    def append(self, row: Sequence[float]) -> None:
        count = self._count
        self._row.pack_into(self._map, HEADER_BYTES + (count % self._capacity) * self._width, *row)
        self._count = count + 1
        struct.pack_into("<Q", self._map, 8, count + 1)

    def close(self) -> None:
        """Flush, and give back the space that was never written."""
        rows = max(1, self._count)
        if rows < self._capacity:
            self._about["capacity"] = rows
            self._write_header()
        self._map.flush()
        if rows < self._capacity:
            self._map.resize(HEADER_BYTES + rows * self._width)
        self._map.close()


def open_trace(
    path: Path | None, columns: Sequence[str], *, rate_hz: int, seconds: float, who: str, say: Callable[[str], None]
) -> TraceWriter | None:
    """A trace for a live loop; where it cannot be had, that is said and the session goes on without."""
    if path is None:
        return None
    try:
        return TraceWriter(path, columns, rate_hz=rate_hz, seconds=seconds, who=who)
    except OSError as error:
        say(f"no trace of this session: {path}: {error.strerror}")
        return None


class TraceReader:
    """Maps a trace, finished or still being written. Raises ValueError for a file that is not one."""

    def __init__(self, path: Path) -> None:
        with path.open("rb") as file:
            self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        if len(self._map) < HEADER_BYTES or self._map[0:8] != MAGIC:
            self._map.close()
            raise ValueError(f"{path} is not a cogrip trace")
        (length,) = struct.unpack_from("<I", self._map, 16)
        about = json.loads(self._map[20 : 20 + length])
        self.columns: tuple[str, ...] = tuple(about["columns"])
        self.capacity: int = about["capacity"]
        self.rate_hz: int = about["rate_hz"]
        self.who: str = about["who"]
        self.start_ns: int = about["start_ns"]
        self._row = struct.Struct(f"<{len(self.columns)}d")

    @property
    def count(self) -> int:
        """Rows written so far, those overwritten included."""
        count: int = struct.unpack_from("<Q", self._map, 8)[0]
        return count

    def newest(self) -> dict[str, float] | None:
        """The last complete row by column name, None before the first."""
        count = self.count
        if not count:
            return None
        at = HEADER_BYTES + ((count - 1) % self.capacity) * self._row.size
        return dict(zip(self.columns, self._row.unpack_from(self._map, at), strict=True))

    def body(self) -> tuple[memoryview, int]:
        """(all rows as they stand, index of the oldest): row-major float64, shape (rows, columns)."""
        count = self.count
        rows = min(count, self.capacity)
        oldest = count % self.capacity if count > self.capacity else 0
        return memoryview(self._map)[HEADER_BYTES : HEADER_BYTES + rows * self._row.size], oldest

    def close(self) -> None:
        self._map.close()
