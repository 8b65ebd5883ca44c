"""Tasks of two people with one cube in a comparison, by name: a hand of each, as settings name it.

A course begins after a second, by when everybody is there; hands are of 300 N/m and 5 N s/m but where a task says otherwise.
"""

from collections.abc import Mapping
from typing import NamedTuple

_HAND = "hand_stiffness_npm=300&hand_damping_nspm=5"
_LIMP = "hand_stiffness_npm=10&hand_damping_nspm=10"


class Task(NamedTuple):
    """Both hands of a task, and in words what they do."""

    what: str
    hands: tuple[str, str]


def _goes(place_m: float, stroke_s: float = 0.5) -> str:
    """Return a hand that goes to a place and stays there."""
    return f"waypoints&times_s=1,{1.0 + stroke_s}&x_m=0,{place_m}&{_HAND}"


def _lets_go(hand: str, after_s: float) -> str:
    return f"{hand}&let_go_s={1.0 + after_s}"


def _to_and_fro(place_m: float, stroke_s: float, late_s: float = 0.0) -> str:
    return f"reach&amplitude_m={place_m}&stroke_s={stroke_s}&delay_s={1.0 + late_s}&{_HAND}"


TASKS: Mapping[str, Task] = {
    "pull": Task("pull apart and hold", (_goes(0.03), _goes(-0.03))),
    "opposed": Task("move against each other, to and fro", (_to_and_fro(0.02, 0.8), _to_and_fro(-0.02, 0.8))),
    "together": Task("move to and fro together, 100 ms apart", (_to_and_fro(0.03, 0.8), _to_and_fro(0.03, 0.8, 0.1))),
    "rest": Task("one pushes, the other rests", (_goes(0.03), f"hold&{_HAND}")),
    "collide": Task("run into each other", (_goes(0.04, 0.15), _goes(-0.04, 0.15))),
    "let-go": Task("pull apart, then one lets go", (_goes(0.03), _lets_go(_goes(-0.03), 3.0))),
    "limp": Task("one drags a limp hand along", (_to_and_fro(0.04, 1.0), f"hold&{_LIMP}")),
}
