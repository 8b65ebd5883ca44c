"""Seats of rooms whose object is a cube, two faces or a wall, as given or drawn at random, and the energy of their worlds."""

from typing import Any

import numpy as np

from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.worlds.grip import GripWorld
from cogrip.server.worlds.push import PushWorld
from cogrip.server.worlds.world import World

Range = tuple[float, float]
FOLLOWING: dict[str, Any] = {"stiffness": (1.0, 4.0), "impedance": (3.0, 3.9), "compensate": True}
"""Return drawn seats whose stiffness can follow the delay."""


def seats(
    count: int, thing: str = "cube", axes: int = 1, object_: dict[str, Any] | None = None, **coupling: Any
) -> list[SeatSettings]:
    """Return seats on both sides in turn. object_: further settings of the object."""
    users = [{"name": f"user{number}", "side": ("left", "right")[number % 2]} for number in range(count)]
    settings = resolve(
        {"object": {"kind": thing, "axes": axes, **(object_ or {})}, "coupling": coupling, "users": users}
    )
    return [seat_settings(settings, number) for number in range(count)]


def drawn_seats(
    random: np.random.Generator, count: int, axes: int, thing: str = "cube",
    stiffness: Range = (0.0, 5.0), impedance: Range = (0.0, 2.0), **coupling: Any,
) -> list[SeatSettings]:  # fmt: skip
    """Return seats with an object and a coupling at random. stiffness, impedance: least and greatest power of ten."""
    object_ = {"damping_nspm": random.uniform(0.0, 5.0), "mass_kg": 10.0 ** random.uniform(-2, 1)}
    drawn = {"stiffness_npm": stiffness, "damping_nspm": (-1.0, 2.0), "impedance_nspm": impedance}
    return seats(
        count,
        thing,
        axes,
        object_,
        **{name: 10.0 ** random.uniform(*powers) for name, powers in drawn.items()},
        **coupling,
    )


def stored_j(world: World) -> float:
    """Return the energy of object and springs."""
    if isinstance(world, GripWorld):
        springs = world.stiffness * world.stretch**2
    else:
        assert isinstance(world, PushWorld)
        springs = world.stiffness[:, 0] * np.maximum(0.0, world.side * (world.hand[:, 0] - world.position[0])) ** 2
    return 0.5 * (float(springs.sum()) + world.mass_kg * float(world.velocity @ world.velocity))
