"""What a comparison leaves: `summary.json`, `felt.csv`, `table.md`, `table.tex`, pictures (PNG, SVG), `report.html`."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

from cogrip.sim.analysis.figures.page import svg
from cogrip.sim.experiments.experiment import Result
from cogrip.sim.experiments.folder import as_text
from cogrip.sim.experiments.methods.latex import latex
from cogrip.sim.experiments.methods.measures import FELT_MEASURES, MEASURES
from cogrip.sim.experiments.methods.method import METHODS
from cogrip.sim.experiments.methods.plots import draw_all
from cogrip.sim.experiments.methods.query import Comparison
from cogrip.sim.experiments.methods.table import cells, gather, headings, markdown, note, unstable
from cogrip.sim.runs.folder import SUMMARY, summary_text
from cogrip.sim.runs.plots.style import png
from cogrip.sim.runs.report.page import Picture, figure, notes_list, page
from cogrip.sim.runs.report.tables import plain, settings_tables, table

REPORT, MARKDOWN, LATEX, PLOTS, PEOPLE = "report.html", "table.md", "table.tex", "plots", "felt.csv"
KIND = "comparison of methods"


def write_outcome(folder: Path, asked: Comparison, results: Mapping[int, Result]) -> dict[str, Any]:
    """Write everything into the folder, anew what stands there of an earlier part of this comparison. Returns the summary."""
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


def write_people(path: Path, asked: Comparison, results: Mapping[int, Result]) -> None:
    """A line a person and session in which the felt stiffness was measured."""
    columns = ("person", "asked_npm", *FELT_MEASURES)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["cell", *asked.keys, *columns])
        for case in sorted(results):
            for person in results[case].measures.get("felt", ()):
                values = [*asked.values(case).values(), *(person[column] for column in columns)]
                writer.writerow([case, *map(as_text, values)])


def render(summary: Mapping[str, Any], pictures: list[Picture]) -> str:
    """The page."""
    asked, name = summary["asked"], str(summary["name"])
    seeds = asked["seeds"]
    told = (
        f"{summary['run']} of {summary['sessions']} sessions", f"{len(asked['settings']['users'])} people",
        f"{asked['settings']['seconds']:g} s each", f"seeds {seeds[0]} to {seeds[-1]}", f"cogrip {summary['version']}",
    )  # fmt: skip
    parts = [
        f"<h1>{escape(name)}: methods compared</h1>",
        f"<p class=about>{escape(' · '.join(told))}</p>",
        _verdict(summary),
        notes_list(_notes(summary)),
        "<h2>Table</h2>",
        f"<div class=dense>{_table(summary)}</div>",
        f"<p class=about>{escape(note(summary))}</p>",
        *map(figure, pictures),
        "<h2>Measures</h2>",
        _measures(),
        "<h2>Methods</h2>",
        _methods(summary),
        "<h2>Networks</h2>",
        _networks(summary),
        "<h2>Settings</h2>",
        settings_tables(asked["settings"]),
    ]
    return page(f"{name}: methods compared", KIND, parts)


def _verdict(summary: Mapping[str, Any]) -> str:
    """A sentence a method."""
    items = []
    for method in summary["asked"]["methods"]:
        rows = [row for row in summary["rows"] if row["method"] == method and row["runs"]]
        runs = sum(row["runs"] for row in rows)
        bad = sum(row["diverged"] + row["oscillates"] for row in rows)
        where = [row["network"] for row in rows if row["diverged"] or row["oscillates"]]
        if not runs:
            tone, text = "warn", "was not run"
        elif bad:
            tone, text = "bad", f"unstable in {bad} of {runs} sessions: on {', '.join(where)}"
        else:
            tone, text = "good", f"stable in all {runs} sessions"
        if active := sum(row["active"] for row in rows):
            tone, text = ("warn" if tone == "good" else tone), f"{text}; driven by created energy in {active}"
        if leaks := sum(row["not_passive"] for row in rows):
            tone, text = "bad", f"{text}; not passive in {leaks}"
        if others := sum(row["not_felt"] for row in rows):
            tone, text = ("warn" if tone == "good" else tone), f"{text}; not felt as intended in {others}"
        mark = {"good": "✓", "warn": "!", "bad": "✗"}[tone]
        title = METHODS[method].title
        items.append(f"<li class={tone}><span class=mark>{mark}</span><span>{escape(f'{title}: {text}.')}</span></li>")
    return f"<ul class=verdict>{''.join(items)}</ul>"


def _notes(summary: Mapping[str, Any]) -> list[str]:
    notes = []
    if summary["run"] < summary["sessions"]:
        notes.append(f"{summary['sessions'] - summary['run']} sessions were not run: it was interrupted.")
    for row in summary["rows"]:
        notes += [
            f"{row['method']} on {row['network']}: {count} could not be run: {error}"
            for error, count in row["errors"].items()
        ]
    return notes


def _table(summary: Mapping[str, Any]) -> str:
    lines, last = [], None
    for row in summary["rows"]:
        if row["network"] != last:
            last = row["network"]
            lines.append(f"<tr class=group><th>{escape(last)}</th></tr>")
        verdict, *numbers = cells(row)
        tone = " bad" if unstable(row) else ""
        lines.append(
            f"<tr><th>{escape(METHODS[row['method']].title)}</th><td class='text{tone}'>{escape(verdict)}</td>"
            + "".join(f"<td>{escape(text)}</td>" for text in numbers)
            + "</tr>"
        )
    return table(["", *headings()[2:]], lines)


def _measures() -> str:
    return table(
        ["", "unit", "what"],
        [
            f"<tr><th>{escape(measure.heading)}</th><td>{escape(measure.unit)}</td>"
            f"<td style='text-align:left'>{escape(measure.what)}</td></tr>"
            for measure in MEASURES.values()
        ],
    )


def _methods(summary: Mapping[str, Any]) -> str:
    return table(
        ["", "settings"],
        [
            f"<tr><th>{escape(METHODS[name].title)}</th><td style='text-align:left'>"
            f"{escape(', '.join(f'{key} = {plain(value)}' for key, value in overrides.items()))}</td></tr>"
            for name, overrides in summary["asked"]["methods"].items()
        ],
    )


def _networks(summary: Mapping[str, Any]) -> str:
    networks = summary["asked"]["networks"]
    keys = list(
        dict.fromkeys(key for directions in networks.values() for direction in directions.values() for key in direction)
    )
    lines = [
        f"<tr><th>{escape(f'{name}, {direction}')}</th>"
        + "".join(f"<td>{escape(plain(values.get(key)))}</td>" for key in keys)
        + "</tr>"
        for name, directions in networks.items()
        for direction, values in directions.items()
    ]
    return table(["", *keys], lines)
