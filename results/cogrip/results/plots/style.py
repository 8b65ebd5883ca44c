"""The look of every plot: a sheet of panels, a colour per person, decimation that keeps the extremes."""

from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import ScaledTranslation
from numpy.typing import NDArray

from cogrip.protocol.session_drawing import COLOURS as COLOURS
from cogrip.protocol.session_drawing import colour as colour

Array = NDArray[np.float64]
Style = dict[str, Any]
Legend = Sequence[tuple[str, Style]]

_MARKERS = "osD^vPX"  # markers of people, one more than the palette has colours: no two people share colour and marker
_MARKED = 10  # number of markers on a line
INK = "#1f2328"  # colour of the object, the server and text
FAINT = "#8b949e"
ALARM = "#b3261e"
AXIS_NAMES = ("x", "y", "z", "rx", "ry", "rz")  # names of the axes; the last three turn
WIDTH_IN = 10.0
LEFT_IN, LABEL_IN = 0.75, 0.57
"""Margin left of a panel, and in it the place of the lower edge of its vertical axis's label."""
LINE_IN = 0.17  # room that each further line of a label takes
DPI = 130  # dots an inch, so that a picture is 1300 px wide: sharp when shown 1000 px wide
DASHED, DOTTED = (0, (4, 1.5)), (0, (1, 1))
LINES: tuple[Any, ...] = ("-", DASHED, (0, (6, 1.5, 1, 1.5)), DOTTED, (0, (9, 2)), (0, (3, 1, 1, 1, 1, 1)))
_BUCKETS = 900  # most buckets of a line, with a minimum and a maximum each: finer than a pixel
_STRETCHES = 150
LEAST_SPAN = 1e-6  # least span of an axis, in its own unit (N, mm, mJ): rounding is not magnified


class NotDrawnError(Exception):
    """Raised where there is nothing to draw; the text says why."""


def person_style(person: int) -> Style:
    """Return person n's colour and marker, which tells people apart in grey print."""
    return {"color": colour(person), "marker": _MARKERS[person % len(_MARKERS)], "ms": 4.0}


def shade(tint: Any, share: float) -> tuple[float, float, float]:
    """Mix `share` of a colour with white."""
    red, green, blue = (1.0 - share * (1.0 - part) for part in to_rgb(tint))
    return red, green, blue


def label(text: str, most: int = 24) -> str:
    """Return text from outside without TeX, leading underscore (which hides it from legends), or endless length."""
    return text[:most].replace("$", r"\$").lstrip("_") or "nameless"


def envelope(time: Array, values: Array) -> tuple[Array, Array]:
    """Return at most 2 * _BUCKETS points that keep every extreme: minimum and maximum of each bucket, in order of time."""
    size = len(time)
    if size <= 2 * _BUCKETS:
        return time, values
    starts = np.linspace(0, size, _BUCKETS, endpoint=False).astype(np.intp)
    low, high = np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)
    ends = np.append(starts[1:], size) - 1
    falls = values[ends] < values[starts]
    pairs = np.stack((np.where(falls, high, low), np.where(falls, low, high)), axis=1)
    quarter = 0.25 * (time[ends] - time[starts])
    times = np.stack((time[starts] + quarter, time[ends] - quarter), axis=1)
    return times.ravel(), pairs.ravel()


def draw(panel: Axes, time: Array, values: Array, *, window: tuple[float, float] | None = None, **style: Any) -> None:
    """Draw a line of at most a few points a pixel, with a few markers if it has any; `window` cuts it in time first."""
    if window is not None:
        first, last = np.searchsorted(time, window)
        time, values = time[first:last], values[first:last]
    times, values = envelope(time, values)
    panel.plot(times, values, **style, markevery=_marked(len(times), style.get("marker")))


