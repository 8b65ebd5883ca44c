"""Ways between poses: what is put back into them, and what makes a spring along them passive."""

from math import dist, pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.machine.addition import add_floats
from cogrip.protocol.axes import PLACES
from cogrip.protocol.laws.poses import IN_PLACES, IN_RADIANS, Poses
from cogrip.protocol.laws.rotations import exp

LENGTHS = st.floats(0.01, 1.0)
NUMBERS = st.floats(-1.0, 1.0)


def poses(length_m: float, most_rad: float) -> st.SearchStrategy[list[float]]:
    turned = st.lists(st.floats(-most_rad, most_rad), min_size=3, max_size=3)
    places = st.lists(NUMBERS, min_size=3, max_size=3)
    return st.builds(lambda place, turn: place + [length_m * each for each in turn], places, turned)


@given(st.data(), LENGTHS)
def test_who_goes_the_way_between_two_poses_is_at_the_other(data: st.DataObject, length_m: float) -> None:
    space = Poses(length_m)
    begin, end = (data.draw(poses(length_m, 1.0)) for _ in range(2))
    there = space.moved(begin, space.way(begin, end))
    assert there[:PLACES] == pytest.approx(end[:PLACES], abs=1e-12)
    turned, wanted = exp(space.radians(there)), exp(space.radians(end))
    assert abs(add_floats([a * b for a, b in zip(turned, wanted, strict=True)])) == pytest.approx(1.0, abs=1e-12)
    assert IN_PLACES.way(begin, end) == pytest.approx([b - a for a, b in zip(begin, end, strict=True)])


@given(st.data(), LENGTHS)
def test_the_way_back_is_the_same_way(data: st.DataObject, length_m: float) -> None:
    space = Poses(length_m)
    begin, end = (data.draw(poses(length_m, 1.0)) for _ in range(2))
    assert space.way(end, begin) == pytest.approx([-each for each in space.way(begin, end)], abs=1e-12)


@given(st.data(), LENGTHS)
def test_half_the_square_of_a_way_is_a_potential(data: st.DataObject, length_m: float) -> None:
    """A small move d of one end changes it by way d, however far the two are turned apart: so a spring makes nothing."""
    space = Poses(length_m)
    begin, end = (data.draw(poses(length_m, 0.8)) for _ in range(2))
    small = [1e-6 * each for each in data.draw(poses(length_m, 1.0))]

    def half_square(way: list[float]) -> float:
        return 0.5 * add_floats([each * each for each in way])

    way = space.way(begin, end)
    gained = half_square(space.way(begin, space.moved(end, small))) - half_square(way)
    assert gained == pytest.approx(add_floats([a * b for a, b in zip(way, small, strict=True)]), abs=1e-11)


def test_a_rotation_vector_that_goes_round_is_no_jump() -> None:
    """At half a turn the vector changes its sign, and the way between two samples stays small."""
    before, after = [0.0] * 5 + [pi - 0.01], [0.0] * 5 + [-pi + 0.01]
    assert IN_RADIANS.way(before, after) == pytest.approx([0.0] * 5 + [0.02])
    assert dist(IN_RADIANS.moved(before, [0.0] * 5 + [0.02]), after) < 1e-9
