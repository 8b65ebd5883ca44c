"""Tables of numbers as other programs write them: comma, semicolon or tab between cells, a decimal comma, units in the names.

Lines are counted as in the file, the header being line 1.
"""

import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from cogrip.devices.device import DeviceError
from cogrip.devices.settings import unknown
from cogrip.protocol.addition import add_integers

SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab"}
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6}
SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9}
_BRACKETS = re.compile(r"(?P<name>.*?)\s*[\[(]\s*(?P<unit>[^\])]*?)\s*[\])]")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")


@dataclass(frozen=True, slots=True)
class Table:
    """Column names, and rows with the numbers of their lines; empty lines are no rows."""

    path: str
    separator: str
    names: list[str]
    rows: list[tuple[int, list[str]]]

    def find(self, name: str, key: str) -> int:
        """Place of a column, called as in the file or without its unit in brackets. Raises DeviceError with what there is."""
        if name in self.names:
            return self.names.index(name)
        bare = [place for place, each in enumerate(self.names) if split_unit(each)[0] == name]
        if len(bare) == 1:
            return bare[0]
        where = (
            f"csv hand: {self.path!r} line 1, read with a {SEPARATORS[self.separator]} between columns: {key}={name}"
        )
        raise unknown("column", name, self.names, where)

    def scale(self, at: int, units: Mapping[str, float], given: float | None, key: str) -> float:
        """Return one unit of a column in SI: as `given`, else by the unit in its name, else 1. Raises DeviceError."""
        if given is not None:
            return given
        name = self.names[at]
        unit = split_unit(name)[1]
        if unit and unit not in units:
            raise DeviceError(
                f"csv hand: {self.path!r} line 1, column {name!r}: the unit {unit!r} is none of {', '.join(units)}; say by "
                f"{key}=... what one of it is in {next(iter(units))}"
            )
        return units[unit] if unit else units.get(name.rpartition("_")[2] if "_" in name else "", 1.0)

    def numbers(self, rows: Sequence[Sequence[str]], lines: Sequence[int], at: int) -> list[float]:
        """Column `at` of rows as finite numbers. Raises DeviceError with line and column."""
        found: list[float] = []
        for line, row in zip(lines, rows, strict=True):
            cell = row[at] if at < len(row) else ""
            text = cell.replace(",", ".") if self.separator != "," and _DECIMAL_COMMA.fullmatch(cell) else cell
            try:
                number = float(text)
            except ValueError:
                number = float("nan")
            if not isfinite(number):
                raise DeviceError(
                    f"csv hand: {self.path!r} line {line}: {self.names[at]}={cell!r} is not a finite number; mend or filter "
                    "the row"
                )
            found.append(number)
        return found


def split_unit(name: str) -> tuple[str, str]:
    """`x [mm]` or `x (mm)` as name and unit; the unit is empty where none stands in brackets."""
    match = _BRACKETS.fullmatch(name)
    return (match["name"], match["unit"]) if match else (name, "")


def read_table(path: str, wanted: Sequence[str]) -> Table:
    """Read a file with the separator that gives the columns `wanted`; where none does, the one that gives most columns.

    Raises DeviceError where the file cannot be read, and for a row with more cells than the header.
    """
    try:
        text = _text(Path(path).read_bytes())
        separator = max(SEPARATORS, key=lambda each: _fit(text, each, wanted))
        reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
        names = [name.strip() for name in next(reader, [])]
        table = Table(path, separator, names, [(reader.line_num, row) for row in reader if row])
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DeviceError(
            f"csv hand: cannot read {path!r}: {error}; give the path of a text file with columns"
        ) from error
    for line, row in table.rows:
        if len(row) > len(table.names) and any(row[len(table.names) :]):
            cure = "; where it has decimal commas, put a semicolon between columns" if table.separator == "," else ""
            raise DeviceError(
                f"csv hand: {path!r} line {line}: {len(row)} cells, but {len(table.names)} column names in line 1{cure}"
            )
    return table


def _text(data: bytes) -> str:
    """Decode UTF-8, or what spreadsheets write: UTF-16 with a byte-order mark, Windows-1252."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        if b"\0" in data:
            raise
        return data.decode("cp1252")


def _fit(text: str, separator: str, wanted: Sequence[str]) -> tuple[int, int]:
    """Return how many of the columns `wanted` line 1 has when split so, and how many in all."""
    names = [name.strip() for name in next(csv.reader(io.StringIO(text, newline=""), delimiter=separator), [])]
    known = {each for name in names for each in (name, split_unit(name)[0])}
    return add_integers(name in known for name in wanted), len(names)