def _marked(points: int, marker: str | None) -> tuple[int, int] | None:
    """Return (first, step) of the points that get a marker: those of different people stand at different times."""
    if not marker or marker not in _MARKERS:
        return None
    step = max(1, points // _MARKED)
    return step * (2 * _MARKERS.index(marker) + 1) // (2 * len(_MARKERS)), step


def draw_spread(
    panel: Axes, time: Array, values: Array, style: Style, stretches: int = _STRETCHES, pale: float = 0.18
) -> None:
    """Draw the median of every stretch of time, on a pale band from its least to its largest value."""
    known = np.isfinite(values)
    time, values = time[known], values[known]
    parts = np.array_split(np.arange(len(time)), min(stretches, len(time)) or 1)
    if not len(time):
        return
    middle = np.array([time[part].mean() for part in parts])
    bands = np.array([np.percentile(values[part], (0.0, 50.0, 100.0)) for part in parts])
    panel.fill_between(middle, bands[:, 0], bands[:, 2], color=style["color"], alpha=pale, lw=0)
    draw(panel, middle, bands[:, 1], **{"lw": 1.5, **style})


class Sheet:
    """A figure of rows x columns panels. Draw into `panels`, then `finish`. With `widths` each column has its own scale."""

    def __init__(self, rows: int, columns: int = 1, *, row_in: float = 2.1, widths: Sequence[float] = ()) -> None:
        self._rows, self._row_in, self._own_y = rows, row_in, bool(widths)
        self.figure = Figure(figsize=(WIDTH_IN, rows * row_in), dpi=DPI, facecolor="white")
        FigureCanvasAgg(self.figure)
        self.panels: NDArray[Any] = self.figure.subplots(
            rows, columns, squeeze=False, sharex="col", sharey=False if widths else "row", width_ratios=widths or None
        )
        for panel in self.panels.flat:
            for side in ("top", "right"):
                panel.spines[side].set_visible(False)
            for side in ("left", "bottom"):
                panel.spines[side].set_color(FAINT)
            panel.grid(color="#d0d7de", linewidth=0.6)
            panel.set_axisbelow(True)
            panel.tick_params(colors=INK, labelsize=9, length=3, color=FAINT)
            panel.margins(x=0.01)
            panel.ticklabel_format(axis="y", scilimits=(-4, 5), useOffset=False)
            panel.locator_params(axis="y", nbins=8 if row_in > 2.0 else 6)

    def finish(
        self, x_label: str | Sequence[str], y_labels: Sequence[str], legend: Legend = (), columns: int = 0
    ) -> Figure:
        """Set labels on the outer panels, the legend above, margins in inches.

        x_label: one for all columns, or one a column. y_labels: one a row, for the first column, or one a panel where each
        has its own scale. The legend is filled column by column; `columns` = 0: as many as fit.
        """
        x_labels = [x_label] * self.panels.shape[1] if isinstance(x_label, str) else x_label
        for panel, text in zip(self.panels[-1], x_labels, strict=True):
            panel.set_xlabel(text, fontsize=10, color=INK)
        for panel in self.panels.flat:
            if panel.get_yscale() == "linear" and max(map(abs, panel.get_ylim())) < LEAST_SPAN:
                panel.set_ylim(-1.0, 1.0)
        each = len(y_labels) > self._rows
        for panel, text in zip(self.panels.flat if each else self.panels[:, 0], y_labels, strict=True):
            panel.set_ylabel(text, fontsize=10, color=INK)
        above = 0.1
        if any(panel.get_title(loc="left") for panel in self.panels[0]):
            above += 0.22
        if legend:
            above += self._legend(legend, columns) + 0.08
        gap = 0.42 if any(panel.get_title(loc="left") for panel in self.panels[1:].flat) else 0.18
        below = 0.5
        left_in = LEFT_IN + LINE_IN * max(text.count("\n") for text in y_labels)
        height = self._rows * self._row_in + above + below + gap * (self._rows - 1)
        self.figure.set_size_inches(WIDTH_IN, height)
        self.figure.subplots_adjust(
            left=left_in / WIDTH_IN, right=0.98, top=1 - above / height, bottom=below / height,
            hspace=gap / self._row_in, wspace=0.3 if each else 0.2 if self._own_y else 0.12,
        )  # fmt: skip
        for (
            panel
        ) in self.panels.flat:  # asking every panel for the place of its ticks' texts takes a third of the drawing
            left = panel.transAxes + ScaledTranslation(-LABEL_IN, 0.0, self.figure.dpi_scale_trans)
            panel.yaxis.set_label_coords(0.0, 0.5, transform=left)
        return self.figure

    def _legend(self, legend: Legend, columns: int) -> float:
        """Place it in at most `columns`, fewer where they would be wider than the figure. Return its height [in]."""
        handles = [_handle(style) for _, style in legend]
        for count in range(columns or len(legend), 0, -1):
            found = self.figure.legend(
                handles, [text for text, _ in legend], loc="upper left", bbox_to_anchor=(0.065, 1.0), ncols=count,
                frameon=False, fontsize=10, handlelength=2.4, borderaxespad=0.2, columnspacing=1.6, labelspacing=0.35,
                labelcolor=INK,
            )  # fmt: skip
            box = found.get_window_extent()
            if box.x1 <= self.figure.bbox.x1 or count == 1:
                break
            found.remove()
        return 0.2 * -(-len(legend) // count)


def _handle(style: Style) -> Line2D | Patch:
    """Return the handle of a legend: an area where the style is one, else a line."""
    return Patch(**style) if "facecolor" in style else Line2D([], [], **style)


def title(panel: Axes, text: str, tint: Any = INK) -> None:
    if text:
        panel.set_title(text, loc="left", fontsize=10, color=tint, pad=4, y=1.0)


def png(figure: Figure) -> bytes:
    """Return the figure as PNG; the same run gives the same bytes."""
    out = BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()
