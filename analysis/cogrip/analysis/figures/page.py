"""A figure with its numbers: PNG, SVG, CSV, and where there is one a JSON record of the query and its answer."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from cogrip.results.plots.style import png


class FilesInTheWayError(FileExistsError):
    """The folder holds the answer to another query under the same name."""


@dataclass(frozen=True, slots=True)
class FigureTable:
    """A table of numbers or words, with units in the columns' names."""

    columns: tuple[str, ...]
    rows: Sequence[Sequence[Any]]

    def csv(self) -> str:
        """Return the table as CSV."""
        out = StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows([_cell(value) for value in row] for row in self.rows)
        return out.getvalue()


@dataclass(frozen=True, slots=True)
class FigurePage:
    """A figure: the name of its files, a title, a caption on what to look for, and its numbers."""

    name: str
    title: str
    caption: str
    figure: Figure
    table: FigureTable


def svg(figure: Figure) -> bytes:
    """Return the picture as SVG; the same numbers give the same bytes."""
    out = BytesIO()
    with mpl.rc_context({"svg.hashsalt": "cogrip", "svg.fonttype": "none"}):
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    return out.getvalue()


def save_page(folder: Path, page: FigurePage, record: Mapping[str, Any] | None = None) -> list[Path]:
    """Write a page's files, with a `record` its JSON too, whose `record["question"]` is the query, and return their paths.

    The same query may be answered again. Raises OSError where it cannot be written; FilesInTheWayError, and writes nothing,
    where the folder holds the answer to another query, or another file of that name.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files: dict[str, bytes] = {"png": png(page.figure), "svg": svg(page.figure), "csv": page.table.csv().encode()}
    if record is not None:
        files["json"] = (json.dumps(record, indent=2, allow_nan=False) + "\n").encode()
        _refuse_others(folder, page.name, record)
    paths = []
    for suffix, content in files.items():
        path = folder / f"{page.name}.{suffix}"
        path.write_bytes(content)
        paths.append(path)
    return paths


def _refuse_others(folder: Path, name: str, record: Mapping[str, Any]) -> None:
    path = folder / f"{name}.json"
    there = [folder / f"{name}.{suffix}" for suffix in ("png", "svg", "csv", "json")]
    there = [file for file in there if file.exists()]
    if not there:
        return
    try:
        query = json.loads(path.read_text())["question"]
    except (OSError, ValueError, KeyError, TypeError):
        raise FilesInTheWayError(
            f"{there[0]} is in the way, and nothing says what it answers; name another folder"
        ) from None
    asked = json.loads(json.dumps(record["question"]))
    if query != asked:
        differ = [key for key in asked if query.get(key) != asked[key]] or ["something"]
        raise FilesInTheWayError(
            f"{path} answers another question (other {', '.join(differ)}); name another folder, or remove it"
        )


def _cell(value: Any) -> str:
    return f"{value:.10g}" if isinstance(value, float) else str(value)
