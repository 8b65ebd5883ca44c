"""Axes of a hand with a gripper as lengths of one impedance, and the limits of its force."""

from dataclasses import replace
from itertools import pairwise
from math import hypot, nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.hand.further_axes import in_lengths
from cogrip.client.hand.grip_axes import GripAxes
from cogrip.client.hand.hand_map import HandMap
from cogrip.client.safety.device_port import cure
from cogrip.devices.device import Gripper, Sample
from cogrip.devices.registry import make
from cogrip.protocol.laws.waves import device_force, device_gain, device_wave
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.tool_frame import ToolFrame, rotation_of

from tests.client.live_safety import give, live

UNIT, TICK_S = 0.7, 1.0 / 1024.0
RECORD = make("sim:gripper", axes=4).capability
GRIPPER = RECORD.gripper or Gripper(*[1.0] * 7)
number = st.floats(-1e3, 1e3)
four = st.tuples(*[number] * 4)


@given(st.floats(0.05, 20.0), four, four)
def test_the_power_is_that_of_hand_and_fingers(
    length_scale: float, wrench: tuple[float, ...], twist: tuple[float, ...]
) -> None:
    axes = GripAxes(length_scale)
    moved = axes.lengths(Sample(twist, twist, 3, 5, None, twist[3]))
    assert moved.velocity_mps is not None
    force = axes.force(wrench)
    assert np.dot(force, moved.velocity_mps) == pytest.approx(np.dot(wrench, twist), rel=1e-12, abs=1e-6)
    assert axes.wrench(force) == pytest.approx(wrench, rel=1e-12)
    assert axes.pose(moved.position_m) == axes.rates(moved.velocity_mps) == pytest.approx(twist, rel=1e-12)
    assert (moved.age_ticks, moved.buttons, moved.grip_m) == (3, 5, twist[3])


@given(st.floats(1.0, 50.0), st.floats(1.0, 50.0), number, number)
def test_a_port_of_lengths_is_one_of_its_own_impedance(
    b: float, grip_nspm: float, rate_mps: float, wave: float
) -> None:
    """Theory 8.8: force and wave at the fingers are those of b_g, though the port is one of b."""
    axes = GripAxes((grip_nspm / b) ** 0.5)
    velocity, whole, own = axes.length_scale * rate_mps, device_gain(b), device_gain(grip_nspm)
    force_n = axes.wrench((0.0, 0.0, 0.0, device_force(b, whole, velocity, wave)))[3]
    expected = device_force(grip_nspm, own, rate_mps, wave), device_wave(own, rate_mps, wave)
    assert (force_n, device_wave(whole, velocity, wave)) == pytest.approx(expected, rel=1e-9, abs=1e-6)


