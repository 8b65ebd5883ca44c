"""The paper's Fig. 5: a constant force presses a device against a wall: hand, proxy and force over time, and stiffness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np

from cogrip.analysis.feel.feel import on_wall, slow_feel
from cogrip.analysis.figures.page import FigurePage, FigureTable
from cogrip.analysis.linear.linear_session import form_overrides, linear_session
from cogrip.analysis.linear.state_space import Array
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.settings.table import SettingsError
from cogrip.results.plots.style import DASHED, INK, Sheet, Style, draw, person_style, title
from cogrip.sim.laboratory import Laboratory

TD_MS = (10.0, 20.0)
FORCE_N = 1.0
SECONDS = 4.0
START_S = 0.5  # start of the push: the force is ramped in by then, and frames have the phase that they keep
SHOWN_S = -0.05, 1.15
DEVICE_DAMPING_NSPM = 1.0


@dataclass(frozen=True, slots=True)
class ContactRun:
    """One run: time from the push on [s], hand and proxy [m], force [N]; stiffness [N/m] predicted, and measured at its end."""

    name: str
    td_ms: float
    settings: Settings
    series: Array  # values of each tick, (ticks, 4)
    predicted_npm: float

    @property
    def measured_npm(self) -> float:
        return float(self.series[-1, 3] / self.series[-1, 1])


def wall_settings(td_ms: float, **overrides: Any) -> Settings:
    """Return P section VII with the numbers of its section VI, the scheme apart; 1 N s/m of device damping to come to rest."""
    person = {
        "name": "user", "device": "sim:ideal", "hand": f"push&force_n={FORCE_N:g}&start_s={START_S:g}",
        "device_damping_nspm": DEVICE_DAMPING_NSPM,
    }  # fmt: skip
    table = {"seconds": SECONDS, "object": {"kind": "wall"}, "link": {"delay_ms": td_ms}, "users": [person]}
    return resolve(table, overrides)


def contacts() -> list[ContactRun]:
    """Run P's scheme, ours as it is, and ours with the line's compliance compensated, at both delays."""
    found = []
    for td_ms in TD_MS:
        found.append(_run("the paper's scheme", td_ms, wall_settings(td_ms, **form_overrides("paper"))))
        found.append(_run("ours, b = 20 N s/m", td_ms, wall_settings(td_ms)))
        b = _enough_impedance(td_ms)
        compensated = wall_settings(td_ms, **{"coupling.compensate": True, "coupling.impedance_nspm": b})
        found.append(_run(f"compensated, b = {b:g} N s/m", td_ms, compensated))
    return found


def wall_page() -> FigurePage:
    """Draw Fig. 5 at both delays, for three schemes."""
    found = contacts()
    sheet = Sheet(2, len(TD_MS), row_in=2.7)
    rows: list[list[Any]] = []
    schemes = zip(*(_of(found, td_ms) for td_ms in TD_MS), strict=True)
    legend: list[tuple[str, Style]] = [
        (_named(each), {**person_style(number), "lw": 1.4}) for number, each in enumerate(schemes)
    ]
    legend.append(("hand, and the force on it", {"color": INK, "lw": 1.4}))
    legend.append(("proxy at the wall", {"color": INK, "lw": 1.2, "linestyle": DASHED}))
    for column, td_ms in enumerate(TD_MS):
        above, below = sheet.panels[:, column]
        for number, contact in enumerate(_of(found, td_ms)):
            time, hand, proxy, force = contact.series.T
            shown = (time >= SHOWN_S[0]) & (time <= SHOWN_S[1])
            style: Style = {**person_style(number), "zorder": 3.0 - 0.1 * number}  # what swings most is drawn first
            draw(above, time[shown], 1e3 * hand[shown], **style, lw=1.4)
            draw(above, time[shown], 1e3 * proxy[shown], **{**style, "marker": ""}, lw=1.2, ls=DASHED)
            draw(below, time[shown], force[shown], **style, lw=1.0)
            rows += [
                [contact.name, td_ms, *point, contact.measured_npm, contact.predicted_npm]
                for point in contact.series[::8].tolist()
            ]
        title(above, f"$T_d$ = {td_ms:g} ms each way")
    figure = sheet.finish("time from the push on [s]", ["hand and proxy [mm]", "force [N]"], legend, columns=3)
    results = "; ".join(
        f"{contact.name} at {contact.td_ms:g} ms: {contact.measured_npm:.0f} N/m measured, "
        f"{contact.predicted_npm:.0f} predicted"
        for contact in found
    )
    caption = (
        f"K = 1000 N/m is asked for, {FORCE_N:g} N presses. {results}. P reports about 1000 N/m at both delays with b = 20; "
        "its own equations give what is drawn here. A compensated line feels as stiff as asked; at 20 ms that takes a larger b."
    )
    columns = (
        "run", "td_ms", "time_s", "hand_m", "proxy_m", "force_n", "measured_stiffness_npm", "predicted_stiffness_npm",
    )  # fmt: skip
    return FigurePage("fig5", "Fig. 5: a wall touched through the line", caption, figure, FigureTable(columns, rows))


def _named(contacts: Sequence[ContactRun]) -> str:
    """Return the name of a scheme's runs, with the impedance at each delay where that differs."""
    names = dict.fromkeys(contact.name for contact in contacts)
    if len(names) == 1:
        return next(iter(names))
    values = " and ".join(f"{contact.settings.coupling.impedance_nspm:g}" for contact in contacts)
    return f"{contacts[0].name.partition(',')[0]}, b = {values} N s/m (left and right)"


def _of(found: list[ContactRun], td_ms: float) -> list[ContactRun]:
    return [contact for contact in found if contact.td_ms == td_ms]


def _run(name: str, td_ms: float, settings: Settings) -> ContactRun:
    laboratory = Laboratory(settings)
    rows: list[tuple[float, float, float, float]] = []
    person, world = laboratory.people[0], laboratory.room.world

    def watch(lab: Laboratory) -> None:
        core = person.core
        rows.append(
            (
                lab.tick / settings.rates.device_hz - START_S,
                core.position_m[0],
                float(world.proxy(0)[0]),
                core.force_n[0],
            )
        )

    laboratory.run(watch)
    predicted = slow_feel(on_wall(linear_session(settings, estimated=False), 0), 0).stiffness_npm
    return ContactRun(name, td_ms, settings, np.array(rows), predicted)


def _enough_impedance(td_ms: float) -> float:
    """Return P's b = 20 where it allows compensation, else the next ten that does."""
    for b in range(20, 200, 10):
        try:
            wall_settings(td_ms, **{"coupling.compensate": True, "coupling.impedance_nspm": float(b)})
        except SettingsError:
            continue
        return float(b)
    raise ValueError(f"no impedance below 200 N s/m compensates {ceil(td_ms)} ms")
