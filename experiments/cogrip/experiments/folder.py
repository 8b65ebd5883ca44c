"""The folder of an experiment: its query (sweep.json, comparison.json), `cells.jsonl` (a line a finished case, in any order)
and `table.csv` (in order).

A line that was cut short, by a kill or a full disk, does not count: its case is run again.
"""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

from cogrip.experiments.experiment import Experiment, Result

CELLS, TABLE = "cells.jsonl", "table.csv"
FILES = "files"  # key of a query that holds the digests of the files which sessions read, by path


class FolderError(Exception):
    """The folder belongs to another experiment, or to none."""


class ExperimentFolder:
    """The folder of one experiment, new or resumed. `finished` has the cases that are kept already."""

    def __init__(self, path: Path, experiment: Experiment) -> None:
        """Raises OSError, and FolderError for another folder, in which it changes nothing."""
        self.path = path
        self.finished: dict[int, Result] = {}
        self._experiment = experiment
        query = json.loads(json.dumps(experiment.query))
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            self._check(query)
            self._read_cases()
        else:
            path.mkdir(parents=True, exist_ok=True)
            _write(path / experiment.kind.manifest, json.dumps(query, indent=2) + "\n")
        self._lines = (path / CELLS).open("a", encoding="utf-8")

    def _check(self, query: dict[str, Any]) -> None:
        word, name = self._experiment.kind
        try:
            found = json.loads((self.path / name).read_text(encoding="utf-8"))
            differ = [_difference(key, found.get(key), query[key]) for key in query if found.get(key) != query[key]]
        except (OSError, ValueError, AttributeError):
            raise FolderError(
                f"{self.path} is no {word}'s folder ({name} is missing or unreadable); name another"
            ) from None
        if differ:
            raise FolderError(
                f"{self.path} holds another {word} (other {', '.join(differ)}); name another folder, "
                f"or ask for the same {word} to resume it"
            )

    def _read_cases(self) -> None:
        path = self.path / CELLS
        if not path.exists():
            return
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines(keepends=True)
        kept: list[str] = []
        for line in lines:
            result = _parse(line)
            if result is not None and not result.error:
                self.finished[result.case] = result
                kept.append(line)
        if kept != lines:  # a torn line, or cases that failed: they are run again
            _write(path, "".join(kept))

    def add(self, result: Result) -> None:
        """Keep a finished case, at once."""
        values = dict(self._experiment.values(result.case))
        row = {"cell": result.case, "values": values, "measures": result.measures, "error": result.error}
        self._lines.write(json.dumps(row, allow_nan=False) + "\n")
        self._lines.flush()
        self.finished[result.case] = result

    def write_table(self) -> Path:
        """Write every finished case, in order, and return the path."""
        path, experiment = self.path / TABLE, self._experiment
        partial = path.with_suffix(".part")
        with partial.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["cell", *experiment.keys, *experiment.columns, "error"])
            for case, result in sorted(self.finished.items()):
                measures = [as_text(result.measures.get(column)) for column in experiment.columns]
                writer.writerow([case, *map(as_text, experiment.values(case).values()), *measures, result.error])
        partial.replace(path)
        return path

    def close(self) -> None:
        """Close cells.jsonl."""
        self._lines.close()


def _difference(key: str, found: Any, asked: Any) -> str:
    """Return the key that differs, and for files their paths: one may hold something else under the same path."""
    if key != FILES or not isinstance(found, dict):
        return key
    return f"{key}: {', '.join(sorted(path for path in {*found, *asked} if found.get(path) != asked.get(path)))}"


def _parse(line: str) -> Result | None:
    if not line.endswith("\n"):
        return None
    try:
        row = json.loads(line)
        return Result(int(row["cell"]), dict(row["measures"]), str(row["error"]))
    except (ValueError, KeyError, TypeError):
        return None


def as_text(value: Any) -> str:
    """Return a value as table.csv has it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return "" if value is None else f"{value:.10g}" if isinstance(value, float) else str(value)


def _write(path: Path, text: str) -> None:
    """Write the file as a whole or not at all."""
    partial = path.with_name(path.name + ".part")
    partial.write_text(text, encoding="utf-8")
    partial.replace(path)
