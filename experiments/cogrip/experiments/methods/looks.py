"""The look of a comparison's plots: a colour and marker for each method, a shade for each person, a fill for each verdict."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.colors import to_rgb

from cogrip.experiments.methods.measures import Mark, State
from cogrip.experiments.methods.method import METHODS
from cogrip.results.plots.style import INK, Style, colour, person_style, shade

MARKERS = "osD^v<P"
COLOURS = (*(colour(number) for number in range(6)), "#882255")
"""A colour and a marker of its own for each method: the six hues of people's palette, and a purple that none of them is."""
_LOOKS = dict(zip(METHODS, zip(COLOURS, MARKERS, strict=True), strict=True))
WORDS: Mapping[State, str] = {
    "diverged": "diverged",
    "oscillates": "oscillates",
    "not_passive": "stable, not passive",
    "passive": "stable and passive",
}
MARK_WORDS: Mapping[Mark, str] = {
    "unstable": "unstable, not passive",
    "unstable_passive": "unstable, passive",
    "not_passive": WORDS["not_passive"],
    "passive": WORDS["passive"],
}
WARNING = "#8a5a00"
"""Colour of words on a session that is stable and not passive; those on an unstable one are in ALARM."""
FRAMED = 1.3  # line width around the part of a bar whose sessions are passive
# marks in the order in which they are drawn: the first below the median, the others above it
FILLS: Mapping[Mark, Style] = {
    "passive": {"mec": "white", "mew": 0.2},
    "not_passive": {"fillstyle": "bottom", "markerfacecoloralt": "white", "mew": 1.0},
    "unstable": {"mfc": "white", "mew": 1.0},
    "unstable_passive": {"mec": INK, "mew": 1.2},
}
_SHADES = ("full", "dark", "pale")  # shades of a method's colour, by person


def style_of(method: str) -> Style:
    """Return a method's colour and marker: the same in every figure, whatever it is compared with."""
    tint, marker = _LOOKS[method]
    return {"color": tint, "marker": marker}


def bar_look(state: State, mark: Mark, tint: str) -> Style:
    """Return the look of a bar's part in a method's colour: white in a frame where its sessions are passive all the same."""
    if mark == "unstable_passive":
        return {"facecolor": "white", "edgecolor": tint, "lw": FRAMED, "hatch": "///" if state == "oscillates" else ""}
    looks: dict[State, Style] = {
        "oscillates": {"alpha": 0.45, "hatch": "///", "edgecolor": "white"},
        "not_passive": {"alpha": 0.25},
    }
    return {"facecolor": tint, "lw": 0, **looks.get(state, {})}


def person_look(person: int, tint: str) -> Style:
    """Return person n's shade of a method's colour, and marker, which together tell people apart."""
    look = _SHADES[person % len(_SHADES)]
    shaded = (
        shade(tint, 0.5) if look == "pale" else tuple((0.5 if look == "dark" else 1.0) * part for part in to_rgb(tint))
    )
    return {**person_style(person), "color": shaded}
