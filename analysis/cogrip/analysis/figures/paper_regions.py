"""The paper's Fig. 4 and Fig. 6 from the lifted model, beside ours, and their dependence on masses that P omits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import isnan
from typing import Any

import msgspec
import numpy as np
from matplotlib.axes import Axes

from cogrip.analysis.figures.page import FigurePage, FigureTable
from cogrip.analysis.figures.region import COLUMNS, draw_regions, frames, line_style, region_rows
from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import (
    FORMS,
    Form,
    LinearPerson,
    LinearSession,
    form_overrides,
    linear_session,
)
from cogrip.analysis.linear.region import Region, regions, traced
from cogrip.analysis.linear.stability import largest_stable
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.results.plots.style import INK, Sheet, title

DELAYS_FRAMES = (0.0, 1.0, 2.0, 4.0)
NETWORK_HZ = 128
DEVICE_KG = 0.1
OBJECT_KG = 0.2
SHOWN_DEVICES_KG = (0.045, 0.1)
DEVICE_MASSES_KG = (0.045, 0.1, 0.3, 1.0)
OBJECT_MASSES_KG = tuple(np.geomspace(0.1, 1.0, 21).tolist())
MASS_DELAYS_FRAMES = (0.0, 1.0, 4.0)


def paper_settings(form: Form, device_kg: float = DEVICE_KG, object_kg: float = OBJECT_KG) -> Settings:
    """Return P section VI: b = 20, B = 10 N s/m, no device damping, 1024 and 128 Hz; two users alike; masses are ours."""
    people = [
        {"name": name, "device": "sim:ideal", "hand": "push", "device_mass_kg": device_kg}
        for name in ("user 1", "user 2")
    ]
    return resolve({"object": {"mass_kg": object_kg}, "users": people}, form_overrides(form))


def one_scheme(form: Form, name: str, heading: str, ways: Sequence[tuple[str, int]] = (("", 0),)) -> FigurePage:
    """Draw one scheme's region at the four delays, for a light device and for theory section 6's, on the same axes.

    ways: a row of panels each, and by how many frames the server's answer is older there.
    """
    cases = [(way, older, device) for way, older in ways for device in SHOWN_DEVICES_KG]
    side = max(traced(_older(form, device, older), DELAYS_FRAMES)[1][0] for _, older, device in cases)
    sheet = Sheet(len(ways), len(SHOWN_DEVICES_KG), row_in=4.2)
    rows: list[list[Any]] = []
    results = []
    for panel, (way, older, device) in zip(np.ravel(sheet.panels), cases, strict=True):
        found, box = traced(_older(form, device, older), DELAYS_FRAMES, to_npm=(side, side))
        draw_regions(panel, found, box)
        title(panel, f"{f'{way}, ' if way else ''}devices of {device:g} kg, object of {OBJECT_KG:g} kg")
        rows += [[older, device, *row] for row in region_rows(found, box)]
        limits = ", ".join(_words(region) for region in found)
        _note(panel, f"two alike: {limits} N/m")
        results.append(f"{f'{way}, ' if way else ''}devices of {device:g} kg: {limits} N/m")
    labels = ["stiffness $K_2$ [kN/m]"] * len(ways)
    figure = sheet.finish("stiffness $K_1$ [kN/m]", labels, _delays_legend(), columns=4)
    caption = (
        f"{heading}. Stable below and to the left of a line, idealised as in P: exact velocities; b = 20, B = 10 N s/m, "
        f"no device damping, object {OBJECT_KG:g} kg "
        "(P prints no masses: these are ours). Largest stable stiffness of two alike, at 0, 1, 2, 4 frames each way: "
        f"{'; '.join(results)}. Every line is traced and verified on both sides."
    )
    return FigurePage(
        name, heading, caption, figure, FigureTable(("answer_older_frames", "device_mass_kg", *COLUMNS), rows)
    )


def virtual_coupling() -> FigurePage:
    """Draw Fig. 6 with the object after the server's step as its answer, as in every scheme here, and before it."""
    ways = (("answer after the step", 0), ("answer before the step", 1))  # which is after the one before
    return one_scheme("coupling", "fig6", "Fig. 6: virtual coupling", ways)


def _older(form: Form, device_kg: float, older_frames: int) -> list[LinearSession]:
    """Return the session at each delay, with answers that are so many frames older."""
    settings = paper_settings(form, device_kg)
    sessions = [linear_session(settings, delay_frames=delay, estimated=False) for delay in DELAYS_FRAMES]
    return [replace(session, people=tuple(_late(one, older_frames) for one in session.people)) for session in sessions]


def _late(person: LinearPerson, frames: int) -> LinearPerson:
    ticks = frames * person.rates.ticks_per_frame
    return replace(person, down=person.down._replace(link_ticks=person.down.link_ticks + ticks))


