"""Worlds of every scheme save their state, and one that is made anew goes on from it bit for bit."""

from typing import Any

import numpy as np
import pytest

from cogrip.machine.rows import Row
from cogrip.protocol.settings.coupling_kinds import COUPLING_KINDS
from cogrip.server.schemes import make_world
from cogrip.server.worlds.world import World

from tests.kinds import objects_of
from tests.server.object_worlds import seats

SCHEMES: dict[str, dict[str, Any]] = {
    **{
        kind: {"kind": kind, "stiffness_npm": 1000.0 if traits.passive else 300.0}
        for kind, traits in COUPLING_KINDS.items()
    },
    "adapted": {"compensate": True},
    "paper": {"server_step": "paper", "stiffness_npm": 300.0},
}


def made(kind: str, scheme: str) -> World:
    return make_world(seats(3, kind, 2, **SCHEMES[scheme]))


def course(world: World, seed: int) -> list[object]:
    """Step it at random, with people who join and leave."""
    random = np.random.default_rng(seed)
    seen: list[object] = []
    for frame in range(80):
        if frame % 20 == 0:
            user = int(random.integers(3))
            world.leave(user) if world.holding[user] else world.join(user, 0.01 * random.normal(size=2))
        if frame % 20 == 10 and world.can_adapt_stiffness:
            world.set_target_stiffness(0, float(random.uniform(100.0, 2000.0)))
        rows: list[Row] = [tuple(row) for row in 0.05 * random.normal(size=(3, 2 * world.inputs_per_axis))]
        answers = [tuple(row) for row in world.advance(rows)]
        seen.append((answers, world.motion(), tuple(world.port_work_j()), [world.proxy_of(user) for user in range(3)]))
    return [seen, world.save(), world.energy_j]


@pytest.mark.parametrize(
    ("kind", "scheme"),
    [(kind, scheme) for scheme, coupling in SCHEMES.items() for kind in objects_of(coupling.get("kind", "wave"))],
)
def test_a_world_goes_on_bit_for_bit_where_it_was_saved(kind: str, scheme: str) -> None:
    world = made(kind, scheme)
    course(world, 1)
    saved = world.save()
    expected = course(world, 2)
    for again in (made(kind, scheme), world):
        again.restore(saved)
        assert again.save() == saved
        assert course(again, 2) == expected
