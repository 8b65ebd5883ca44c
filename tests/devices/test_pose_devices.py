"""`sim:freeflyer` and `sim:phantom6`: bodies that turn, and the hands that turn them."""

from math import pi

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.devices.held_device import RATE_HZ, hold, opened


def turn(before, after) -> np.ndarray:
    """Rotation vector from the orientation of one pose to that of another."""
    return (Rotation.from_rotvec(after[3:]) * Rotation.from_rotvec(before[3:]).inv()).as_rotvec()


def test_a_free_body_turns_by_the_torque_alone() -> None:
    """I omega' = -tau, no hand: theta = tau t^2 / 2I, and the torque's work is the energy of the motion."""
    device = opened("sim:freeflyer?wrist_stiffness_nmprad=0&wrist_damping_nms=0&inertia_kgm2=0.001", axes=6)
    work, before = 0.0, device.read(0)
    for tick in range(1, RATE_HZ + 1):
        device.write((0.0, 0.0, 0.0, 0.0, -0.002, 0.0))
        sample = device.read(tick)
        work += 0.002 * turn(before.position_m, sample.position_m)[1]
        before = sample
    assert sample.velocity_mps[4] == pytest.approx(2.0, rel=1e-9)
    assert sample.position_m[4] == pytest.approx(1.0, rel=2e-3)
    assert work == pytest.approx(0.5 * 0.001 * 2.0**2, rel=2e-3)


def test_a_wrist_holds_against_a_torque_as_a_spring() -> None:
    device = opened("sim:freeflyer?wrist_stiffness_nmprad=0.5", axes=6)
    sample = hold(device, 2 * RATE_HZ, (0.0, 0.0, 0.0, 0.1, 0.0, 0.0))[-1]
    assert sample.position_m[3] == pytest.approx(-0.2, rel=1e-6)


def test_motors_saturate_and_encoders_count() -> None:
    device = opened("sim:phantom6?wrist_stiffness_nmprad=1&rotational_friction_nm=0", axes=6)
    sample = hold(device, 2 * RATE_HZ, (0.0, 0.0, 0.0, 5.0, 0.0, 0.0))[-1]
    counts = np.array(sample.position_m[3:]) / 1.4e-4
    assert counts == pytest.approx(np.round(counts), abs=1e-9)
    assert sample.position_m[3] == pytest.approx(-0.19, abs=2e-4)
    assert sample.velocity_mps is None


def test_friction_holds_a_body_that_is_hardly_pushed() -> None:
    keys = "wrist_stiffness_nmprad=0&wrist_damping_nms=0&rotational_friction_nm=0.01"
    device = opened(f"sim:phantom6?{keys}", axes=6)
    for torque, ticks, moves in ((0.009, range(200), False), (0.011, range(200, 400), True)):
        sample = hold(device, ticks, (0.0, 0.0, 0.0, torque, 0.0, 0.0))[-1]
        assert (sample.position_m[3] != 0.0) == moves


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_crank_goes_round_and_turns_as_it_goes(axis: str) -> None:
    keys = f"radius_m=0.05&speed_radps=3&start_s=0.5&ramp_s=1&axis={axis}&hand_stiffness_npm=2000"
    device = opened(f"sim:freeflyer?hand=crank&{keys}", axes=6)
    hand, number = device.hand, 3 + "xyz".index(axis)
    for tick in (0, 700, 1500, 4000):
        (pose, rates), (after, _) = hand.intended(tick), hand.intended(tick + 1)
        moved = np.subtract(after[:3], pose[:3]) * RATE_HZ
        assert moved == pytest.approx(rates[:3], abs=3e-3), "rates are those of the pose"
        assert turn(pose, after) * RATE_HZ == pytest.approx(rates[3:], abs=6e-3)
    pose, rates = hand.intended(5 * RATE_HZ)
    assert (pose[number], rates[number]) == pytest.approx((3.0 * (5.0 - 0.5 - 0.5), 3.0))
    last = hold(device, 5 * RATE_HZ + 1)[-1]
    assert np.linalg.norm(turn(pose, last.position_m)) < 0.02


def test_waypoints_turn_with_the_angular_velocity_of_their_course() -> None:
    hand = opened("sim:freeflyer?hand=waypoints&times_s=0.1,1&rx_rad=0,1.2&ry_rad=0.3,-0.8&rz_rad=0,2", axes=6).hand
    for tick in (200, 500, 900):
        (pose, rates), (after, _) = hand.intended(tick), hand.intended(tick + 1)
        assert rates[3:] == pytest.approx((turn(pose, after) * RATE_HZ).tolist(), rel=1e-6)
    assert hand.intended(2000)[0][3:] == pytest.approx((1.2, -0.8, 2.0))
    assert hand.intended(2000)[1] == (0.0,) * 6


def test_any_hand_of_places_keeps_its_orientation() -> None:
    place, rates = opened("sim:phantom6?hand=reach", axes=6).hand.intended(400)
    assert place[0] > 0.001
    assert place[3:] == rates[3:] == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_with_fewer_axes_it_is_a_device_of_places(axes: int) -> None:
    device = opened("sim:phantom6?hand=reach", axes=axes)
    assert (device.capability.rotation, device.capability.axes) == (None, axes)
    assert len(device.read(0).position_m) == axes


@pytest.mark.long
def test_many_turns_stay_unit() -> None:
    last = opened("sim:freeflyer?hand=crank&speed_radps=15&ramp_s=0.5", axes=6).read(20 * RATE_HZ)
    assert np.linalg.norm(last.position_m[3:]) <= pi * (1.0 + 1e-9)
    assert last.velocity_mps[5] == pytest.approx(15.0, rel=1e-3)
