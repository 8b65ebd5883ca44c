"""The look of a comparison's plots: a colour and marker for each method, a shade for each person, a fill for each verdict."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.colors import to_rgb

from cogrip.sim.experiments.methods.measures import State
from cogrip.sim.experiments.methods.method import METHODS
from cogrip.sim.runs.plots.style import Style, colour, person_style, shade

NUMBERS = {method: number for number, method in enumerate(METHODS)}
MARKERS = "osD^v<"
WORDS: Mapping[State, str] = {
    "diverged": "diverged",
    "oscillates": "oscillates",
    "not_passive": "stable, not passive",
    "passive": "stable and passive",
}
LOOKS: Mapping[State, Style] = {
    "diverged": {},
    "oscillates": {"alpha": 0.45, "hatch": "///", "edgecolor": "white", "lw": 0},
    "not_passive": {"alpha": 0.25},
}
_HOLLOW: Style = {"mfc": "none", "mew": 0.9}
FILLS: Mapping[State, Style] = {
    "diverged": _HOLLOW,
    "oscillates": _HOLLOW,
    "not_passive": {"fillstyle": "bottom", "markerfacecoloralt": "white", "mew": 0.9},
    "passive": {"mew": 0},
}
_SHADES = ("full", "dark", "pale")  # of a method's colour, by person


def style_of(method: str) -> Style:
    """Return a method's colour and marker: the same in every figure, whatever it is compared with."""
    number = NUMBERS[method]
    return {"color": colour(number), "marker": MARKERS[number % len(MARKERS)]}


def person_look(person: int, tint: str) -> Style:
    """Return person n's shade of a method's colour, and marker, which together tell people apart."""
    look = _SHADES[person % len(_SHADES)]
    shaded = (
        shade(tint, 0.5) if look == "pale" else tuple((0.5 if look == "dark" else 1.0) * part for part in to_rgb(tint))
    )
    return {**person_style(person), "color": shaded}
