"""A script of outages as a file: a line `start_s,length_s` or `start_s,length_s,way`, then a row for each.

way, the direction: `up`, `down`, or empty for both. Rows in any order; those that overlap are one.
"""

import csv
from pathlib import Path

from cogrip.protocol.link_profile import Direction
from cogrip.sim.session.outages import MOST_S

MOST_ROWS = 100_000
_DIRECTIONS: dict[str, tuple[Direction, ...]] = {"up": ("up",), "down": ("down",), "": ("up", "down")}


class ScriptError(ValueError):
    """A script of outages that cannot be read, or with impossible values."""


def read_script(path: Path) -> dict[Direction, tuple[tuple[float, float], ...]]:
    """Return (start_s, length_s) of each outage, by direction. Raises ScriptError, naming file and line."""
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
