"""Tests of blocks against plain simulation: lifting, delays, interconnection, frequency response."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from cogrip.analysis.linear.state_space import StateSpace, close, delay, diagonal, gain, lift, series, through

Array = NDArray[np.float64]


def simulate(block: StateSpace, inputs: Array) -> Array:
    """Return the outputs for inputs (k, p), from rest."""
    x = np.zeros(block.states)
    outputs = []
    for u in inputs:
        outputs.append(block.C @ x + block.D @ u)
        x = block.A @ x + block.B @ u
    return np.array(outputs)


def block_of(seed: int, n: int, p: int, q: int, straight: bool = True) -> StateSpace:
    draw = np.random.default_rng(seed).uniform
    D = draw(-1.0, 1.0, (q, p)) if straight else np.zeros((q, p))
    A = draw(-1.0, 1.0, (n, n)) * 0.8 / max(1, n)
    return StateSpace(A, draw(-1.0, 1.0, (n, p)), draw(-1.0, 1.0, (q, n)), D)


def inputs_of(seed: int, ticks: int, p: int) -> Array:
    return np.random.default_rng(seed + 1).normal(size=(ticks, p))


seeds = st.integers(0, 2**32 - 2)
few = st.integers(1, 3)


@given(seeds, st.integers(0, 4), few, few, st.integers(1, 16))
@settings(deadline=None)
def test_a_lifted_block_is_the_block_run_tick_by_tick(seed: int, n: int, p: int, q: int, M: int) -> None:
    block, inputs = block_of(seed, n, p, q), inputs_of(seed, 3 * M, p)
    lifted = simulate(lift(block, M), inputs.reshape(3, M * p))
    np.testing.assert_allclose(lifted.reshape(3 * M, q), simulate(block, inputs), atol=1e-12)


def test_a_batch_is_lifted_case_by_case() -> None:
    one, two = block_of(1, 3, 2, 1), block_of(2, 3, 2, 1)
    batch = StateSpace(*(np.stack((getattr(one, name), getattr(two, name))) for name in "ABCD"))
    lifted = lift(batch, 4)
    for index, block in enumerate((one, two)):
        for name in "ABCD":
            np.testing.assert_allclose(getattr(lifted, name)[index], getattr(lift(block, 4), name), atol=1e-14)


@given(st.integers(0, 5), few)
def test_a_delay_is_what_came_so_many_steps_before(steps: int, width: int) -> None:
    inputs = np.arange(1.0, 1.0 + 9 * width).reshape(9, width)
    outputs = simulate(delay(width, steps), inputs)
    np.testing.assert_array_equal(outputs[steps:], inputs[: 9 - steps])
    assert not outputs[:steps].any()


@given(seeds, few, few, few)
@settings(deadline=None)
def test_series_is_one_after_the_other(seed: int, p: int, middle: int, q: int) -> None:
    first, second, inputs = block_of(seed, 2, p, middle), block_of(seed + 1, 3, middle, q), inputs_of(seed, 12, p)
    np.testing.assert_allclose(
        simulate(series(first, second), inputs), simulate(second, simulate(first, inputs)), atol=1e-12
    )


@given(seeds)
@settings(deadline=None)
def test_diagonal_is_side_by_side(seed: int) -> None:
    parts = [block_of(seed, 2, 1, 2), gain(np.array([[3.0]])), block_of(seed + 2, 1, 2, 1)]
    inputs = inputs_of(seed, 10, 4)
    expected = [simulate(block, cut) for block, cut in zip(parts, np.split(inputs, (1, 2), axis=1), strict=True)]
    np.testing.assert_allclose(simulate(diagonal(parts), inputs), np.concatenate(expected, axis=1), atol=1e-12)


@given(seeds, few, few, few)
@settings(deadline=None)
def test_a_closed_loop_solves_its_own_equations(seed: int, p: int, q: int, r: int) -> None:
    """Check u = F y + G w at every step, and P eq. 36 for the state."""
    block = block_of(seed, 3, p, q)
    draw = np.random.default_rng(seed + 5).uniform
    F, G = draw(-0.2, 0.2, (p, q)), draw(-1.0, 1.0, (p, r))
    loop = close(block, F, G)
    outside = inputs_of(seed, 12, r)
    outputs = simulate(loop, outside)
    np.testing.assert_allclose(simulate(block, outputs @ F.T + outside @ G.T), outputs, atol=1e-9)
    paper = block.A + block.B @ F @ np.linalg.inv(np.eye(q) - block.D @ F) @ block.C
    np.testing.assert_allclose(loop.A, paper, atol=1e-12)


def test_a_loop_without_delay_that_has_no_solution_is_an_error() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        close(gain(np.eye(1)), np.eye(1))


@given(seeds, few, few, st.floats(-3.0, 3.0))
@settings(deadline=None)
def test_the_response_is_what_a_growing_exponential_gets(seed: int, p: int, q: int, angle: float) -> None:
    """Input z^k u with |z| > 1 drowns the transient: the output is H(z) z^k u."""
    block = block_of(seed, 3, p, q)
    z = 1.6 * np.exp(1j * angle)
    steps = z ** np.arange(120)
    u = inputs_of(seed, 1, p)[0]
    x = np.zeros(3, dtype=complex)
    y = np.zeros(q, dtype=complex)
    for step in steps:
        y = block.C @ x + block.D @ (step * u)
        x = block.A @ x + block.B @ (step * u)
    np.testing.assert_allclose(y / steps[-1], block.response(np.array([z]))[0] @ u, atol=1e-8)


@given(seeds)
def test_static_maps_around_a_block(seed: int) -> None:
    block, before, after = block_of(seed, 2, 2, 3), inputs_of(seed, 2, 1), inputs_of(seed, 1, 3)
    inputs = inputs_of(seed + 3, 8, 1)
    expected = simulate(block, inputs @ before.T) @ after.T
    np.testing.assert_allclose(simulate(through(before, block, after), inputs), expected, atol=1e-12)
