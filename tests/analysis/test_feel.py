"""Tests of the felt impedance and the delay budget against closed forms."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.analysis.advice.delay_budget import budget, total_s
from cogrip.analysis.feel.feel import (
    alone,
    conditions,
    decimated,
    encoded,
    frequencies_hz,
    held,
    ideal_impedance,
    impedance,
    no_contact,
    on_wall,
    slow_feel,
)
from cogrip.analysis.linear.linear_session import LinearSession, form_overrides, linear_session
from cogrip.protocol.laws.decimation import lag_s
from cogrip.protocol.laws.felt_stiffness import felt_stiffness, line_compliance
from cogrip.protocol.settings.delays import OneWayDelay
from cogrip.protocol.settings.room import resolve


def session(scheme: Any = "passive", frames: float = 1, estimated: bool = False, **keys: Any) -> LinearSession:
    table = {"coupling": keys, "users": [{"name": "a"}, {"name": "b"}]}
    return linear_session(resolve(table, form_overrides(scheme)), delay_frames=frames, estimated=estimated)


def delayed(which: LinearSession, up: int, down: int) -> LinearSession:
    """Return the session with these delays of everybody's line [ticks]."""
    M = which.people[0].rates.ticks_per_frame
    ways = {name: OneWayDelay(float(ticks), 0.0, 0.0, 0.0, M) for name, ticks in (("up", up), ("down", down))}
    return replace(which, people=tuple(replace(person, **ways) for person in which.people))


