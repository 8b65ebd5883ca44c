"""Limits and freedoms of the lifted model: both sides of each boundary, nothing hidden by what is taken out."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.protocol.settings import resolve
from cogrip.sim.analysis.lifted_model import LiftedModel
from cogrip.sim.analysis.linear_session import LinearSession, linear_session, scheme_overrides
from cogrip.sim.analysis.rigid_motion import Rigid
from cogrip.sim.analysis.stability import SEARCHED_TO_NPM, largest_stable, radius, verdict


def session(
    scheme: Any = "paper", delay: float = 1, overrides: dict[str, Any] | None = None, users: int = 2
) -> LinearSession:
    table = {"users": [{"name": f"u{number}"} for number in range(users)]}
    resolved = resolve(table, {**scheme_overrides(scheme), **(overrides or {})})
    return linear_session(resolved, delay_frames=delay)


def with_person(which: LinearSession, number: int, **changes: Any) -> LinearSession:
    people = list(which.people)
    people[number] = replace(people[number], **changes)
    return replace(which, people=tuple(people))


@pytest.mark.parametrize("scheme", ["paper", "coupling"])
@pytest.mark.parametrize("delay", [0, 1, 2, 4])
def test_just_below_the_limit_is_stable_and_just_above_is_not(scheme: str, delay: int) -> None:
    model = LiftedModel(session(scheme, delay))
    limit = largest_stable(model)
    assert limit.stiffness_npm is not None
    sides = limit.stiffness_npm * np.array([[1.0 - 1e-4] * 2, [1.0 + 1e-4] * 2])
    below, above = radius(model, sides)
    assert below < 1.0 < above


@pytest.mark.parametrize("delay", [0, 1, 4, 9])
@pytest.mark.parametrize("decimator", ["boxcar", "lowpass", "none"])
def test_the_passive_scheme_has_no_limit(delay: int, decimator: str) -> None:
    limit = largest_stable(LiftedModel(session("passive", delay, {"coupling.decimator": decimator})))
    assert limit.stiffness_npm is None
    assert limit.searched_to_npm == SEARCHED_TO_NPM == 1e7


def test_the_limit_goes_along_the_ray_of_the_settings() -> None:
    uneven = session(overrides={"users.0.stiffness_npm": 50.0, "users.1.stiffness_npm": 200.0})
    model = LiftedModel(uneven)
    limit = largest_stable(model)
    assert limit == largest_stable(model, (1.0, 4.0))
    assert limit.stiffness_npm is not None
    K = limit.stiffness_npm * np.array([[0.25, 1.0]])
    assert radius(model, K * 0.9999)[0] < 1.0 < radius(model, K * 1.0001)[0]


@pytest.mark.parametrize("direction", [(0.0, 0.0), (1.0, -1.0), (float("nan"), 1.0)])
def test_a_direction_without_length_is_refused(direction: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="above 0"):
        largest_stable(LiftedModel(session()), direction)


@pytest.mark.parametrize(("impedance", "stable"), [(90.0, True), (95.0, False)])
def test_the_bare_device_holds_below_b_tc_over_m_of_2(impedance: float, stable: bool) -> None:
    """Theory 3.6: 0.045 kg holds at 90 Ns/m, diverges at 95."""
    light = session("passive", 0, {"coupling.impedance_nspm": impedance, "users.0.device_mass_kg": 0.045})
    model = LiftedModel(light)
    assert verdict(model).stable == stable
    assert (largest_stable(model).stiffness_npm == 0.0) != stable


def names(which: LinearSession) -> list[str]:
    return list(Rigid(LiftedModel(which)).names)


def test_the_freedoms_of_two_people_on_a_cube() -> None:
    free = session("passive")
    assert names(free) == [
        "device position of u0",
        "device position of u1",
        "object position",
        "uniform motion of object and devices",
    ]
    assert len(names(session("passive", overrides={"object.damping_nspm": 0.1}))) == 3
    assert len(names(with_person(free, 0, device_damping_nspm=0.1))) == 3
    assert names(with_person(free, 1, hand_stiffness_npm=300.0)) == ["device position of u0", "object position"]
    assert "stretch of u1" in names(with_person(free, 1, stiffness_npm=0.0))
    alone = with_person(free, 1, stiffness_npm=0.0, damping_nspm=0.0)
    assert names(alone)[-2:] == ["uniform motion of object and devices", "uniform motion of u1"]
    assert names(session("passive", overrides={"object.kind": "wall"})) == [
        "device position of u0",
        "device position of u1",
    ]


def test_virtual_coupling_has_one_freedom() -> None:
    """Theory 6 names four for every scheme; old positions brake uniform motion, and K ties the devices to the object."""
    assert names(session("coupling")) == ["joint position"]
    assert names(with_person(session("coupling"), 0, hand_stiffness_npm=10.0)) == []
    loose = with_person(with_person(session("coupling"), 0, stiffness_npm=0.0), 1, stiffness_npm=0.0)
    assert names(loose)[-1] == "uniform motion of object and devices"
    assert len(names(loose)) == 4


@given(
    st.sampled_from(("passive", "paper", "coupling")),
    st.sampled_from(("cube", "wall")),
    st.integers(0, 3),
    st.lists(
        st.tuples(
            st.sampled_from((0.0, 40.0, 900.0, 6000.0)),  # K
            st.sampled_from((0.0, 7.0)),  # B
            st.sampled_from((0.0, 0.4)),  # device damping
            st.sampled_from((0.0, 250.0)),  # hand stiffness
            st.booleans(),  # estimated
            st.sampled_from(("boxcar", "lowpass")),
        ),
        min_size=1,
        max_size=3,
    ),
)
@settings(max_examples=200, deadline=None)
def test_what_is_taken_out_lies_at_one_and_the_rest_stays(
    scheme: str, kind: str, delay: int, people: list[tuple[float, float, float, float, bool, str]]
) -> None:
    which = session(scheme, delay, {"object.kind": kind}, users=len(people))
    for number, (K, B, damping, hand, estimated, decimator) in enumerate(people):
        which = with_person(
            which, number, stiffness_npm=K, damping_nspm=B, device_damping_nspm=damping, hand_stiffness_npm=hand,
            estimated=estimated, decimator=decimator, device_mass_kg=0.1 + 0.05 * number,
        )  # fmt: skip
    model = LiftedModel(which)
    A, rigid = model.matrix(), Rigid(model)
    assert rigid.residual(A) < 1e-8
    rest = rigid.removed(A)
    assert len(rest) == model.states - len(rigid.names)
    # the characteristic polynomials, away from the spectrum: det(z - A) = det(z - A') (z - 1)^f
    for z in (1.7 * np.exp(0.8j), 30.0 * np.exp(2.0j)):
        whole = np.linalg.slogdet(z * np.eye(len(A)) - A)
        left = np.linalg.slogdet(z * np.eye(len(rest)) - rest)
        ones = (z - 1.0) ** len(rigid.names)
        assert left.logabsdet + np.log(abs(ones)) == pytest.approx(whole.logabsdet, abs=1e-6)
        assert abs(left.sign * ones / abs(ones) - whole.sign) < 1e-6


def test_an_unstable_session_stays_unstable() -> None:
    for scheme in ("paper", "coupling"):
        which = session(scheme, 2, {"coupling.stiffness_npm": 2000.0})
        found = verdict(LiftedModel(which))
        assert found.decaying == pytest.approx(found.spectral_radius, rel=1e-12)
        assert found.spectral_radius > 1.2
        assert not found.stable


def test_free_motion_that_is_slow_to_end_is_not_taken_for_a_freedom() -> None:
    """A damper of 1e-6 Ns/m moves an eigenvalue from 1 by 1e-8: it is no freedom then, and still counted as stable."""
    found = verdict(LiftedModel(session("passive", 1, {"object.damping_nspm": 1e-6})))
    assert len(found.structural) == 3
    assert 0.9999999 < found.decaying < 1.0
    assert found.stable
