"""Tests of limits and freedoms of the lifted model: both sides of each boundary, nothing hidden by what is removed."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import LinearSession, form_overrides, linear_session
from cogrip.analysis.linear.rigid_motion import Rigid
from cogrip.analysis.linear.stability import SEARCHED_TO_NPM, largest_stable, modes, optimistic_limit, radius, verdict
from cogrip.protocol.settings.delays import OneWayDelay
from cogrip.protocol.settings.room import resolve


def session(
    scheme: Any = "paper", delay: float = 1, overrides: dict[str, Any] | None = None, users: int = 2
) -> LinearSession:
    table = {"users": [{"name": f"u{number}"} for number in range(users)]}
    resolved = resolve(table, {**form_overrides(scheme), **(overrides or {})})
    return linear_session(resolved, delay_frames=delay, estimated=False)


def ticks_long(ticks: int) -> OneWayDelay:
    return OneWayDelay(float(ticks), 0.0, 0.0, 0.0, 8)


def with_person(which: LinearSession, number: int, **changes: Any) -> LinearSession:
    people = list(which.people)
    people[number] = replace(people[number], **changes)
    return replace(which, people=tuple(people))


@pytest.mark.parametrize(
    ("scheme", "delay"), [case for case in product(("paper", "coupling"), (0, 1, 2, 4)) if case != ("coupling", 0)]
)
def test_just_below_the_limit_is_stable_and_just_above_is_not(scheme: str, delay: int) -> None:
    model = LiftedModel(session(scheme, delay))
    limit = largest_stable(model)
    sides = limit.stiffness_npm * np.array([[1.0 - 1e-4] * 2, [1.0 + 1e-4] * 2])
    below, above = radius(model, sides)
    assert below < 1.0 < above


@pytest.mark.parametrize(
    ("delay", "after_npm", "before_npm"),
    [(0, 0.0, 3299.77), (1, 1260.45, 723.48), (2, 482.86, 349.36), (4, 169.93, 140.56)],
)
def test_an_answer_before_the_step_is_one_frame_older(delay: int, after_npm: float, before_npm: float) -> None:
    """The limits of docs/paper.md: an answer before the step has the object that the step before has left."""
    after = session("coupling", delay)
    before = after
    for number, person in enumerate(after.people):
        before = with_person(before, number, down=ticks_long(person.down.ticks + 8))
    for which, limit_npm in ((after, after_npm), (before, before_npm)):
        assert largest_stable(LiftedModel(which)).stiffness_npm == pytest.approx(limit_npm, abs=0.01)


@pytest.mark.parametrize(("damping", "stable"), [(1.9, False), (2.2, True)])
def test_without_delay_virtual_coupling_needs_dampers_of_the_devices(damping: float, stable: bool) -> None:
    """Theory section 5: the springs drive a steady motion by 9/16 K T a person, at 500 N/m 2.2 N s/m. A free device does not
    quite move steadily: its velocity ripples within a frame, and B takes a little of that."""
    keys = {"coupling.stiffness_npm": 500.0, **{f"users.{n}.device_damping_nspm": damping for n in range(2)}}
    assert verdict(LiftedModel(session("coupling", 0, keys))).stable == stable


@pytest.mark.parametrize(
    ("decimator", "ticks"),
    [*product(("boxcar", "lowpass"), (*range(0, 25, 3), 72)), *product(["none"], (0, 8, 32, 72))],
)
@pytest.mark.parametrize("users", [1, 2])
def test_the_passive_scheme_has_no_limit_wherever_frames_begin(decimator: str, ticks: int, users: int) -> None:
    """Samples that are not filtered have none where frames begin together: there nothing is aliased."""
    which = session("passive", 0, {"coupling.decimator": decimator}, users)
    for number in range(users):
        which = with_person(
            which, number, up=ticks_long(ticks), down=ticks_long(ticks if decimator == "none" else ticks // 2)
        )
    limit = largest_stable(LiftedModel(which))
    assert limit.stiffness_npm is None
    assert limit.searched_to_npm == SEARCHED_TO_NPM == 1e7


def test_the_limit_goes_along_the_ray_of_the_settings() -> None:
    uneven = session(overrides={"users.0.stiffness_npm": 50.0, "users.1.stiffness_npm": 200.0})
    model = LiftedModel(uneven)
    limit = largest_stable(model)
    assert limit == largest_stable(model, (1.0, 4.0))
    K = limit.stiffness_npm * np.array([[0.25, 1.0]])
    assert radius(model, K * 0.9999)[0] < 1.0 < radius(model, K * 1.0001)[0]


def test_a_session_that_is_stable_again_beyond_its_limit_says_so() -> None:
    """P's scheme, one person with little damping: unstable from 453 N/m on, but stable between 9.8 and 13.4 kN/m."""
    model = LiftedModel(session("paper", 1, {"coupling.damping_nspm": 1.0, "coupling.impedance_nspm": 60.0}, users=1))
    limit = largest_stable(model)
    assert limit.stiffness_npm == pytest.approx(453.11, rel=1e-4)
    assert limit.stable_again
    below, beyond, again, above = radius(model, np.array([[400.0], [5000.0], [12000.0], [14000.0]]))
    assert below < 1.0 < beyond
    assert again < 1.0 < above
    assert not largest_stable(LiftedModel(session("paper", 1))).stable_again


