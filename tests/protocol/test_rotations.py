"""Rotations in plain floats, against scipy's, and their laws."""

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cogrip.protocol.laws.rotations import UNTURNED, between, exp, inverse, log, product, turned

components = st.floats(-1.0, 1.0)
unit = st.tuples(components, components, components).filter(lambda v: np.linalg.norm(v) > 1e-3)
angles = st.one_of(st.floats(0.0, pi - 1e-6), st.floats(0.0, 1e-7))
vectors = st.builds(lambda v, a: tuple((a / np.linalg.norm(v) * np.array(v)).tolist()), unit, angles)


def scipys(q: tuple[float, ...]) -> Rotation:
    return Rotation.from_quat(q, scalar_first=True)


@given(vectors, vectors)
def test_they_are_scipys(a: tuple[float, ...], b: tuple[float, ...]) -> None:
    one, two = Rotation.from_rotvec(a), Rotation.from_rotvec(b)
    assert (scipys(exp(a)).inv() * one).magnitude() < 1e-12
    assert (scipys(product(exp(a), exp(b))).inv() * (one * two)).magnitude() < 1e-12
    assert turned(exp(a), b) == pytest.approx(one.apply(b), abs=1e-12)


@given(vectors)
def test_a_rotation_vector_comes_back(a: tuple[float, ...]) -> None:
    assert log(exp(a)) == pytest.approx(a, rel=1e-9, abs=1e-15)
    assert log([-each for each in exp(a)]) == pytest.approx(a, rel=1e-9, abs=1e-15), "-q is the same rotation"
    assert log([3.0 * each for each in exp(a)]) == pytest.approx(a, rel=1e-9, abs=1e-15)
    assert product(inverse(exp(a)), exp(a)) == pytest.approx(UNTURNED, abs=1e-15)


@given(vectors, vectors)
def test_between_takes_one_orientation_to_the_other(a: tuple[float, ...], b: tuple[float, ...]) -> None:
    way = between(exp(a), exp(b))
    assert np.linalg.norm(way) <= pi + 1e-12, "the shorter way round"
    assert (scipys(product(exp(way), exp(a))).inv() * Rotation.from_rotvec(b)).magnitude() < 1e-7
