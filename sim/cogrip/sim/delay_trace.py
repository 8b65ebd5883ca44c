"""A recorded delay trace: the delay and loss that a real network gave each moment, looked up by the time of sending.

A file has a line `t_s,delay_ms` and then rows. t_s: time of sending, rising, counted from the first row. delay_ms: one-way
delay of what is sent from then until the next row; empty or `lost`: it is lost. The last row holds as long as the one before
it, and then the trace begins again. Further columns are ignored.
"""

import csv
import math
from array import array
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path

from cogrip.protocol.foreign_file import ForeignFileError

MOST_ROWS = 5_000_000
MOST_MS = 10_000.0
MOST_S = 1e6
COLUMNS = ("t_s", "delay_ms")
LOST_NS = -1


class TraceError(ForeignFileError, ValueError):
    """A delay trace that cannot be read, or with values that no network has."""


class DelayTrace:
    """A periodic delay trace over time."""

    __slots__ = ("_delays_ns", "_period_ns", "_times_ns")

    def __init__(self, rows: Iterable[tuple[float, float | None]]) -> None:
        """Keep rows of (t_s, delay_ms), delay_ms None for lost. Raises TraceError."""
        self._times_ns = array("q")
        self._delays_ns = array("q")
        first = None
        for t_s, delay_ms in rows:
            first = t_s if first is None else first
            if not t_s - first <= MOST_S:
                raise TraceError(f"t_s = {t_s:g} is more than {MOST_S:g} s after the first row")
            time_ns = round(max(-1.0, t_s - first) * 1e9)
            if self._times_ns and time_ns <= self._times_ns[-1]:
                raise TraceError(f"t_s = {t_s:.9g} is not after the row before it; sort the rows by time of sending")
            if delay_ms is not None and not 0.0 <= delay_ms <= MOST_MS:
                raise TraceError(
                    f"delay_ms = {delay_ms:g} is outside 0 to {MOST_MS:g}; leave it empty where it was lost"
                )
            self._times_ns.append(time_ns)
            self._delays_ns.append(LOST_NS if delay_ms is None else round(delay_ms * 1e6))
            if len(self._times_ns) > MOST_ROWS:
                raise TraceError(f"there are more than {MOST_ROWS} rows; cut the trace, or record it at a lower rate")
        if not self._times_ns:
            raise TraceError("there are no rows; a trace needs at least one")
        times = self._times_ns
        self._period_ns = times[-1] + (times[-1] - times[-2] if len(times) > 1 else 1)

    def __len__(self) -> int:
        return len(self._times_ns)

    def delay_ns(self, elapsed_ns: int) -> int:
        """Return the delay of a datagram sent `elapsed_ns` after the link's origin; LOST_NS where it is lost."""
        return self._delays_ns[bisect_right(self._times_ns, elapsed_ns % self._period_ns) - 1]


def read_trace(path: Path) -> DelayTrace:
    """Read the trace in a file. Raises TraceError, naming file and line."""
    try:
        stat = path.stat()
        return _read(path, stat.st_mtime_ns, stat.st_size)
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or error
        raise TraceError(f"{path}: cannot be read: {why}; give the path of a CSV file with t_s,delay_ms") from None


@lru_cache(maxsize=8)  # every link of a session, and every session of a sweep, has the same one
def _read(path: Path, changed_ns: int, size: int) -> DelayTrace:
    with path.open(newline="", encoding="utf-8-sig") as file:
        reader = csv.reader(file)
        try:
            return DelayTrace(_rows(reader))
        except (TraceError, csv.Error) as error:
            raise TraceError(f"{path}:{max(1, reader.line_num)}: {error}") from None


def _rows(reader: Iterator[list[str]]) -> Iterator[tuple[float, float | None]]:
    head = [name.strip() for name in next(reader, [])]
    if any(name not in head for name in COLUMNS):
        raise TraceError(f"the first line is {','.join(head)!r}; it must name the columns {' and '.join(COLUMNS)}")
    at, delay = (head.index(name) for name in COLUMNS)
    for row in reader:
        if not row:
            continue
        if len(row) <= max(at, delay):
            raise TraceError(f"{len(row)} columns, and {len(head)} are named in the first line")
        text = row[delay].strip()
        yield _number("t_s", row[at]), None if text in ("", "lost") else _number("delay_ms", text)


def _number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise TraceError(f"{name} = {text.strip()!r} is no number")
    return value
