"""Tests of two to sixteen people on one object: their effect together, and its independence of seats."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from cogrip.cli.settings.settings_file import load
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.wire.messages import MAX_MESSAGE_BYTES, VIEWED_SEATS, Stamp, View, encode
from cogrip.results.writing.summary import of_laboratory
from cogrip.server.schemes import make_world
from cogrip.server.worlds.world import World
from cogrip.sim.laboratory import Laboratory

from tests.extent import long
from tests.kinds import FREE_OBJECTS
from tests.sim.session_measures import by_tick, laboratory_of, least_margin

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
T = 1.0 / 128.0
counts = st.integers(2, 16)
kinds = st.sampled_from(FREE_OBJECTS)
axes = st.integers(1, 3)
seeds = st.integers(0, 2**32 - 1)

Array = NDArray[np.float64]


def world(count: int, kind: str, dimensions: int, sides: list[str] | None = None, **coupling: float) -> World:
    """A free object with everybody at it and all springs grown."""
    sides = sides or ["left", "right"] * count
    users = [{"name": f"u{number}", "side": sides[number]} for number in range(count)]
    table = {"object": {"kind": kind, "axes": dimensions}, "coupling": coupling, "users": users}
    asked = resolve(table)
    made = make_world([seat_settings(asked, number) for number in range(count)])
    for number in range(count):
        made.join(number, np.zeros(dimensions))
    made.stiffness, made.damping = made.target_stiffness, made.target_damping
    return made


@settings(max_examples=20)
@given(counts, kinds, axes, st.floats(1.0, 5.0), seeds)
def test_momentum_and_energy_of_many_hands(count: int, kind: str, dimensions: int, log_K: float, seed: int) -> None:
    """m_o dv = T sum F; energy that came in by all lines less what went out is never less than the energy stored."""
    random = np.random.default_rng(seed)
    held = world(count, kind, dimensions, stiffness_npm=10.0**log_K)
    came_j = 0.0
    for _ in range(40):
        before = held.velocity.copy()
        waves = random.uniform(-0.5, 0.5, (count, dimensions))
        back = held.step(waves)
        came_j += 0.5 * T * float((waves**2 - back**2).sum())
        force = np.asarray(held.force)
        total = force.sum(axis=0)
        scale = 1.0 + float(np.abs(force).sum())
        assert held.mass_kg * (held.velocity - before) == pytest.approx(T * total, abs=1e-10 * scale)
        kinetic_j = 0.5 * held.mass_kg * float(held.velocity @ held.velocity)
        assert came_j >= kinetic_j - 1e-9 * scale
        assert held.balance_error_j <= 1e-9 * scale


@settings(max_examples=20)
@given(counts, kinds, axes, seeds)
def test_the_order_of_seats_changes_nothing(count: int, kind: str, dimensions: int, seed: int) -> None:
    """Only the last bits differ: sums are added up in another order."""
    random = np.random.default_rng(seed)
    order = random.permutation(count)
    sides = random.choice(["left", "right"], count).tolist()
    one, other = (world(count, kind, dimensions, these) for these in (sides, [sides[number] for number in order]))
    for _ in range(40):
        waves = random.uniform(-0.5, 0.5, (count, dimensions))
        np.testing.assert_allclose(other.step(waves[order]), one.step(waves)[order], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(other.position, one.position, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(np.asarray(other.force), np.asarray(one.force)[order], rtol=1e-8, atol=1e-8)


@settings(max_examples=20)
@given(counts, kinds, st.floats(1.0, 5.0), seeds)
def test_as_many_alike_are_one_who_is_as_many_times_as_strong(count: int, kind: str, log_K: float, seed: int) -> None:
    """n times K, B and b take waves sqrt(n) as large: c u, and so the object's motion, is the same; forces add up to one's."""
    K, B, b = 10.0**log_K, 10.0, 20.0
    random = np.random.default_rng(seed)
    many = world(count, kind, 1, ["left"] * count, stiffness_npm=K, damping_nspm=B, impedance_nspm=b)
    strong = world(1, kind, 1, ["left"], stiffness_npm=count * K, damping_nspm=count * B, impedance_nspm=count * b)
    for _ in range(40):
        wave = random.uniform(-0.5, 0.5)
        back = many.step(np.full((count, 1), wave))
        alone = strong.step(np.full((1, 1), math.sqrt(count) * wave))
        np.testing.assert_allclose(back, np.full((count, 1), alone[0, 0] / math.sqrt(count)), rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(many.position, strong.position, rtol=1e-8, atol=1e-12)
        np.testing.assert_allclose(np.asarray(many.force).sum(), np.asarray(strong.force).sum(), rtol=1e-8, atol=1e-8)


# Whole sessions ------------------------------------------------------------------------------------------------------


def hands(count: int, kind: str, dimensions: int) -> list[dict[str, Any]]:
    """Each in a direction of their own; where things are pushed, from alternate sides."""
    users = []
    for number in range(count):
        angle = 2.0 * math.pi * number / count
        direction = [math.cos(angle), math.sin(angle), 0.5][:dimensions]
        side = ("left", "right")[number % 2]
        if kind == "faces":
            direction[0] = 1.0 if side == "left" else -1.0
        direction = ",".join(f"{each:.3f}" for each in direction)
        hand = f"reach&amplitude_m=0.02&stroke_s=0.3&delay_s={0.02 * number}&direction={direction}"
        users.append({"name": f"u{number}", "device": "sim:ideal", "hand": hand, "side": side})
    return users


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("count", "kind", "dimensions", "K"),
    [
        long(16, "cube", 1, 1e5), long(16, "cube", 3, 1e3), (16, "faces", 3, 1e4), long(9, "faces", 1, 1e5),
        (5, "cube", 3, 1e5),
    ],
)  # fmt: skip
def test_many_hands_make_no_energy(count: int, kind: str, dimensions: int, K: float) -> None:
    link = {"delay_ms": 12, "jitter_ms": 6, "loss": 0.1, "burst_frames": 2, "reorder": 0.05}
    thing, users = {"kind": kind, "axes": dimensions}, hands(count, kind, dimensions)
    table = {"object": thing, "coupling": {"stiffness_npm": K}, "link": link, "users": users}
    laboratory = laboratory_of(seconds=0.4, playout={"frames": 2}, **table)
    laboratory.run()
    summary = of_laboratory(laboratory)
    assert laboratory.incident == ""
    assert summary["passive"]
    assert summary["object"]["travel_m"] > 1e-3, "it was moved"
    assert summary["server"]["energy_balance_error_j"] < 1e-9
    assert least_margin(summary) >= -1e-12
    assert {user["state"] for user in summary["users"]} <= {"live", "degraded"}  # one of many is shaken, and let go


def test_the_same_people_on_other_seats_move_it_in_the_same_way() -> None:
    """A whole session of five on a link that does the same to everybody."""
    paths = []
    for turn in (0, 2):
        people = hands(5, "cube", 3)
        users, link = [*people[turn:], *people[:turn]], {"delay_ms": 20}
        laboratory = laboratory_of(seconds=0.5, object={"axes": 3}, link=link, users=users)
        paths.append(np.array(by_tick(laboratory, lambda now: now.room.world.motion()[:3])))
    assert np.abs(paths[0]).max() > 1e-3
    np.testing.assert_allclose(paths[0], paths[1], atol=1e-9)


# What is told of them ------------------------------------------------------------------------------------------------


def test_a_view_has_room_for_sixteen_in_three_axes() -> None:
    row = (-1.0 / 3.0,) * (3 * VIEWED_SEATS)
    largest = View(2**63 - 1, 2**53, row[:6], (255,) * VIEWED_SEATS, row, row, Stamp(2**63 - 1, 2**63 - 1, 2**63 - 1))
    assert VIEWED_SEATS >= 16
    assert len(encode(largest)) <= MAX_MESSAGE_BYTES


@pytest.mark.parametrize(("name", "people"), [("five-users.toml", 5), ("sixteen-users.toml", 16)])
def test_the_shipped_rooms_of_many_hold(name: str, people: int) -> None:
    laboratory = Laboratory(load(CONFIGS / name, ("seconds=0.3",)))
    laboratory.run()
    summary = of_laboratory(laboratory)
    assert len(summary["users"]) == people
    assert summary["passive"]
    assert not any(summary[key] for key in ("unstable", "saturated", "left"))
