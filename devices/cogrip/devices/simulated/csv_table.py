"""Tables of numbers as other programs write them: comma, semicolon or tab between cells, a decimal comma, units in the names.

Lines are counted as in the file, comments (`#`) and empty ones too. The first line that is neither has the names of the
columns; where it has numbers, the comment before it has them if it fits, else columns are called 1, 2, 3.
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
from cogrip.machine.addition import add_integers

SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab"}
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6}
SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9}
COMMENT = "#"
_BRACKETS = re.compile(r"(?P<name>.*?)\s*[\[(]\s*(?P<unit>[^\])]*?)\s*[\])]")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")


@dataclass(frozen=True, slots=True)
class CsvRows:
    """Column names with the number of their line, and rows with theirs. header: None where no line has names."""

    path: str
    separator: str
    header: int | None
    names: list[str]
    rows: list[tuple[int, list[str]]]

    def find(self, name: str, key: str) -> int:
        """Place of a column, called as in the file or without its unit in brackets. Raises DeviceError with what there is."""
        if name in self.names:
            return self.names.index(name)
        bare = [place for place, each in enumerate(self.names) if split_unit(each)[0] == name]
        if len(bare) == 1:
            return bare[0]
        line = f"line {self.header}" if self.header else "has no line with names, so that columns go by number"
        where = (
            f"csv hand: {self.path!r} {line}, read with a {SEPARATORS[self.separator]} between columns: {key}={name}"
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
                f"csv hand: {self.path!r} line {self.header}, column {name!r}: the unit {unit!r} is none of "
                f"{', '.join(units)}; say by {key}=... what one of it is in {next(iter(units))}"
            )
        return units[unit] if unit else units.get(name.rpartition("_")[2] if "_" in name else "", 1.0)

    def numbers(self, rows: Sequence[Sequence[str]], lines: Sequence[int], at: int) -> list[float]:
        """Column `at` of rows as finite numbers. Raises DeviceError with line and column."""
        found: list[float] = []
        for line, row in zip(lines, rows, strict=True):
            cell = row[at] if at < len(row) else ""
            number = _number(cell, self.separator)
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


def read_table(path: str, wanted: Sequence[str]) -> CsvRows:
    """Read a file with the separator that gives the columns `wanted`; where none does, numbers, and most columns.

    Raises DeviceError where the file cannot be read, and for a row with more cells than there are columns.
    """
    try:
        text = _text(Path(path).read_bytes())
        tables = [_split(path, text, separator, wanted) for separator in SEPARATORS]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DeviceError(
            f"csv hand: cannot read {path!r}: {error}; give the path of a text file with columns"
        ) from error
    table = max(tables, key=lambda each: _fit(each, wanted))
    for line, row in table.rows:
        if len(row) > len(table.names) and any(row[len(table.names) :]):
            cure = "; where it has decimal commas, put a semicolon between columns" if table.separator == "," else ""
            where = f"column names in line {table.header}" if table.header else "in the first row"
            raise DeviceError(f"csv hand: {path!r} line {line}: {len(row)} cells, but {len(table.names)} {where}{cure}")
    return table


def _split(path: str, text: str, separator: str, wanted: Sequence[str]) -> CsvRows:
    """Return the table with this separator."""
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    rows: list[tuple[int, list[str]]] = []
    before: tuple[int | None, list[str]] = None, []  # the comment nearest to the first row
    for row in reader:
        if row and not row[0].lstrip().startswith(COMMENT):
            rows.append((reader.line_num, row))
        elif row and not rows:
            before = reader.line_num, [row[0].lstrip().lstrip(COMMENT), *row[1:]]
    if not rows:
        return CsvRows(path, separator, *_stripped(*before), [])
    line, first = rows[0]
    if set(wanted) <= {cell.strip() for cell in first} or not _is_numbers(first, separator):
        return CsvRows(path, separator, *_stripped(line, first), rows[1:])
    if len(before[1]) == len(first):
        return CsvRows(path, separator, *_stripped(*before), rows)
    return CsvRows(path, separator, None, [str(place + 1) for place in range(len(first))], rows)


def _stripped(line: int | None, names: Sequence[str]) -> tuple[int | None, list[str]]:
    return line, [name.strip() for name in names]


def _is_numbers(row: Sequence[str], separator: str) -> bool:
    """Return whether a row has numbers and empty cells alone."""
    return any(row) and all(not cell.strip() or isfinite(_number(cell, separator)) for cell in row)


def _number(cell: str, separator: str) -> float:
    """Return the number in a cell, nan where it has none."""
    try:
        return float(cell.replace(",", ".") if separator != "," and _DECIMAL_COMMA.fullmatch(cell) else cell)
    except ValueError:
        return float("nan")


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


def _fit(table: CsvRows, wanted: Sequence[str]) -> tuple[int, bool, int]:
    """Return how many of the columns `wanted` a table has, whether it begins with numbers, and how many columns it has."""
    known = {each for name in table.names for each in (name, split_unit(name)[0])}
    return add_integers(name in known for name in wanted), table.header is None, len(table.names)
