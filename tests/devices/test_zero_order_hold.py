"""The exact step of a tick against the matrix exponential, and against itself in halves."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.linalg import expm

from cogrip.devices.simulated.zero_order_hold import TickStep, discretise


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    """Evenly spread logarithms, and 0."""
    return st.just(0.0) | st.floats(np.log(low), np.log(high)).map(np.exp).map(float)


def exponential(mass: float, damping: float, stiffness: float, rate_hz: int) -> np.ndarray:
    a = np.array([[0.0, 1.0, 0.0], [-stiffness / mass, -damping / mass, 1.0 / mass], [0.0, 0.0, 0.0]])
    return np.asarray(expm(a / rate_hz))


def as_matrix(step: TickStep) -> np.ndarray:
    return np.array([
        [1.0 - step.stiffness_npm * step.g, step.p, step.g], [-step.stiffness_npm * step.h, step.q, step.h], [0.0, 0.0, 1.0],
    ])  # fmt: skip


@given(
    st.floats(np.log(0.01), np.log(10.0)).map(np.exp).map(float),
    numbers(1e-3, 300.0),
    numbers(1e-2, 1e5),
    st.sampled_from([128, 1000, 1024, 8192]),
)
@example(0.1, 0.0, 0.0, 1024)  # nothing holds it, nothing brakes it
@example(0.01, 0.0, 1e5, 128)  # four swings a tick
@example(0.01, 300.0, 1e5, 128)
@example(0.1, 20.0, 1000.0, 1024)  # just not a swing any more
def test_it_is_the_exponential(mass: float, damping: float, stiffness: float, rate_hz: int) -> None:
    wanted = exponential(mass, damping, stiffness, rate_hz)
    scale = np.array(
        [[1.0, 1 / rate_hz, 0.5 / rate_hz**2 / mass], [stiffness / mass / rate_hz, 1.0, 1 / rate_hz / mass]]
    )
    off = np.abs(as_matrix(discretise(mass, damping, stiffness, rate_hz)) - wanted)[:2]
    assert (off <= 1e-11 * np.maximum(scale, np.abs(wanted[:2]))).all(), off


@given(st.floats(0.02, 2.0), st.floats(0.0, 20.0), st.floats(0.0, 3000.0), st.sampled_from([64, 512, 4096]))
def test_two_halves_are_a_whole(mass: float, damping: float, stiffness: float, rate_hz: int) -> None:
    half = as_matrix(discretise(mass, damping, stiffness, 2 * rate_hz))
    np.testing.assert_allclose(
        as_matrix(discretise(mass, damping, stiffness, rate_hz)), half @ half, rtol=1e-12, atol=1e-14
    )


@pytest.mark.parametrize(("mass", "rate_hz"), [(0.1, 1024), (2.0, 128)])
def test_what_nothing_holds_flies_free(mass: float, rate_hz: int) -> None:
    tick_s = 1.0 / rate_hz
    step = discretise(mass, 0.0, 0.0, rate_hz)
    assert (step.p, step.q, step.h) == (tick_s, 1.0, tick_s / mass)
    assert step.g == pytest.approx(0.5 * tick_s**2 / mass, rel=1e-15)
