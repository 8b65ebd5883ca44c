"""The files that a comparison of methods leaves: summary, tables, pictures (PNG, SVG), `report.html`."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cogrip.analysis.figures.page import svg
from cogrip.experiments.experiment import Result
from cogrip.experiments.folder import as_text
from cogrip.experiments.methods.latex import latex
from cogrip.experiments.methods.measures import FELT_MEASURES, MEASURES
from cogrip.experiments.methods.method import METHODS, named
from cogrip.experiments.methods.plots import draw_all
from cogrip.experiments.methods.query import ComparisonQuery
from cogrip.experiments.methods.table import cells, columns_of, gather, headings, markdown, notes, tone
from cogrip.machine.addition import add_integers
from cogrip.results.plots.style import png
from cogrip.results.reading.folder import SUMMARY, summary_text
from cogrip.results.report.page import Picture, render_page
from cogrip.results.report.tables import Cell, ReportTable, TableRow, plain, row, settings_tables
from cogrip.results.verdict.judgement import Tone

REPORT, MARKDOWN, LATEX, PLOTS, PEOPLE = "report.html", "table.md", "table.tex", "plots", "felt.csv"
KIND = "comparison of methods"


def write_outcome(folder: Path, asked: ComparisonQuery, results: Mapping[int, Result]) -> dict[str, Any]:
    """Write all files into the folder, over those of an earlier part of this comparison; return the summary."""
    summary = gather(asked, results)
    (folder / SUMMARY).write_text(summary_text(summary), encoding="utf-8")
    (folder / MARKDOWN).write_text(markdown(summary), encoding="utf-8")
    (folder / LATEX).write_text(latex(summary), encoding="utf-8")
    write_people(folder / PEOPLE, asked, results)
    plots = folder / PLOTS
    plots.mkdir(exist_ok=True)
    pictures = []
    for plot in draw_all(asked, results, summary):
        drawn = png(plot.figure)
        (plots / f"{plot.name}.png").write_bytes(drawn)
        (plots / f"{plot.name}.svg").write_bytes(svg(plot.figure))
        pictures.append(Picture(plot.heading, plot.caption, drawn, ""))
    (folder / REPORT).write_text(render(summary, pictures), encoding="utf-8")
    return summary


def write_people(path: Path, asked: ComparisonQuery, results: Mapping[int, Result]) -> None:
    """Write a line for each person and session in which the felt stiffness was measured."""
    columns = ("person", "asked_npm", *FELT_MEASURES)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["cell", *asked.keys, *columns])
        for case in sorted(results):
            for person in results[case].measures.get("felt", ()):
                values = [*asked.values(case).values(), *(person[column] for column in columns)]
                writer.writerow([case, *map(as_text, values)])


def render(summary: Mapping[str, Any], pictures: list[Picture]) -> str:
    """Return the page."""
    asked = summary["asked"]
    settings, seeds, title = asked["settings"], asked["seeds"], f"{summary['name']}: methods compared"
    facts = (
        f"{summary['run']} of {summary['sessions']} sessions", f"{len(settings['users'])} people",
        f"{settings['seconds']:g} s each", f"seeds {seeds[0]} to {seeds[-1]}", f"cogrip {summary['version']}",
    )  # fmt: skip
    measures = [
        TableRow(each.heading, "", [Cell(each.unit), Cell(each.what, "prose")]) for each in MEASURES.values()
    ]  # fmt: skip
    methods = [
        row(named(name), [", ".join(f"{key} = {plain(value)}" for key, value in overrides.items())], css="prose")
        for name, overrides in asked["methods"].items()
    ]
    return render_page(
        "methods.html.j2",
        title=title,
        kind=KIND,
        about=" · ".join(facts),
        verdict=[_verdict(method, summary) for method in asked["methods"]],
        notes=_notes(summary),
        table=_table(summary),
        table_notes=notes(summary),
        pictures=pictures,
        measures=ReportTable(["", "unit", "what"], measures),
        methods=ReportTable(["", "settings"], methods),
        networks=_networks(asked["networks"]),
        settings=settings_tables(settings),
    )


def _verdict(method: str, summary: Mapping[str, Any]) -> tuple[Tone, str]:
    """Return the sentence on one method, and its tone."""
    rows = [row for row in summary["rows"] if row["method"] == method and row["runs"]]
    runs = add_integers(row["runs"] for row in rows)
    where = [row["network"] for row in rows if row["diverged"] or row["oscillates"]]
    tone: Tone = "good"
    if not runs:
        tone, text = "warn", "was not run"
    elif where:
        bad = add_integers(row["diverged"] + row["oscillates"] for row in rows)
        tone, text = "bad", f"unstable in {bad} of {runs} sessions: on {', '.join(where)}"
    else:
        text = f"stable in all {runs} sessions"
    for key, words, severity in _ALSO:
        if count := add_integers(row[key] for row in rows):
            text += f"; {words} {count}: on {', '.join(row['network'] for row in rows if row[key])}"
            tone = "bad" if "bad" in (tone, severity) else "warn"
    return tone, f"{method}, {METHODS[method].title}: {text}."


_ALSO: tuple[tuple[str, str, Tone], ...] = (
    ("not_passive", "not passive in", "bad"),
    ("not_felt", "not felt as intended in", "warn"),
)


def _notes(summary: Mapping[str, Any]) -> list[str]:
    missing = summary["sessions"] - summary["run"]
    return [
        *([f"{missing} sessions were not run: it was interrupted."] if missing > 0 else []),
        *(
            f"{row['method']} on {row['network']}: {count} could not be run: {error}"
            for row in summary["rows"]
            for error, count in row["errors"].items()
        ),
    ]


def _table(summary: Mapping[str, Any]) -> ReportTable:
    columns = columns_of(summary)
    rows: list[TableRow | str] = []
    network = None
    for each in summary["rows"]:
        if each["network"] != network:
            network = each["network"]
            rows.append(str(network))
        verdict, *numbers = cells(each, columns=columns)
        rows.append(TableRow(each["method"], "", [Cell(verdict, f"text {tone(each)}"), *map(Cell, numbers)]))
    return ReportTable(["", *headings(columns)[2:]], rows)


def _networks(networks: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> ReportTable:
    """Return a row for each direction of each network."""
    paths = {
        f"{name}, {direction}": values for name, directions in networks.items() for direction, values in directions.items()
    }  # fmt: skip
    keys = list(dict.fromkeys(key for values in paths.values() for key in values))
    return ReportTable(
        ["", *keys], [row(name, [plain(values.get(key)) for key in keys]) for name, values in paths.items()]
    )