def side_by_side() -> FigurePage:
    """Draw the three schemes on the same axes: estimated velocities above, exact ones, as in P, below."""
    box = max(regions(paper_settings(form), DELAYS_FRAMES, estimated=False)[1] for form in ("paper", "coupling"))
    order: tuple[Form, ...] = ("coupling", "paper", "passive")
    sheet = Sheet(2, len(order), row_in=3.4)
    rows: list[list[Any]] = []
    results: dict[bool, str] = {}
    for line, estimated in zip(sheet.panels, (True, False), strict=True):
        found = {form: _side(form, estimated, box) for form in order}
        for panel, form in zip(line, order, strict=True):
            draw_regions(panel, found[form], box)
            title(panel, f"{FORMS[form].short}, {'estimated velocity' if estimated else 'idealised'}")
            rows += [[form, estimated, *row] for row in region_rows(found[form], box)]
        results[estimated] = "; ".join(
            f"{FORMS[form].title} {', '.join(_words(region) for region in found[form])}" for form in order
        )
    figure = sheet.finish("$K_1$ [kN/m]", ["$K_2$ [kN/m]"] * 2, _delays_legend(), columns=4)
    caption = (
        f"The same two users, devices of {DEVICE_KG:g} kg, object of {OBJECT_KG:g} kg, on the same axes. Above, devices give "
        "positions alone and clients estimate velocities, as they do at a real arm; below, the idealised session of P, with "
        "exact velocities. Largest stable stiffness of two alike at 0, 1, 2, 4 frames each way [N/m], estimated: "
        f"{results[True]}; idealised: {results[False]}. With exact velocities P's claim of a larger region holds from two "
        "frames of delay on; at one frame the regions are alike. Without delay the answers of virtual coupling are ahead of "
        "the hands, which nothing damps here. cogrip's server step, which solves the ports within the step, has no border "
        "of its own. An estimate that is given the forces and the devices' exact masses leaves the limits as they are; the "
        "paper's waves are made of the velocity, which then is of positions alone."
    )
    columns = ("scheme", "estimated", *COLUMNS)
    return FigurePage(
        "regions", "Virtual coupling, the paper's waves, and ours", caption, figure, FigureTable(columns, rows)
    )


def _side(form: Form, estimated: bool, box_npm: tuple[float, float]) -> list[Region]:
    settings = paper_settings(form)
    if estimated:  # P's devices but for their velocities: without friction, to be linear
        device = f"sim:phantom?mass_kg={DEVICE_KG!r}&friction_n=0"
        users = tuple(msgspec.structs.replace(user, device=device) for user in settings.users)
        settings = msgspec.structs.replace(settings, users=users)
    return regions(settings, DELAYS_FRAMES, to_npm=box_npm, estimated=estimated)[0]


def _words(region: Region) -> str:
    limit = _largest(region.session)
    return "any" if limit is None else "none" if limit == 0.0 else f"{limit:.0f}"


def masses() -> FigurePage:
    """Draw the largest stable stiffness of two users alike over the object's mass, for devices of several masses."""
    shown: tuple[Form, ...] = ("paper", "coupling")
    sheet = Sheet(len(MASS_DELAYS_FRAMES), len(shown), row_in=2.3)
    rows: list[list[Any]] = []
    for row, delay in enumerate(MASS_DELAYS_FRAMES):
        for column, form in enumerate(shown):
            panel = sheet.panels[row, column]
            for number, device in enumerate(DEVICE_MASSES_KG):
                limits = [_limit(form, device, object_, delay) for object_ in OBJECT_MASSES_KG]
                panel.plot(OBJECT_MASSES_KG, limits, **line_style(number))
                pairs = zip(OBJECT_MASSES_KG, limits, strict=True)
                rows += [[form, delay, device, object_, limit] for object_, limit in pairs]
            title(panel, f"{FORMS[form].title}, {frames(delay)} each way")
            _logarithmic(panel)
            if all(isnan(limit) for *_, limit in rows[-len(DEVICE_MASSES_KG) * len(OBJECT_MASSES_KG) :]):
                _note(panel, "stable at no stiffness")
    legend = [(f"device {device:g} kg", line_style(number)) for number, device in enumerate(DEVICE_MASSES_KG)]
    labels: Sequence[str] = ["largest stable\n$K_1 = K_2$ [N/m]"] * len(MASS_DELAYS_FRAMES)
    figure = sheet.finish("mass of the object [kg]", labels, legend, columns=4)
    caption = (
        "P prints no masses: its appendix is missing. The largest stable stiffness of two users alike, over the masses that "
        "devices and objects like P's have. Where a curve ends on the left the scheme is stable at no stiffness. With light "
        "devices (0.045 kg, about a Phantom Omni's) P's region hardly changes with delay, as P says; with heavier ones it "
        "shrinks. Idealised as in P: exact velocities, with which cogrip's passive scheme has no limit at any of these masses."
    )
    columns = ("scheme", "delay_frames", "device_mass_kg", "object_mass_kg", "largest_stable_stiffness_npm")
    return FigurePage("masses", "How the picture depends on masses", caption, figure, FigureTable(columns, rows))


def _limit(form: Form, device_kg: float, object_kg: float, delay_frames: float) -> float:
    session = linear_session(paper_settings(form, device_kg, object_kg), delay_frames=delay_frames, estimated=False)
    return _largest(session) or float("nan")


def _largest(session: LinearSession) -> float | None:
    """Return the largest stable stiffness of users who are alike [N/m]; None where there is no limit."""
    return largest_stable(LiftedModel(session), relative=1e-4).stiffness_npm


def _delays_legend() -> list[tuple[str, dict[str, Any]]]:
    return [
        (f"{frames(delay)} ({1e3 * delay / NETWORK_HZ:.3g} ms)", line_style(number))
        for number, delay in enumerate(DELAYS_FRAMES)
    ]


def _note(panel: Axes, text: str) -> None:
    """Write a line in a panel's upper right corner."""
    panel.text(0.97, 0.94, text, transform=panel.transAxes, ha="right", va="top", color=INK, backgroundcolor="w")


def _logarithmic(panel: Axes) -> None:
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.set_xticks([0.1, 0.2, 0.5, 1.0], ["0.1", "0.2", "0.5", "1"])
    panel.minorticks_off()
    panel.tick_params(colors=INK)