@given(st.floats(0.05, 20.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_a_record_in_lengths_bounds_every_axis(length_scale: float, along: float, fingers: float) -> None:
    record = in_lengths(RECORD, length_scale)
    force = along * RECORD.peak_force_n, fingers * GRIPPER.peak_force_n / length_scale
    assert hypot(*force) <= record.peak_force_n * (1.0 + 1e-12)
    assert record.damping_nspm <= min(RECORD.damping_nspm, GRIPPER.damping_nspm / length_scale**2)
    assert record.apparent_mass_kg <= min(RECORD.apparent_mass_kg, GRIPPER.apparent_mass_kg / length_scale**2)
    assert record.speed_mps >= max(RECORD.speed_mps, length_scale * GRIPPER.speed_mps)
    assert record.resolution_m >= max(RECORD.resolution_m, length_scale * GRIPPER.resolution_m)


@given(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0))
def test_the_gripper_has_limits_of_its_own(arm_n: float, grip_n: float) -> None:
    safety, axes = live(RECORD, TICK_S, UNIT), GripAxes(UNIT)
    wrenches = np.array([axes.wrench(force) for force in give(safety, axes.force((0.0, arm_n, 0.0, grip_n)), 401)])
    assert np.abs(np.diff(wrenches[:, 3])).max() <= GRIPPER.slew_nps * TICK_S * (1.0 + 1e-9)
    last = wrenches[-1]
    assert last[1] == pytest.approx(max(-RECORD.peak_force_n, min(RECORD.peak_force_n, arm_n)), abs=1e-9)
    assert last[3] == pytest.approx(max(-GRIPPER.peak_force_n, min(GRIPPER.peak_force_n, grip_n)), abs=1e-9)
    assert safety.limited == (abs(arm_n) > RECORD.peak_force_n or abs(grip_n) > GRIPPER.peak_force_n)


@pytest.mark.parametrize(
    ("opening_m", "rate_mps", "words"),
    [
        (0.034, 0.0, "opening of 34 mm is out of -3 to 33 mm"),
        (-0.0031, 0.0, "check its sensor"),
        (0.01, 2.1, "2.10 m/s at the gripper is above 2 m/s"),
        (nan, 0.0, "not finite"),
    ],
)
def test_what_no_gripper_does_takes_the_force_away(opening_m: float, rate_mps: float, words: str) -> None:
    safety, axes = live(RECORD, TICK_S, UNIT), GripAxes(UNIT)
    wish = axes.force((0.0, 1.0, 0.0, 1.0))
    give(safety, wish, 400)
    sample = axes.lengths(Sample((0.0, 0.0, 0.0, opening_m), (0.0, 0.0, 0.0, rate_mps)))
    safety.check(1, sample.position_m, sample.velocity_mps or ())
    assert safety.state == "fault"
    assert words in safety.reason
    forces = give(safety, wish, 40)
    assert all(hypot(*after) <= hypot(*before) for before, after in pairwise(forces))
    assert not any(forces[-1])


@pytest.mark.parametrize("opening_m", [-0.0029, 0.0, 0.03, 0.0329])
def test_an_opening_a_little_beyond_its_stops_is_one(opening_m: float) -> None:
    safety = live(RECORD, TICK_S, UNIT)
    assert safety.check(1, (0.0, 0.0, 0.0, UNIT * opening_m), (0.0,) * 4)
    assert safety.state == "live"


@given(st.floats(0.2, 5.0), st.floats(0.2, 5.0), four, four)
def test_scales_leave_the_opening_and_weigh_its_force(
    g: float, s: float, force_n: tuple[float, ...], rates: tuple[float, ...]
) -> None:
    frame = HandMap(ToolFrame(g, s, rotation_of("y -x z")), 4)
    tool = frame.rates(rates)
    assert tool[3] == rates[3]
    hand_w, tool_w = np.dot(frame.hand_force(force_n), rates), np.dot(force_n, tool)
    assert hand_w == pytest.approx(frame.power_ratio * tool_w, rel=1e-9, abs=1e-3)
    assert frame.tool_force(frame.hand_force(force_n)) == pytest.approx(force_n, rel=1e-9, abs=1e-6)


def test_a_gripper_that_yields_a_little_carries_little() -> None:
    heavy, light = (
        in_lengths(replace(RECORD, gripper=replace(GRIPPER, apparent_mass_kg=m)), UNIT) for m in (1.0, 0.01)
    )
    assert heavy.apparent_mass_kg == RECORD.apparent_mass_kg
    assert light.apparent_mass_kg == pytest.approx(0.01 / UNIT**2)


def test_the_limits_of_all_parts_of_a_hand_are_named() -> None:
    seat = seat_settings(resolve({"users": [{"name": "anna"}], "coupling": {"stiffness_npm": 700.0}}), 0)
    turning = make("sim:freeflyer", axes=6).capability
    assert turning.rotation is not None
    for record, further in (
        (make("sim:phantom", axes=3).capability, ""),
        (RECORD, f", or {GRIPPER.peak_force_n:g} N of the gripper"),
        (turning, f", or {turning.rotation.peak_torque_nm:g} N m of torque"),
    ):
        wanted = (
            f"its limit of {record.peak_force_n:g} N{further}; push less, or set coupling.stiffness_npm lower than 700"
        )
        assert cure("limit", seat, record) == f"the force sits at {wanted}"
