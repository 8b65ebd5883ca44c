"""`report.html` and `plots/*.png` of a run folder: one file that opens anywhere, with nothing to fetch.

What stands in a run folder may have been written by anybody: every text is escaped, and the page forbids scripts.
"""

import base64
from collections.abc import Callable, Iterable
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from cogrip.sim.runs.report.tables import dropped_table, people_table, room_table, settings_tables
from cogrip.sim.runs.summary_values import lent_j, number
from cogrip.sim.runs.traces import MOST_PEOPLE, Run, load_run
from cogrip.sim.runs.verdict_text import verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REPORT = "report.html"
PLOTS = "plots"
_MARKS = {"good": "✓", "warn": "!", "bad": "✗"}


class Picture(NamedTuple):
    """A plot, or in place of `png` why there is none."""

    heading: str
    caption: str
    png: bytes | None
    missing: str


def write_report(folder: Path) -> Path:
    """Plots and report into the run folder; returns the report. FileNotFoundError if the folder holds nothing of a run."""
    run = load_run(folder)
    pictures = draw_plots(run)
    report = folder / REPORT
    report.write_text(render(run, pictures), encoding="utf-8")
    return report


def draw_plots(run: Run) -> list[Picture]:
    """Draw every plot that can be drawn, each also as a file; what was there from before is replaced."""
    from cogrip.sim.runs.plots.registry import PLOTS as PLOT_TABLE  # matplotlib takes a second to import

    folder = run.folder / PLOTS
    folder.mkdir(exist_ok=True)
    pictures = []
    for plot in PLOT_TABLE:
        file = folder / f"{plot.name}.png"
        file.unlink(missing_ok=True)
        drawn = picture(plot.heading, plot.caption, plot.draw, run)
        if drawn.png is not None:
            file.write_bytes(drawn.png)
        pictures.append(drawn)
    return pictures


def picture(heading: str, caption: str, draw: Callable[..., "Figure"], *arguments: object) -> Picture:
    """What `draw` draws, or why it does not."""
    from cogrip.sim.runs.plots.style import NotDrawnError, png

    try:
        return Picture(heading, caption, png(draw(*arguments)), "")
    except NotDrawnError as error:
        return Picture(heading, caption, None, str(error))
    except KeyError as error:
        return Picture(heading, caption, None, f"a trace has no column {error}")


def render(run: Run, pictures: list[Picture]) -> str:
    """The page."""
    summary, settings = run.summary, run.settings
    name = name_of_run(run)
    parts = [
        f"<h1>{escape(name)}</h1>",
        about(run, run.folder.name),
        verdict_of(run),
        notes_list((*run.notes, *_left_out(run))),
        "<div class=columns><section><h2>People</h2>",
        people_table(summary),
        "</section><section><h2>Object and server</h2>",
        room_table(summary),
        "</section></div>",
        *map(figure, pictures),
        "<h2>Dropped, refused, dealt with</h2>",
        dropped_table(summary),
        "<h2>Settings</h2>",
        settings_tables(settings),
    ]
    return page(f"{name}: cogrip report", "report", parts)


def page(title: str, kind: str, parts: Iterable[str]) -> str:
    """A page of HTML parts that says in its head what wrote it: `cogrip <kind>`."""
    return _PAGE.format(title=escape(title), kind=escape(kind), style=_STYLE, body="\n".join(parts))


def name_of_run(run: Run) -> str:
    return str(run.summary.get("name") or run.settings.get("name") or run.folder.name)


def about(run: Run, first: str) -> str:
    """A line on what was run, `first` at its head."""
    seconds, seed = run.summary.get("seconds"), run.summary.get("seed", run.settings.get("seed"))
    people = "1 person" if len(run.names) == 1 else f"{len(run.names)} people"
    words = (first, f"{number(seconds)} s", people, f"seed {number(seed, digits=0)}")
    by = "; ".join(run.versions) or "a version that no recording tells"
    return f"<p class=about>{escape(' · '.join(words))}<br>{escape(f'Run by {by}')}</p>"


def verdict_of(run: Run) -> str:
    """The verdict's sentences, each with its mark."""
    sentences = verdict(run.summary, lent_j(run.settings))
    items = "".join(
        f"<li class={tone}><span class=mark>{_MARKS[tone]}</span><span>{escape(text)}</span></li>"
        for tone, text in sentences
    )
    return f"<ul class=verdict>{items}</ul>"


def notes_list(notes: Iterable[str]) -> str:
    notes = list(notes)
    if not notes:
        return ""
    return f"<ul class=notes>{''.join(f'<li>{escape(note)}</li>' for note in notes)}</ul>"


