"""How a session is drawn, in plots and on every page: colours of people, sizes, and where each holds the object."""

from collections.abc import Sequence
from functools import lru_cache

from cogrip.machine.rows import Vector
from cogrip.protocol.settings.object_kinds import kind_of

FORCE_M_PER_N = 0.01  # length of a force's arrow
LEAST_DRAWN_N = 0.02  # a smaller force is neither an arrow nor a contact
HAND_SIZE_M = 0.008  # diameter of a hand's or proxy's sphere
OBJECT_COLOUR = "#8A8F98"
_CUBE_M: Vector = (0.04, 0.04, 0.04)
_WALL_M: Vector = (0.004, 0.12, 0.12)
_APART_M = 0.02  # distance between people on one side, as long as they fit on it
# Okabe and Ito's palette, told apart with any colour vision; yellow is too pale for a line on white.
_PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
COLOURS = 3 * len(_PALETTE)  # number of colours that `colour` tells apart


@lru_cache(256)
def colour(seat: int) -> str:
    """Return a person's colour as #rrggbb, in plots and the browser: from the seventh on darker, from the thirteenth paler."""
    base = _PALETTE[seat % len(_PALETTE)]
    parts = [int(base[each : each + 2], 16) / 255 for each in (1, 3, 5)]
    round_ = seat // len(_PALETTE) % 3
    if round_ == 1:
        parts = [0.55 * part for part in parts]
    elif round_ == 2:
        parts = [0.45 + 0.55 * part for part in parts]
    return "#" + "".join(f"{round(255 * part):02X}" for part in parts)


def object_size_m(kind: str) -> Vector:
    """Return the size at which an object of the settings' kind is drawn."""
    return _WALL_M if kind_of(kind).fixed else _CUBE_M


def anchors_m(kind: str, sides: Sequence[str]) -> list[Vector]:
    """Return the point on the object at which each person holds it, in the order of the seats; sides: `left` or `right`.

    A cube is gripped from anywhere: where all are said to be on one side they take turns.
    """
    if kind_of(kind).held and len(set(sides)) == 1:
        sides = [("left", "right")[seat % 2] for seat in range(len(sides))]
    if not kind_of(kind).plain:  # the tool itself
        return [(0.0, 0.0, 0.0)] * len(sides)
    depth, width, _ = object_size_m(kind)
    found: list[Vector] = []
    for seat, side in enumerate(sides):
        before, there = sides[:seat].count(side), sides.count(side)
        apart = min(_APART_M, width / there)
        found.append((-depth / 2 if side == "left" else depth / 2, (before - (there - 1) / 2) * apart, 0.0))
    return found
