"""The figure of the stable region in the plane of two people's stiffnesses, one boundary a delay (P Fig. 4 and 6)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from cogrip.analysis.figures.page import FigurePage, FigureTable
from cogrip.analysis.linear.boundary import Boundary
from cogrip.analysis.linear.region import Region, grid_axes
from cogrip.protocol.settings.sections import Settings
from cogrip.results.plots.style import INK, LINES, Legend, Sheet, Style, colour, label, title

_PANEL_IN = 4.6
COLUMNS = ("delay_frames", "kind", "stiffness_0_npm", "stiffness_1_npm", "radius_inside", "radius_outside")


def region_page(
    regions: Sequence[Region], box_npm: tuple[float, float], conditions: str, estimated: bool = True
) -> FigurePage:
    """Draw one panel with every delay's boundary; the region is on the origin's side. conditions: under which it holds."""
    sheet = Sheet(1, 1, row_in=_PANEL_IN)
    session = regions[0].session
    draw_regions(sheet.panels[0, 0], regions, box_npm)
    names = [label(person.name) for person in session.people[:2]]
    idealised = "" if estimated else ", idealised: exact velocities"
    title(sheet.panels[0, 0], f"Stable region, {session.traits.title}{idealised}")
    figure = sheet.finish(
        f"stiffness of {names[0]} [kN/m]", [f"stiffness of {names[1]} [kN/m]"], legend_of(regions), columns=2
    )
    return FigurePage(
        "region",
        "Stable region",
        caption_of(regions, conditions),
        figure,
        FigureTable(COLUMNS, region_rows(regions, box_npm)),
    )


def draw_regions(panel: Axes, regions: Sequence[Region], box_npm: tuple[float, float]) -> None:
    """Draw boundaries in a panel whose axes are in kN/m."""
    panel.set_xlim(0.0, box_npm[0] * 1e-3)
    panel.set_ylim(0.0, box_npm[1] * 1e-3)
    for number, region in enumerate(regions):
        boundary, tint = region.boundary, colour(number)
        points = boundary.points_npm * 1e-3
        corner = np.concatenate(([[0.0, 0.0]], points))
        panel.add_patch(Polygon(corner, facecolor=tint, alpha=0.08, lw=0))
        border = np.where(boundary.open[:, None], np.nan, points)  # the frame of the picture is no border
        panel.plot(border[:, 0], border[:, 1], **line_style(number))
        if region.grid is not None:
            k1, k2 = grid_axes(box_npm, len(region.grid))
            panel.contour(k1 * 1e-3, k2 * 1e-3, region.grid, levels=[1.0], colors=[tint], linewidths=0.6, alpha=0.6)
    if all(region.boundary.open.all() for region in regions):
        panel.text(
            0.5, 0.5, "stable everywhere in this picture,\nat every delay named above", transform=panel.transAxes,
            ha="center", va="center", fontsize=11, color=INK,
        )  # fmt: skip


def line_style(number: int) -> Style:
    """Return colour and dashes of line number n."""
    return {"color": colour(number), "lw": 1.8, "linestyle": LINES[number % len(LINES)]}


def legend_of(regions: Sequence[Region]) -> Legend:
    return [
        (
            f"{frames(region.delay_frames)} each way ({_ms(region):.3g} ms): {extent(region.boundary)}",
            line_style(number),
        )
        for number, region in enumerate(regions)
    ]


def frames(count: float) -> str:
    return f"{count:g} frame" if count == 1.0 else f"{count:g} frames"


def _ms(region: Region) -> float:
    return region.session.people[0].up.frames * region.session.frame_s * 1e3


def extent(boundary: Boundary) -> str:
    """Return the extent of a region in words."""
    if boundary.open.all():
        return "stable everywhere here"
    if boundary.nowhere:
        return "stable at no stiffness"
    diagonal = np.abs(np.subtract(*boundary.points_npm.T)).argmin()
    beyond = "over " if boundary.open[diagonal] else ""
    return f"to {beyond}{boundary.points_npm[diagonal].min():.4g} N/m if both are alike"


def caption_of(regions: Sequence[Region], conditions: str) -> str:
    session = regions[0].session
    people = "; ".join(
        f"{person.name}: device {person.device_mass_kg:g} kg, b = {person.impedance_nspm:g} N s/m, "
        f"B = {person.damping_nspm:g} N s/m"
        for person in session.people
    )
    thing = "a fixed wall" if session.fixed else f"object {session.object_mass_kg:g} kg"
    return (
        f"Stiffnesses below and to the left of a line are stable at that line's delay, those beyond it are not ({conditions}); "
        f"{thing}; {people}. Each line was traced by the crossing of an eigenvalue through the unit circle and verified "
        "on both sides."
    )


def region_rows(regions: Sequence[Region], box_npm: tuple[float, float]) -> list[list[Any]]:
    """Return every point of every boundary, then the cells of the grids, if any."""
    rows: list[list[Any]] = []
    for region in regions:
        boundary = region.boundary
        columns = (boundary.points_npm, boundary.open, boundary.inside, boundary.outside)
        for (k1, k2), open_, inside, outside in zip(*(column.tolist() for column in columns), strict=True):
            kind, beyond = ("frame", "") if open_ else ("boundary", outside)
            rows.append([region.delay_frames, kind, k1, k2, inside, beyond])
        if region.grid is not None:
            k1s, k2s = grid_axes(box_npm, len(region.grid))
            for k2, line in zip(k2s.tolist(), region.grid.tolist(), strict=True):
                rows += [
                    [region.delay_frames, "cell", k1, k2, value, ""]
                    for k1, value in zip(k1s.tolist(), line, strict=True)
                ]
    return rows


def region_record(
    regions: Sequence[Region], box_npm: tuple[float, float], settings: Settings, hands: bool, estimated: bool
) -> dict[str, Any]:
    """Return the answer as JSON: the query, and every boundary."""
    session = regions[0].session
    return {
        "question": {
            "settings": msgspec.to_builtins(settings),
            "scheme": session.form,
            "hands": hands,
            "estimated": estimated,
            "delays_frames": [region.delay_frames for region in regions],
            "to_npm": list(box_npm),
            "grid": 0 if regions[0].grid is None else len(regions[0].grid),
        },
        "boundaries": [
            {
                "delay_frames": region.delay_frames,
                "verified": region.boundary.verified,
                "unstable_probes": region.boundary.unstable_probes,
                "points_npm": region.boundary.points_npm.tolist(),
                "open": region.boundary.open.tolist(),
                "radius_inside": region.boundary.inside.tolist(),
                "radius_outside": [value if np.isfinite(value) else None for value in region.boundary.outside.tolist()],
            }
            for region in regions
        ],
    }