@given(
    scheme=st.sampled_from(("passive", "paper")),
    decimator=st.sampled_from(("boxcar", "lowpass", "none")),
    encoder=st.sampled_from(("displacement", "velocity")),
    ticks=st.tuples(st.integers(0, 40), st.integers(0, 40)),
    K=st.floats(50.0, 1e5),
    b=st.floats(5.0, 80.0),
    cutoff=st.floats(5.0, 300.0),
    estimated=st.booleans(),
)
@settings(deadline=None)
def test_felt_stiffness_is_theory_4(
    scheme: str,
    decimator: str,
    encoder: str,
    ticks: tuple[int, int],
    K: float,
    b: float,
    cutoff: float,
    estimated: bool,
) -> None:
    """For any delays with the boxcar; the terms of the others are those of whole frames."""
    if decimator != "boxcar":
        ticks = 8 * (ticks[0] // 8), 8 * (ticks[1] // 8)
    which = session(scheme, 0, estimated, stiffness_npm=K, impedance_nspm=b, lowpass_rad_s=cutoff)
    which = delayed(which, *ticks)
    which = replace(which, people=tuple(replace(one, decimator=decimator, encoder=encoder) for one in which.people))
    frame_s = which.people[0].rates.frame_s
    lag = lag_s(decimator, frame_s, cutoff) - (2.0 * frame_s if scheme == "paper" else 0.0)
    theory = felt_stiffness(K, line_compliance(b, sum(ticks) * which.people[0].rates.tick_s, lag))
    assert slow_feel(on_wall(which, 0), 0).stiffness_npm == pytest.approx(theory, rel=1e-6)


def test_virtual_coupling_renders_its_spring_at_rest_and_holds_its_answers_for_half_a_frame() -> None:
    assert total_s(budget(session("coupling", 2), 0)) == pytest.approx(4.5 / 128.0, abs=1e-12)
    slow = slow_feel(on_wall(session("coupling", 3), 0), 0)
    assert slow.stiffness_npm == pytest.approx(1000.0, rel=1e-9)
    assert slow.damping_nspm == pytest.approx(10.0, rel=1e-6)
    assert slow.inertia_kg == pytest.approx(0.0, abs=1e-6)


@given(st.integers(0, 5), st.floats(50.0, 5000.0))
@settings(deadline=None)
def test_virtual_coupling_brakes_a_steady_motion_by_its_delay_less_the_frame_that_a_step_is_ahead(
    frames: int, K: float
) -> None:
    """Theory section 5: at velocity V the object after a step is V T ahead of the place that it was sent, as no force is left.

    The client holds that over M ticks, (M - 1)/2 ticks on average.
    """
    which = alone(session("coupling", frames, stiffness_npm=K), 0)
    rates = which.people[0].rates
    late_s = (2.0 * frames - 1.0) * rates.frame_s + 0.5 * (rates.ticks_per_frame - 1) * rates.tick_s
    slow = slow_feel(which, 0)
    assert slow.damping_nspm == pytest.approx(K * late_s, rel=1e-4)
    assert slow.stiffness_npm == pytest.approx(0.0, abs=1e-6 * K)


@given(st.integers(0, 5), st.floats(5.0, 80.0), st.sampled_from(("displacement", "velocity")))
@settings(deadline=None)
def test_in_free_motion_the_line_is_a_mass(frames: int, b: float, encoder: str) -> None:
    """The mass is the delay of 2 d + 1 frames times b / 2, a tick's worth apart; there is no drag at constant speed."""
    which = no_contact(session("passive", frames, impedance_nspm=b, encoder=encoder), 0)
    slow = slow_feel(which, 0)
    loop_s = (2 * frames + 1) * which.people[0].rates.frame_s
    assert slow.stiffness_npm == pytest.approx(0.0, abs=2e-6)
    assert slow.damping_nspm == pytest.approx(0.0, abs=1e-6 * b)
    assert slow.inertia_kg == pytest.approx(0.5 * b * loop_s, rel=0.15)


def test_alone_with_the_object_its_mass_is_felt_beside_the_lines() -> None:
    which = session("passive", 1)
    line = slow_feel(no_contact(which, 0), 0).inertia_kg
    slow = slow_feel(alone(which, 0), 0)
    assert slow.inertia_kg == pytest.approx(which.object_mass_kg + line, rel=0.02)
    assert slow.stiffness_npm == pytest.approx(0.0, abs=2e-6)


def test_a_second_persons_hand_is_felt_as_springs_in_a_row() -> None:
    """Hand, their line and spring, my spring and line are in series; the object and the devices only weigh."""
    which = held(session("passive", 1), 0, 300.0, 5.0)
    one = slow_feel(on_wall(which, 0), 0).stiffness_npm
    assert slow_feel(which, 0).stiffness_npm == pytest.approx(1.0 / (2.0 / one + 1.0 / 300.0), rel=1e-6)


@given(st.integers(0, 50), st.floats(10.0, 1e6), st.floats(0.0, 50.0), st.floats(1.0, 40.0))
@settings(deadline=None)
def test_the_passive_scheme_gives_no_energy_at_any_frequency(ticks: int, K: float, B: float, b: float) -> None:
    """The work F w of a tick, w = s y its mean velocity, is at least the sampled damper's own b (y - w) w (theory 3.6)."""
    which = delayed(session("passive", 0, stiffness_npm=K, damping_nspm=B, impedance_nspm=b), ticks, ticks // 2)
    w = 2.0 * np.pi * frequencies_hz(which.people[0].rates)
    mean = encoded(which.people[0], which.people[0].rates, w)
    leak = (b * (1.0 - mean) * mean.conj()).real
    for case in (no_contact(which, 0), alone(which, 0), on_wall(which, 0)):  # a second device has a leak of its own
        Z = impedance(case, 0, w)
        assert ((Z * mean.conj()).real >= leak - 1e-9 * np.abs(Z) - 1e-9).all()


@pytest.mark.parametrize("condition", range(4))
def test_without_a_line_to_speak_of_it_is_direct_contact(condition: int) -> None:
    """As rates grow, delays shrink to a tick, the port gets stiff, and the ideal is reached."""
    rates = {"rates": {"device_hz": 20000, "network_hz": 20000}}
    keys = {"impedance_nspm": 400.0, "stiffness_npm": 800.0, "damping_nspm": 3.0}
    table = {**rates, "coupling": keys, "users": [{"name": "a"}, {"name": "b"}]}
    which = linear_session(resolve(table), estimated=False)
    found = conditions(which, 0, np.array([0.5, 2.0, 8.0]))[condition]
    line = 0.5 * 400.0 / 20000  # the line's own mass, small
    w = 2.0 * np.pi * np.array([0.5, 2.0, 8.0])
    allowed = 2.5 * (w * line + 0.03 * np.abs(found.ideal))
    assert (np.abs(found.rendered - found.ideal) < allowed).all()


def test_the_ideal_of_each_condition() -> None:
    which = session("passive", 0)
    w = np.array([3.0])
    s = 3.0j
    spring = 1000.0 / s + 10.0
    np.testing.assert_allclose(ideal_impedance(on_wall(which, 0), 0, w), [spring])
    np.testing.assert_allclose(ideal_impedance(alone(which, 0), 0, w), [1 / (1 / spring + 1 / (0.2 * s))])
    np.testing.assert_allclose(ideal_impedance(no_contact(which, 0), 0, w), [0.0])
    other = 1 / (1 / spring + 1 / (0.1 * s + 5.0 + 300.0 / s))
    expected = 1 / (1 / spring + 1 / (0.2 * s + other))
    np.testing.assert_allclose(ideal_impedance(held(which, 0, 300.0, 5.0), 0, w), [expected])


def test_a_wall_has_no_conditions_with_a_free_object() -> None:
    wall = linear_session(resolve({"object": {"kind": "wall"}}), estimated=False)
    assert [found.name for found in conditions(wall, 0, np.array([1.0]))] == ["no contact", "on a wall"]


@given(
    st.sampled_from(("boxcar", "lowpass", "none")),
    st.sampled_from(("displacement", "velocity")),
    st.booleans(),
    st.floats(0.0, 90.0),
    st.floats(0.0, 90.0),
    st.integers(0, 3),
    st.floats(5.0, 500.0),
)
@settings(deadline=None)
def test_the_budget_adds_up_to_the_delay_of_slow_motion(
    decimator: str, encoder: str, estimated: bool, up_ms: float, down_ms: float, playout: int, cutoff: float
) -> None:
    table = {
        "coupling": {"decimator": decimator, "encoder": encoder, "lowpass_rad_s": cutoff},
        "link": {"up": {"delay_ms": up_ms}, "down": {"delay_ms": down_ms}},
        "playout": {"frames": playout},
    }
    which = linear_session(resolve(table), estimated=estimated)
    person, rates = which.people[0], which.people[0].rates
    w = np.array([1e-3])
    frames = person.up.frames + person.down.frames + 1
    ticks = np.arange(rates.ticks_per_frame)
    kept = np.exp(-1j * w * ticks * rates.tick_s).mean() * -np.expm1(-1j * w * rates.tick_s) / (1j * w * rates.tick_s)
    path = encoded(person, rates, w) * decimated(person, rates, w) * np.exp(-1j * w * frames * rates.frame_s) * kept
    assert total_s(budget(which, 0)) == pytest.approx(float(-np.angle(path)[0] / w[0]), abs=1e-7)
