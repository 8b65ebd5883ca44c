"""What a sweep keeps: `sweep.json` (what was asked), `cases.jsonl` (a line a cell, as they finish), `table.csv` (in order).

A comparison of methods keeps the same under its own name.

A line that was cut short, by a kill or a full disk, is no line: its cell is run again. Nothing of another sweep is touched.
"""

from __future__ import annotations

import csv
import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from cogrip.protocol.version import VERSION
from cogrip.sim.experiments.sweep.case import Result
from cogrip.sim.experiments.sweep.grid import Grid

MANIFEST, CELLS, TABLE = "sweep.json", "cells.jsonl", "table.csv"
FILES = "files"  # in a manifest


class FolderError(Exception):
    """The folder is not this sweep's."""


class Kind(NamedTuple):
    """What a folder is of: a word for people, and the file that says what was asked."""

    word: str
    manifest: str


SWEEP = Kind("sweep", MANIFEST)


class Cells(Protocol):
    """Numbered cells, each with its values by name."""

    @property
    def keys(self) -> Sequence[str]: ...

    def values(self, case: int) -> Mapping[str, Any]: ...


def manifest(grid: Grid, columns: Sequence[str], files: Mapping[str, str]) -> dict[str, Any]:
    """What makes a sweep this one and no other. files: what sessions read, and the digest of what stands there."""
    return {
        "version": VERSION,
        "settings": dict(grid.base),
        "vary": [{"key": axis.key, "values": list(axis.values), "log": axis.log} for axis in grid.axes],
        "columns": list(columns),
        FILES: dict(files),
    }


def digest(asked: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(asked, sort_keys=True).encode()).hexdigest()[:12]


class SweepFolder:
    """The folder of one sweep, new or begun before. `finished` has the cells that are kept already."""

    def __init__(self, path: Path, asked: Mapping[str, Any], kind: Kind = SWEEP) -> None:
        """Raises FolderError, and changes nothing, for a folder of another sweep or of somebody else; OSError."""
        self.path = path
        self._kind = kind
        self._asked = json.loads(json.dumps(asked))
        self.finished: dict[int, Result] = {}
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            self._resume()
        else:
            path.mkdir(parents=True, exist_ok=True)
            _write(path / kind.manifest, json.dumps(self._asked, indent=2) + "\n")
        self._lines = (path / CELLS).open("a", encoding="utf-8")

    def _resume(self) -> None:
        file = self.path / self._kind.manifest
        word = self._kind.word
        try:
            found = json.loads(file.read_text(encoding="utf-8"))
            differ = [
                _difference(key, found.get(key), self._asked[key])
                for key in self._asked
                if found.get(key) != self._asked[key]
            ]
        except (OSError, ValueError, AttributeError):
            raise FolderError(
                f"{self.path} is no {word}'s folder ({file.name} is missing or unreadable); name another"
            ) from None
        if differ:
            raise FolderError(
                f"{self.path} holds another {word} (other {', '.join(differ)}); name another folder, "
                f"or ask for the same {word} to resume it"
            )
        self._read_cases()

    def _read_cases(self) -> None:
        path = self.path / CELLS
        if not path.exists():
            return
        kept: list[str] = []
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines(keepends=True)
        for line in lines:
            result = _result(line)
            if result is not None and not result.error:
                self.finished[result.case] = result
                kept.append(line)
        if kept != lines:  # a torn line, or cells that failed: they are run again
            _write(path, "".join(kept))

    def add(self, result: Result, values: Mapping[str, Any]) -> None:
        """Keep a cell, at once."""
        row = {"cell": result.case, "values": dict(values), "measures": result.measures, "error": result.error}
        self._lines.write(json.dumps(row, allow_nan=False) + "\n")
        self._lines.flush()
        self.finished[result.case] = result

    def write_table(self, cases: Cells, columns: Sequence[str]) -> Path:
        """Every finished cell in order, whatever order they came in."""
        path = self.path / TABLE
        partial = path.with_suffix(".part")
        with partial.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["cell", *cases.keys, *columns, "error"])
            for case in sorted(self.finished):
                result = self.finished[case]
                measures = [as_text(result.measures.get(column)) for column in columns]
                writer.writerow([case, *map(as_text, cases.values(case).values()), *measures, result.error])
        partial.replace(path)
        return path

    def close(self) -> None:
        self._lines.close()


def _difference(key: str, found: Any, asked: Any) -> str:
    """What differs, by name: a settings file's text does not show that a file it names holds something else by now."""
    if key != FILES or not isinstance(found, dict):
        return key
    return f"{key}: {', '.join(sorted(path for path in {*found, *asked} if found.get(path) != asked.get(path)))}"


def _result(line: str) -> Result | None:
    if not line.endswith("\n"):
        return None
    try:
        row = json.loads(line)
        return Result(int(row["cell"]), dict(row["measures"]), str(row["error"]))
    except (ValueError, KeyError, TypeError):
        return None


def as_text(value: Any) -> str:
    """A value as a table has it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return "" if value is None else f"{value:.10g}" if isinstance(value, float) else str(value)


def _write(path: Path, text: str) -> None:
    """All or nothing."""
    partial = path.with_name(path.name + ".part")
    partial.write_text(text, encoding="utf-8")
    partial.replace(path)