def _left_out(run: Run) -> list[str]:
    more = len(run.names) - MOST_PEOPLE
    return [f"The plots show the first {MOST_PEOPLE} people; {more} more are in the table only."] if more > 0 else []


def figure(picture: Picture) -> str:
    heading, caption = escape(picture.heading), escape(picture.caption)
    if picture.png is None:
        return f"<h2>{heading}</h2><p class=missing>Not drawn: {escape(picture.missing)}.</p>"
    data = base64.b64encode(picture.png).decode()
    return (
        f"<h2>{heading}</h2><figure><figcaption>{caption}</figcaption>"
        f'<img alt="{heading}" src="data:image/png;base64,{data}"></figure>'
    )


_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="cogrip {kind}">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
{body}
</body>
</html>
"""

_STYLE = """
:root { color-scheme: light dark; --ink: #1f2328; --soft: #59636e; --paper: #ffffff; --card: #f6f8fa; --rule: #d0d7de;
  --good: #1a7f37; --warn: #9a6700; --bad: #b3261e; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6edf3; --soft: #9198a1; --paper: #0d1117; --card: #161b22;
  --rule: #30363d; --good: #3fb950; --warn: #d29922; --bad: #ff7b72; } }
body { max-width: 1040px; margin: 2.5rem auto; padding: 0 1.2rem; background: var(--paper); color: var(--ink);
  font: 16px/1.5 system-ui, sans-serif; }
h1 { margin: 0; font-size: 1.9rem; overflow-wrap: anywhere; }
h2 { margin: 2.4rem 0 .6rem; font-size: 1.2rem; overflow-wrap: anywhere; }
.about, figcaption, .missing, .unit { color: var(--soft); }
.about { margin: .2rem 0 1.2rem; }
ul.verdict, ul.notes { margin: 0; padding: .7rem 1rem; border-radius: 8px; background: var(--card); list-style: none; }
ul.verdict li { display: flex; gap: .6rem; overflow-wrap: anywhere; }
ul.notes { margin-top: .8rem; border-left: 4px solid var(--warn); overflow-wrap: anywhere; }
.mark { flex: 0 0 1em; font-weight: 700; text-align: center; }
.good .mark { color: var(--good); } .warn .mark { color: var(--warn); } .bad .mark { color: var(--bad); }
.bad { font-weight: 600; }
.wide { overflow-x: auto; max-width: 100%; }
table { border-collapse: collapse; font-size: .92rem; font-variant-numeric: tabular-nums; }
th, td { padding: .18rem .9rem .18rem 0; text-align: left; vertical-align: top; }
td { text-align: right; } td.text { min-width: 8rem; max-width: 16rem; overflow-wrap: anywhere; }
th { font-weight: 400; } thead th { font-weight: 600; border-bottom: 1px solid var(--rule); text-align: right; }
thead th { overflow-wrap: break-word; max-width: 14rem; vertical-align: bottom; }
thead th:first-child { text-align: left; }
.dense table { font-size: .76rem; } .dense th, .dense td { padding-right: .6rem; } .dense td.text { min-width: 6rem; }
tbody th:first-child { position: sticky; left: 0; background: var(--paper); }
tr.group th { padding-top: .7rem; font-weight: 600; }
tbody tr:not(.group):hover > * { background: var(--card); }
td.changed { font-weight: 600; }
.run { padding: 0 .12em; border-radius: 3px; background: #ffffff; }
@media (max-width: 1000px) { body { margin: 1.2rem auto; } table { font-size: .82rem; } th, td { padding-right: .6rem; } }
.columns { display: flex; flex-wrap: wrap; gap: .5rem 4rem; } section { min-width: 0; }
figure { margin: 0; } figcaption { margin-bottom: .6rem; max-width: 46rem; }
img { display: block; width: 100%; height: auto; border-radius: 8px; background: #ffffff; }
@media (prefers-color-scheme: dark) { img { filter: brightness(.92); } }
@media print { @page { margin: 12mm; } body { margin: 0; padding: 0; max-width: none; font-size: 11px; }
  .columns { display: block; } .wide { overflow: visible; } table { font-size: 9px; max-width: 100%; }
  th, td { padding-right: .5rem; } tbody th { width: 24%; } .dense tbody th { width: 12%; } .dense table { font-size: 7px; }
  tbody th:first-child { position: static; }
  tr, figure { break-inside: avoid; } h2 { break-after: avoid; } }
"""