@pytest.mark.parametrize("scheme", ["passive", "paper", "coupling"])
@pytest.mark.parametrize("kind", ["cube", "wall"])
@pytest.mark.parametrize(("hand_npm", "users"), [(0.0, 2), (0.0, 5), (300.0, 3)])
def test_people_who_are_alike_move_together_or_against_each_other(
    scheme: str, kind: str, hand_npm: float, users: int
) -> None:
    """The whole session's eigenvalues, with their numbers, are those of one person at an N-th of the object, and N - 1 times
    those of one person at a wall."""
    overrides = {"object.kind": kind, "object.damping_nspm": 1.5}
    alike = session(scheme, 2, overrides, users)
    held = [replace(one, hand_stiffness_npm=hand_npm, hand_damping_nspm=0.01 * hand_npm) for one in alike.people]
    model = LiftedModel(replace(alike, people=tuple(held)))
    parts = modes(model)
    assert len(parts) == (2 if kind == "cube" else 1)
    for K in (0.0, 100.0, 3000.0, 1e6):
        stiffness = np.full(users, K)
        whole = np.linalg.eigvals(Rigid(model, stiffness).removed(model.matrix(stiffness)))
        counts = (users - 1, 1) if kind == "cube" else (users,)
        of_parts = np.concatenate([
            np.tile(np.linalg.eigvals(Rigid(part.model, stiffness[:1]).removed(part.model.matrix(stiffness[:1]))), count)
            for part, count in zip(parts, counts, strict=True)
        ])  # fmt: skip
        assert len(of_parts) == len(whole)
        for power in (1, 2, 3, 7):  # equal power sums: equal eigenvalues, however near 0 some are
            assert (of_parts**power).sum() == pytest.approx((whole**power).sum(), rel=1e-6, abs=1e-6)


def test_whoever_differs_makes_the_session_one_part() -> None:
    alike = session("passive", 1)
    assert len(modes(LiftedModel(alike))) == 2
    for changes in ({"device_mass_kg": 0.2}, {"impedance_nspm": 30.0}, {"latency_ticks": 1}):
        parts = modes(LiftedModel(with_person(alike, 1, **changes)))
        assert [len(part.ray) for part in parts] == [2]
    assert len(modes(LiftedModel(alike), (1.0, 2.0))) == 1
    assert len(modes(LiftedModel(session("passive", 1, users=1)))) == 1


@pytest.mark.parametrize("scheme", ["paper", "coupling"])
def test_a_search_that_ends_early_finds_the_same(scheme: str) -> None:
    model = LiftedModel(session(scheme, 2))
    whole = largest_stable(model, relative=1e-5)
    assert largest_stable(model, relative=1e-5, beyond=False).stiffness_npm == whole.stiffness_npm
    further = largest_stable(model, relative=1e-5, to_npm=1.01 * whole.stiffness_npm, beyond=False)
    assert further.stiffness_npm == pytest.approx(whole.stiffness_npm, rel=2e-5)
    short = largest_stable(model, to_npm=0.99 * whole.stiffness_npm)
    assert short.stiffness_npm is None
    assert short.searched_to_npm == 0.99 * whole.stiffness_npm


def test_a_few_looks_say_what_the_limit_is_at_most() -> None:
    model = LiftedModel(session("coupling", 2))
    limit = largest_stable(model).stiffness_npm
    assert optimistic_limit(model, [0.5 * limit, 1.1 * limit, 2.0 * limit]).stiffness_npm == 1.1 * limit
    assert optimistic_limit(model, [0.5 * limit, 0.99 * limit]).stiffness_npm is None


@pytest.mark.parametrize("direction", [(0.0, 0.0), (1.0, -1.0), (float("nan"), 1.0)])
def test_a_direction_without_length_is_refused(direction: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="above 0"):
        largest_stable(LiftedModel(session()), direction)


@pytest.mark.parametrize(("impedance", "stable"), [(90.0, True), (95.0, False)])
def test_the_bare_device_holds_below_b_tc_over_m_of_2(impedance: float, stable: bool) -> None:
    """By theory 3.6 0.045 kg holds at 90 N s/m, and diverges at 95."""
    light = session("passive", 0, {"coupling.impedance_nspm": impedance, "users.0.device_mass_kg": 0.045})
    model = LiftedModel(light)
    assert verdict(model).stable == stable
    assert (largest_stable(model).stiffness_npm == 0.0) != stable


def names(which: LinearSession) -> list[str]:
    return list(Rigid(LiftedModel(which)).names)


