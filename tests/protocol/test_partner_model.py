"""One step of an object that several hold is the implicit Euler step of object and models together."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.laws.partner_model import (
    ADDED_NSPM,
    DAMPED_NPM,
    HAND_NSPM,
    HORIZON_S,
    LATE_S,
    MODEL_KG,
    Model,
    ahead,
    step_object,
)  # fmt: skip

STEP_S = 1.0 / 1024.0
places, speeds = st.floats(-0.1, 0.1), st.floats(-1.0, 1.0)


def model_at(x: float, v: float, e: float, k: float) -> Model:
    model = Model([x])
    model.velocity_mps, model.intention_m, model.stiffness_npm = [v], [e], k
    return model


@given(
    st.tuples(places, speeds), st.lists(st.tuples(places, speeds, places, st.floats(0.0, 400.0)), max_size=4),
    st.none() | st.tuples(places, speeds), st.floats(0.0, 5000.0), st.floats(0.0, 20.0), st.floats(0.0, 2.0),
)  # fmt: skip
def test_it_solves_the_equations_of_object_and_models_at_once(
    motion: tuple[float, float], rows: list[tuple[float, float, float, float]], own: tuple[float, float] | None,
    K: float, B: float, d: float,
) -> None:  # fmt: skip
    """Unknowns are the velocities at the step's end: m v+ = m v + T f(x + T v+, v+). A measured hand stays where it is."""
    models, mass = [model_at(*row) for row in rows], 0.2
    (o, v), T, count = motion, STEP_S, len(rows) + 1
    A, right = np.zeros((count, count)), np.zeros(count)
    A[0, 0], right[0] = mass + T * d, mass * v
    for number, ((x, speed, e, k), model) in enumerate(zip(rows, models, strict=True), 1):
        G = T * (K * T + B)
        A[0, 0] += G
        A[0, number] = A[number, 0] = -G
        A[number, number] = MODEL_KG + T * (k * T + model.damping_nspm) + G
        right[0] += T * K * (x - o)
        right[number] = MODEL_KG * speed + T * (k * (e - x) - K * (x - o))
    if own is not None:
        A[0, 0] += T * (K * T + B)
        right[0] += T * (K * (own[0] - o) + B * own[1])
    wanted = np.linalg.solve(A, right)
    place, velocity = [o], [v]
    step_object(T, place, velocity, mass, d, (K, B), models, None if own is None else ([own[0]], [own[1]]))
    found = [velocity[0], *(model.velocity_mps[0] for model in models)]
    assert found == pytest.approx(list(wanted), rel=1e-9, abs=1e-12)
    assert place[0] == pytest.approx(o + T * wanted[0])
    assert [model.place_m[0] for model in models] == pytest.approx(
        [x + T * speed for (x, *_), speed in zip(rows, wanted[1:], strict=True)]
    )


def test_axes_do_not_see_each_other() -> None:
    flat, whole = model_at(0.01, 0.1, 0.03, 200.0), Model([0.01, -0.02])
    whole.velocity_mps, whole.intention_m, whole.stiffness_npm = [0.1, 0.0], [0.03, 0.05], 200.0
    one, both = ([0.0], [0.2]), ([0.0, 0.5], [0.2, -1.0])
    for (place, velocity), model in ((one, flat), (both, whole)):
        step_object(STEP_S, place, velocity, 0.2, 0.1, (1000.0, 10.0), [model])
    assert (one[0][0], one[1][0]) == (both[0][0], both[1][0])
    assert flat.place_m[0] == whole.place_m[0]


@pytest.mark.parametrize(("age_s", "stiffness", "damping"), [
    (0.0, DAMPED_NPM, HAND_NSPM), (0.5 * LATE_S, DAMPED_NPM, HAND_NSPM + 0.5 * ADDED_NSPM),
    (LATE_S, DAMPED_NPM, HAND_NSPM + ADDED_NSPM), (9.0, 400.0, HAND_NSPM + ADDED_NSPM),
    (9.0, 0.5 * DAMPED_NPM, 0.5 * (HAND_NSPM + ADDED_NSPM)), (9.0, 0.0, 0.0),
])  # fmt: skip
def test_a_late_hand_is_damped_more_and_one_that_let_go_not_at_all(
    age_s: float, stiffness: float, damping: float
) -> None:
    model = model_at(0.0, 0.0, 0.0, stiffness)
    model.age_s = age_s
    assert model.damping_nspm == pytest.approx(damping)


@pytest.mark.parametrize(
    ("age_s", "place"), [(-1.0, 0.0), (0.0, 0.0), (0.05, 0.05), (HORIZON_S, HORIZON_S), (9.0, HORIZON_S)]
)
def test_an_intention_goes_on_to_the_horizon(age_s: float, place: float) -> None:
    assert ahead([0.0], [1.0], age_s) == pytest.approx([place])
