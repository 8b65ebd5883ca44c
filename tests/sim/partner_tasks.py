"""Tasks of two people who hold one cube, and how far their forces are from those of the cube directly in the hands.

A task is a course of each hand: times [s] from START_S on and places [m], with minimum-jerk strokes between. The reference is a
session of the same hands and devices without a network, with springs at the device rate (`ideal_settings`): what a device does
to a force is in both, and what is left is the network's.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from cogrip.experiments.methods.method import ideal_settings, session_settings
from cogrip.protocol.settings.sections import Settings
from cogrip.sim.laboratory import Laboratory

Array = npt.NDArray[np.float64]
Course = tuple[tuple[float, ...], tuple[float, ...]]
START_S = 2.0  # time by which everybody is there and rests
SKIP_S = 0.25  # first part of a task that is not counted, as it begins at rest
K_NPM, B_NSPM, OBJECT_KG = 1000.0, 10.0, 0.2
EXACT, REAL = "sim:ideal?mass_kg=0.1&damping_nspm=0.5", "sim:phantom"


class Person(NamedTuple):
    """A hand, its course, and when it lets go, if it does."""

    course: Course
    stiffness_npm: float = 300.0
    damping_nspm: float = 5.0
    lets_go_s: float | None = None

    def address(self) -> str:
        """Return the hand as settings name it."""
        times, places = self.course
        given = (
            f"times_s={','.join(f'{START_S + time:.4f}' for time in times)}&x_m={','.join(f'{x:.5f}' for x in places)}"
        )
        held = f"hand_stiffness_npm={self.stiffness_npm}&hand_damping_nspm={self.damping_nspm}"
        let_go = "" if self.lets_go_s is None else f"&let_go_s={START_S + self.lets_go_s}"
        return f"waypoints&{given}&{held}{let_go}"


def moves(place_m: float, stroke_s: float = 0.5) -> Course:
    """Return a course that goes to a place and rests there."""
    return (0.5, 0.5 + stroke_s), (0.0, place_m)


def to_and_fro(place_m: float, stroke_s: float, delay_s: float = 0.001, until_s: float = 30.0) -> Course:
    """Return a course that goes to a place and back again and again."""
    count = int((until_s - delay_s) / stroke_s)
    return tuple(delay_s + each * stroke_s for each in range(count + 1)), tuple(
        place_m * (each % 2) for each in range(count + 1)
    )


def task_people(name: str, stiffness_npm: float = 300.0, damping_nspm: float = 5.0) -> tuple[Person, ...]:
    """Return the people of a task."""
    courses: Mapping[str, tuple[Course, ...]] = {
        "pull": (moves(0.03), moves(-0.03)),
        "opposed": (to_and_fro(0.02, 0.8), to_and_fro(-0.02, 0.8)),
        "rest": (moves(0.03), moves(0.0)),
        "collide": (moves(0.04, 0.15), moves(-0.04, 0.15)),
        "together": (to_and_fro(0.03, 0.8), to_and_fro(0.03, 0.8, 0.1)),
        "apart": (to_and_fro(0.03, 1.0), to_and_fro(0.03, 1.0, 0.25)),
        "let go": (moves(0.03), moves(-0.03)),
        "limp": (to_and_fro(0.04, 1.0), moves(0.0)),
    }
    if name == "limp":
        return Person(courses[name][0]), Person(courses[name][1], 10.0, 10.0)
    people = [Person(course, stiffness_npm, damping_nspm) for course in courses[name]]
    if name == "let go":
        people[1] = people[1]._replace(lets_go_s=3.0)
    return tuple(people)


TASKS = ("pull", "opposed", "rest", "collide", "together", "apart", "let go", "limp")


def settings_of(
    people: Sequence[Person | str], delay_ms: float, device: str = EXACT, seconds: float = 6.0, **link: Any
) -> dict[str, Any]:
    """Return the settings of these hands: each a person, or the address of a hand."""
    hands = [each.address() if isinstance(each, Person) else each for each in people]
    sides = {0: {"side": "left"}, 1: {"side": "right"}} if len(hands) == 2 else {}
    return {
        "seconds": START_S + seconds, "coupling": {"stiffness_npm": K_NPM, "damping_nspm": B_NSPM, "impedance_nspm": 20.0},
        "object": {"axes": 1, "mass_kg": OBJECT_KG}, "link": {"delay_ms": delay_ms, **link},
        "users": [
            {"name": f"p{number}", "device": device, "hand": hand, **sides.get(number, {})}
            for number, hand in enumerate(hands)
        ],
    }  # fmt: skip


class Felt(NamedTuple):
    """Course from START_S on: forces and places of all hands at each tick, shape (ticks, people), and the session."""

    force_n: Array
    place_m: Array
    laboratory: Laboratory


def run(settings: Settings) -> Felt:
    """Run a session to its end."""
    laboratory = Laboratory(settings)
    rows: list[list[float]] = []
    places: list[list[float]] = []

    def each_tick(now: Laboratory) -> None:
        rows.append([person.core.force_n[0] for person in now.people])
        places.append([person.device.plant.position_m[0] for person in now.people])  # type: ignore[attr-defined]

    laboratory.run(each_tick)
    first = round(START_S * 1024)
    return Felt(np.array(rows)[first:], np.array(places)[first:], laboratory)


@lru_cache(maxsize=32)
def ideal(people: tuple[Person | str, ...], device: str = EXACT, seconds: float = 6.0) -> Felt:
    """Return what the same hands and devices feel with the cube directly in the hands."""
    return run(ideal_settings(settings_of(people, 0.0, device, seconds), 1))


@lru_cache(maxsize=2)
def felt(
    method: str, people: tuple[Person | str, ...], delay_ms: float, device: str = EXACT, seconds: float = 6.0, seed: int = 1,
    change: Callable[[dict[str, Any]], None] | None = None, **link: Any,
) -> Felt:  # fmt: skip
    """Return what these hands feel by a method of `cogrip compare`. change: of the settings, before they are resolved."""
    table = settings_of(people, delay_ms, device, seconds, **link)
    if change is not None:
        change(table)
    return run(session_settings(table, method, "own", seed))


def rms_n(forces: Array) -> float:
    """Return the root mean square of forces, or of differences, behind what is left out."""
    return float(np.sqrt((forces[round(SKIP_S * 1024) :] ** 2).mean()))


def error_n(found: Felt, wanted: Felt) -> float:
    """Return how far forces are from those that were wanted."""
    ticks = min(len(found.force_n), len(wanted.force_n))
    return rms_n(found.force_n[:ticks] - wanted.force_n[:ticks])


def several(count: int, seed: int = 1) -> tuple[Person, ...]:
    """Return people of mixed hands who each go where they like, slowly."""
    random = Random(seed)
    people = []
    for _ in range(count):
        times, places = [0.2], [0.0]
        while times[-1] < 30.0:
            times.append(times[-1] + random.uniform(0.5, 1.5))
            places.append(random.uniform(-0.03, 0.03))
        stiffness = random.choice((150.0, 300.0, 500.0))
        people.append(Person((tuple(times), tuple(places)), stiffness, stiffness / 60.0))
    return tuple(people)


def recorded_pairs(data: Path) -> dict[str, tuple[str, ...]]:
    """Return pairs of recorded hands by name, as addresses: the runs of levers, and two axes of one hand that moved freely."""

    def lever(file: str, run_name: str) -> str:
        return f"csv:{data / file}&time=t_s&x=theta_m_rad&scale=0.075&where=run:{run_name}&start_s={START_S}"

    def free(file: str, column: str, more: str = "time=t_s") -> str:
        return f"csv:{data / file}&{more}&x={column}&start_s={START_S}"

    tue, touch, pen = (
        ("tue_1dof_PP_kp8.csv", "tue_1dof_PF_kp15.csv"),
        "touch_freehand_wpi_100hz.csv",
        "pen_wacom_bdalab_133hz.csv",
    )
    panda, clock = "panda_handguided_symbol17_rec0_2_4.csv", "time=i&time_scale=0.001&where=rec:0"
    return {
        "levers, free": (lever(tue[0], "free"), lever(tue[1], "free")),
        "levers, spring": (lever(tue[0], "spring"), lever(tue[1], "spring")),
        "levers, rigid": (lever(tue[0], "rigid"), lever(tue[1], "rigid")),
        "arm, x and y": (free(touch, "px_mm"), free(touch, "py_mm")),
        "pen, x and y": (free(pen, "x_mm"), free(pen, "y_mm")),
        "guided robot, x and y": (free(panda, "px_m", clock), free(panda, "py_m", clock)),
    }