def test_the_freedoms_of_two_people_on_a_cube() -> None:
    free, devices = session("passive"), ["device position of u0", "device position of u1"]
    assert names(free) == [*devices, "object position", "uniform motion of object and devices"]
    assert len(names(session("passive", overrides={"object.damping_nspm": 0.1}))) == 3
    assert len(names(with_person(free, 0, device_damping_nspm=0.1))) == 3
    assert names(with_person(free, 1, hand_stiffness_npm=300.0)) == ["device position of u0", "object position"]
    assert "stretch of u1" in names(with_person(free, 1, stiffness_npm=0.0))
    alone = with_person(free, 1, stiffness_npm=0.0, damping_nspm=0.0)
    assert names(alone)[-2:] == ["uniform motion of object and devices", "uniform motion of u1"]
    assert names(session("passive", overrides={"object.kind": "wall"})) == devices


def test_virtual_coupling_has_one_freedom() -> None:
    """Theory 6 names four for waves; positions of other instants act on uniform motion, and K ties devices to the object."""
    assert names(session("coupling")) == ["joint position"]
    assert names(with_person(session("coupling"), 0, hand_stiffness_npm=10.0)) == []
    loose = with_person(with_person(session("coupling"), 0, stiffness_npm=0.0), 1, stiffness_npm=0.0)
    assert names(loose)[-1] == "uniform motion of object and devices"
    assert len(names(loose)) == 4


@st.composite
def any_session(draw: st.DrawFn) -> LinearSession:
    """One to three people, any of whose K, B, damping and hand may be missing."""
    scheme = draw(st.sampled_from(("passive", "paper", "coupling")))
    kind = draw(st.sampled_from(("cube", "wall", "faces") if scheme == "passive" else ("cube", "wall")))
    users = draw(st.integers(1, 3))
    which = session(scheme, draw(st.integers(0, 3)), {"object.kind": kind}, users)
    for number in range(users):
        which = with_person(
            which,
            number,
            stiffness_npm=draw(st.sampled_from((0.0, 40.0, 900.0, 6000.0))),
            damping_nspm=draw(st.sampled_from((0.0, 7.0))),
            device_damping_nspm=draw(st.sampled_from((0.0, 0.4))),
            hand_stiffness_npm=draw(st.sampled_from((0.0, 250.0))),
            estimated=draw(st.booleans()),
            decimator=draw(st.sampled_from(("boxcar", "lowpass"))),
            device_mass_kg=0.1 + 0.05 * number,
        )
        if scheme != "coupling":
            which = with_person(
                which, number, up=ticks_long(draw(st.integers(0, 30))), down=ticks_long(draw(st.integers(0, 30)))
            )
    return which


@given(any_session())
@settings(max_examples=200, deadline=None)
def test_removed_eigenvalues_lie_at_one_and_of_the_others_none_does(which: LinearSession) -> None:
    """An eigenvalue left there would make stability depend on rounding. Nothing here is slower than 1e-5 a frame."""
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
    assert np.abs(np.linalg.eigvals(rest) - 1.0).min(initial=1.0) > 1e-6


def test_hands_that_hold_springs_leave_a_tension() -> None:
    """No wave says where a held device started, so any force may stand between its hand and the spring."""
    wall, cube = (
        with_person(with_person(which, 0, hand_stiffness_npm=300.0), 1, hand_stiffness_npm=200.0)
        for which in (session("passive", overrides={"object.kind": "wall"}), session("passive"))
    )
    assert names(wall) == ["tension of u0", "tension of u1"]
    assert names(cube) == ["object position", "tension between u0 and u1"]
    assert names(with_person(cube, 1, stiffness_npm=0.0)) == ["object position", "stretch of u1"]
    for held in (wall, cube):
        model = LiftedModel(held)
        assert verdict(model).stable
        assert largest_stable(model).stiffness_npm is None
        K = np.array([[30.0, 2000.0], [700.0, 5.0]])
        for (first, second), found in zip(K.tolist(), radius(model, K), strict=True):
            alone = with_person(with_person(held, 0, stiffness_npm=first), 1, stiffness_npm=second)
            assert found == pytest.approx(verdict(LiftedModel(alone)).decaying, rel=1e-9)


def test_a_session_that_is_rigid_motion_alone_is_stable() -> None:
    loose = session("coupling", 0, {"coupling.stiffness_npm": 0.0, "coupling.damping_nspm": 0.0}, users=1)
    found = verdict(LiftedModel(loose))
    assert len(found.structural) == found.states == 4
    assert (found.spectral_radius, found.decaying, found.stable) == (1.0, 0.0, True)


def test_free_motion_that_is_slow_to_end_is_not_taken_for_a_freedom() -> None:
    """A damper of 1e-6 N s/m moves an eigenvalue from 1 by 1e-8: it is no freedom then, and still counted as stable."""
    found = verdict(LiftedModel(session("passive", 1, {"object.damping_nspm": 1e-6})))
    assert len(found.structural) == 3
    assert 0.9999999 < found.decaying < 1.0
    assert found.stable
