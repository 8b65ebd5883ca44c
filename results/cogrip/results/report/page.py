"""`report.html` and `plots/*.png` of a run folder: one file that opens anywhere, with nothing to fetch.

Anybody may have written the contents of a run folder: the templates escape every text, and the page forbids scripts.
"""

import base64
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from cogrip.results.reading.folder import write_whole
from cogrip.results.reading.summary_values import number, object_of, traits_of
from cogrip.results.reading.traces import MOST_PEOPLE, TracedRun, load_run
from cogrip.results.report.tables import dropped_table, markers_table, people_table, room_table, settings_tables
from cogrip.results.verdict.judgement import Tone
from cogrip.results.verdict.verdict_text import verdict

if TYPE_CHECKING:
    from jinja2 import Environment
    from matplotlib.figure import Figure

REPORT = "report.html"
PLOTS = "plots"


class Picture(NamedTuple):
    """A plot, or in place of `png` why there is none."""

    heading: str
    caption: str
    png: bytes | None
    missing: str


def write_report(folder: Path) -> Path:
    """Write plots and report into the run folder; return the report. FileNotFoundError if the folder holds no run."""
    run = load_run(folder)
    pictures = draw_plots(run)
    report = folder / REPORT
    write_whole(report, render(run, pictures).encode())
    return report


def draw_plots(run: TracedRun) -> list[Picture]:
    """Draw every plot that can be drawn, each also as a file; earlier files of these names are replaced."""
    from cogrip.results.plots.registry import PLOTS as PLOT_TABLE  # matplotlib takes a second to import

    folder = run.folder / PLOTS
    folder.mkdir(exist_ok=True)
    pictures = []
    for plot in PLOT_TABLE:
        file = folder / f"{plot.name}.png"
        file.unlink(missing_ok=True)
        if plot.scene and not object_of(run.settings).scene:
            continue
        drawn = picture(plot.heading, plot.caption, plot.draw, run)
        if drawn.png is not None:
            write_whole(file, drawn.png)
        pictures.append(drawn)
    return pictures


def picture(heading: str, caption: str, draw: Callable[..., "Figure"], *arguments: object) -> Picture:
    """Return the picture that `draw` makes, or the reason why it makes none."""
    from cogrip.results.plots.style import NotDrawnError, png

    try:
        return Picture(heading, caption, png(draw(*arguments)), "")
    except NotDrawnError as error:
        return Picture(heading, caption, None, str(error))
    except KeyError as error:
        return Picture(heading, caption, None, f"a trace has no column {error}")


@cache
def _templates() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined  # so that those who draw no page do not wait for it

    found = Environment(
        loader=PackageLoader("cogrip.results.report"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    found.filters["base64"] = lambda data: base64.b64encode(data).decode()
    return found


def render_page(template: str, *, title: str, kind: str, **parts: object) -> str:
    """Return a page from its template; its head says what wrote it: `cogrip <kind>`."""
    return _templates().get_template(template).render(title=title, kind=kind, **parts)


def render(run: TracedRun, pictures: list[Picture]) -> str:
    """Return the report as HTML."""
    summary = run.summary
    name = str(summary.get("name") or run.settings.get("name") or run.folder.name)
    more = len(run.names) - MOST_PEOPLE
    copies = [traits.copies] if (traits := traits_of(run.settings)) and traits.copies else []
    left_out = [f"The plots show the first {MOST_PEOPLE} people; {more} more are in the table only."]
    return render_page(
        "run.html.j2",
        title=f"{name}: cogrip report",
        kind="report",
        name=name,
        about=about(run, run.folder.name),
        verdict=verdict_of(run),
        notes=[*copies, *run.notes, *(left_out if more > 0 else ())],
        people=people_table(summary),
        room=room_table(summary),
        pictures=pictures,
        markers=markers_table(run.markers),
        dropped=dropped_table(summary),
        settings=settings_tables(run.settings),
    )


def about(run: TracedRun, first: str) -> list[str]:
    """Return two lines on the run, `first` at their head."""
    seconds, seed = run.summary.get("seconds"), run.summary.get("seed", run.settings.get("seed"))
    people = "1 person" if len(run.names) == 1 else f"{len(run.names)} people"
    by = "; ".join(run.versions) or "a version that no recording tells"
    return [f"{first} · {number(seconds)} s · {people} · seed {number(seed, digits=0)}", f"Run by {by}"]


def verdict_of(run: TracedRun) -> list[tuple[Tone, str]]:
    """Return the verdict's sentences, each with its tone."""
    return verdict(run.summary)
