"""Outages of a link, periodic and by script, and scripts as files.

Times count from the link's origin. At an outage's end the link is up again; outages that touch or overlap are one.
"""

import csv
from bisect import bisect_right
from collections.abc import Iterable
from pathlib import Path

from cogrip.protocol.foreign_file import ForeignFileError
from cogrip.protocol.settings.link_profile import Direction

MOST_S = 1e9  # largest value of any of an outage's times
NEVER_NS = 1 << 62
"""146 years: an outage that never comes."""
MOST_ROWS = 100_000
_DIRECTIONS: dict[str, tuple[Direction, ...]] = {"up": ("up",), "down": ("down",), "": ("up", "down")}


class Outages:
    """Periodic outages, outage_s long at every multiple of outage_every_s but 0, and scripted (start_s, length_s)."""

    __slots__ = ("_begins", "_ends", "_every_ns", "_length_ns")

    def __init__(
        self, outage_s: float = 0.0, outage_every_s: float = 0.0, script: Iterable[tuple[float, float]] = ()
    ) -> None:
        """Check and sort them. Raises ValueError, naming value, bound and cure, for outages that no link can have."""
        for name, value in (("outage_s", outage_s), ("outage_every_s", outage_every_s)):
            if not 0.0 <= value <= MOST_S:
                raise ValueError(f"link {name} = {value} is outside 0 to {MOST_S:g}")
        if (outage_s > 0.0 or outage_every_s > 0.0) and not 0.0 < outage_s < outage_every_s:
            raise ValueError(
                f"link outage_s = {outage_s} must be above 0 and below outage_every_s = {outage_every_s}, which counts "
                "from one outage's begin to the next"
            )
        self._length_ns = round(outage_s * 1e9)
        self._every_ns = round(outage_every_s * 1e9)
        self._begins: list[int] = []
        self._ends: list[int] = []
        for start_s, length_s in sorted(script):
            if not (0.0 <= start_s <= MOST_S and 0.0 < length_s <= MOST_S):
                raise ValueError(
                    f"link outages: {length_s} s at {start_s} s: each must be longer than 0 and begin at 0 or later, both at "
                    f"most {MOST_S:g} s"
                )
            begin, end = round(start_s * 1e9), round((start_s + length_s) * 1e9)
            if self._ends and begin <= self._ends[-1]:
                self._ends[-1] = max(end, self._ends[-1])
            else:
                self._begins.append(begin)
                self._ends.append(end)

    def __bool__(self) -> bool:
        """Return whether there are any."""
        return bool(self._length_ns or self._begins)

    def down_at(self, elapsed_ns: int) -> bool:
        """Return whether the link is down `elapsed_ns` after its origin."""
        if self._length_ns and elapsed_ns >= self._every_ns and elapsed_ns % self._every_ns < self._length_ns:
            return True
        last = bisect_right(self._begins, elapsed_ns) - 1
        return last >= 0 and elapsed_ns < self._ends[last]

    def next_begin_ns(self, elapsed_ns: int) -> int:
        """Return when the first outage after `elapsed_ns` begins; NEVER_NS if none will."""
        found = NEVER_NS
        if self._length_ns:
            found = (elapsed_ns // self._every_ns + 1) * self._every_ns
        later = bisect_right(self._begins, elapsed_ns)
        return min(found, self._begins[later]) if later < len(self._begins) else found


class ScriptError(ForeignFileError, ValueError):
    """A script of outages that cannot be read, or with impossible values."""


def read_script(path: Path) -> dict[Direction, tuple[tuple[float, float], ...]]:
    """Return (start_s, length_s) of each outage in a file, by direction. Raises ScriptError, naming file and line.

    A line `start_s,length_s` or `start_s,length_s,way`, then a row for each; way: `up`, `down`, or empty for both directions.
    Rows may be in any order; those that overlap are one.
    """
    found: dict[Direction, list[tuple[float, float]]] = {"up": [], "down": []}
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            head = [name.strip() for name in next(reader, [])]
            if head not in (["start_s", "length_s"], ["start_s", "length_s", "way"]):
                raise ScriptError(
                    f"{path}:1: the first line is {','.join(head)!r}; it must be start_s,length_s or start_s,length_s,way"
                )
            for row in reader:
                if not row:
                    continue
                try:
                    start_s, length_s, directions = _read_row(row)
                except ScriptError as error:
                    raise ScriptError(f"{path}:{reader.line_num}: {error}") from None
                for direction in directions:
                    found[direction].append((start_s, length_s))
                    if len(found[direction]) > MOST_ROWS:
                        raise ScriptError(f"{path}: there are more than {MOST_ROWS} rows; cut the script")
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        why = getattr(error, "strerror", None) or error
        raise ScriptError(f"{path}: cannot be read: {why}; give the path of a CSV file with start_s,length_s") from None
    return {direction: tuple(outages) for direction, outages in found.items()}


def _read_row(row: list[str]) -> tuple[float, float, tuple[Direction, ...]]:
    texts = [text.strip() for text in row]
    if len(texts) not in (2, 3):
        raise ScriptError(f"{len(texts)} columns; a row is start_s,length_s or start_s,length_s,way")
    try:
        start_s, length_s = float(texts[0]), float(texts[1])
    except ValueError:
        raise ScriptError(f"{','.join(texts)}: start_s and length_s must be numbers") from None
    if not (0.0 <= start_s <= MOST_S and 0.0 < length_s <= MOST_S):
        raise ScriptError(
            f"an outage of {length_s:g} s at {start_s:g} s: it must be longer than 0 and begin at 0 or later, both at most "
            f"{MOST_S:g} s"
        )
    directions = _DIRECTIONS.get(texts[2] if len(texts) == 3 else "")
    if directions is None:
        raise ScriptError(f"way = {texts[2]!r}: write up, down, or nothing for both")
    return start_s, length_s, directions
