"""Axes of a hand that turns, as lengths: power is kept, angles add up, bounds hold; limits of force and torque apart."""

from dataclasses import replace
from math import hypot, inf, nan, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cogrip.client.pose_axes import PoseAxes, in_lengths
from cogrip.client.safety import RAMP_IN_S, Safety
from cogrip.devices import make
from cogrip.devices.device import Sample

LENGTH_M, TICK_S = 0.03, 1.0 / 1024.0
RECORD = make("sim:phantom6", axes=6).capability
number = st.floats(-3.0, 3.0)
six = st.tuples(*[number] * 6)


@given(six, six)
def test_power_is_that_of_force_and_torque(wrench: tuple[float, ...], twist: tuple[float, ...]) -> None:
    axes = PoseAxes(LENGTH_M)
    sample = axes.lengths(Sample((0.0,) * 6, twist))
    assert sample.velocity_mps is not None
    assert np.dot(axes.force(wrench), sample.velocity_mps) == pytest.approx(np.dot(wrench, twist), rel=1e-12, abs=1e-12)
    assert axes.wrench(axes.force(wrench)) == pytest.approx(wrench, rel=1e-12)
    assert axes.rates(sample.velocity_mps) == pytest.approx(twist, rel=1e-12)


@given(st.lists(st.tuples(*[st.floats(-0.2, 0.2)] * 3), min_size=1, max_size=60))
def test_the_angle_travelled_is_the_sum_of_steps_in_the_worlds_frame(steps: list[tuple[float, ...]]) -> None:
    """Also where the rotation vector jumps from pi to -pi."""
    axes, at = PoseAxes(LENGTH_M), Rotation.identity()
    travelled = np.zeros(3)
    axes.lengths(Sample((0.1, 0.2, 0.3, 0.0, 0.0, 0.0), None))
    for step in steps:
        at = Rotation.from_rotvec(step) * at
        travelled += step
        sample = axes.lengths(Sample((0.1, 0.2, 0.3, *at.as_rotvec().tolist()), None))
        assert sample.position_m[:3] == (0.1, 0.2, 0.3)
        assert sample.position_m[3:] == pytest.approx((LENGTH_M * travelled).tolist(), abs=1e-9)
    back = axes.pose(sample.position_m)
    assert (Rotation.from_rotvec(back[3:]).inv() * at).magnitude() < 1e-9


def test_turning_on_past_half_a_turn_goes_on() -> None:
    axes = PoseAxes(LENGTH_M)
    for tick in range(4097):
        angle = 4.0 * pi * tick / 4096
        sample = axes.lengths(
            Sample((0.0, 0.0, 0.0, *Rotation.from_rotvec((0.0, 0.0, angle)).as_rotvec().tolist()), None)
        )
    assert sample.position_m[5] == pytest.approx(LENGTH_M * 4.0 * pi, abs=1e-9)


def test_a_sample_that_is_no_number_changes_nothing() -> None:
    axes = PoseAxes(LENGTH_M)
    axes.lengths(Sample((0.0,) * 6, None))
    assert not np.isfinite(axes.lengths(Sample((0.0, 0.0, 0.0, nan, 0.0, 0.0), None)).position_m[3])
    assert axes.lengths(Sample((0.0,) * 5 + (0.5,), None)).position_m[5] == pytest.approx(LENGTH_M * 0.5)


@given(st.floats(0.01, 0.1), six, st.tuples(*[st.floats(-1.0, 1.0)] * 6))
def test_a_record_in_lengths_bounds_every_axis(
    length_m: float, at: tuple[float, ...], share: tuple[float, ...]
) -> None:
    record, turning = in_lengths(RECORD, length_m), RECORD.rotation
    assert turning is not None
    force = [RECORD.peak_force_n * part for part in share[:3]]
    torque = [turning.peak_torque_nm * part / length_m for part in share[3:]]
    if hypot(*share[:3]) <= 1.0 and hypot(*share[3:]) <= 1.0:
        assert hypot(*force, *torque) <= record.peak_force_n * (1.0 + 1e-12)
    assert record.damping_nspm <= RECORD.damping_nspm
    assert record.damping_nspm * length_m**2 <= turning.damping_nms * (1.0 + 1e-12)
    assert record.apparent_mass_kg * length_m**2 <= turning.apparent_inertia_kgm2 * (1.0 + 1e-12)
    assert record.speed_mps >= RECORD.speed_mps


def live(**changed: object) -> Safety:
    safety = Safety(replace(RECORD, **changed), TICK_S, LENGTH_M)  # type: ignore[arg-type]
    for event in ("open", "calibrated", "go"):
        safety.event(event)  # type: ignore[arg-type]
    for _ in range(round(RAMP_IN_S / TICK_S) + 1):
        safety.limit((0.0,) * 6)
    return safety


@pytest.mark.parametrize(
    ("force_n", "torque_nm"), [(100.0, 0.0), (0.0, 10.0), (100.0, 10.0), (3.0, 10.0), (100.0, 0.05)]
)
def test_force_and_torque_have_peaks_of_their_own(force_n: float, torque_nm: float) -> None:
    safety = live()
    turning = RECORD.rotation
    assert turning is not None
    for _ in range(round(0.4 / TICK_S)):
        out = safety.limit((force_n, 0.0, 0.0, 0.0, torque_nm / LENGTH_M, 0.0))
    assert out[0] == pytest.approx(min(force_n, RECORD.peak_force_n))
    assert LENGTH_M * out[4] == pytest.approx(min(torque_nm, turning.peak_torque_nm))
    assert safety.limited == (force_n > RECORD.peak_force_n or torque_nm > turning.peak_torque_nm)


def test_a_torque_changes_no_faster_than_its_record_lets_it() -> None:
    turning = RECORD.rotation
    assert turning is not None
    safety = live(rotation=replace(turning, slew_nmps=2.0))
    last = 0.0
    for _ in range(200):
        out = safety.limit((1.0, 0.0, 0.0, 0.1 / LENGTH_M, 0.0, 0.0))
        torque = LENGTH_M * out[3]
        assert torque - last <= 2.0 * TICK_S * (1.0 + 1e-9)
        last = torque
    assert last == pytest.approx(0.1)
    assert out[0] == 1.0, "the force's slope is its own"
    assert safety.counts["slew limited"] > 10


@pytest.mark.parametrize(("omega", "state"), [(19.9, "live"), (20.1, "fault")])
def test_turning_too_fast_is_a_fault_said_in_radians(omega: float, state: str) -> None:
    safety = live()
    safety.check(1, (0.0,) * 6, (0.0, 0.0, 0.0, LENGTH_M * omega, 0.0, 0.0))
    assert safety.state == state
    assert ("rad/s" in safety.reason) == (state == "fault")


def test_warm_torque_motors_are_limited_while_the_force_is_not() -> None:
    safety = live()
    wish = (0.5, 0.0, 0.0, 0.19 / LENGTH_M, 0.0, 0.0)
    for _ in range(round(8.0 / TICK_S)):
        out = safety.limit(wish)
    assert safety.derated
    assert "N m" in safety.warning
    assert LENGTH_M * out[3] < 0.1
    assert out[0] == 0.5
    for _ in range(round(30.0 / TICK_S)):
        safety.limit(wish)
    assert safety.state == "fault"
    assert "0.05 N m" in safety.reason


@pytest.mark.parametrize("wrong", [nan, inf, -inf])
def test_a_torque_that_is_no_number_ends_the_force(wrong: float) -> None:
    safety = live()
    safety.limit((1.0, 0.0, 0.0, 1.0, 0.0, 0.0))
    for _ in range(100):
        out = safety.limit((1.0, 0.0, 0.0, wrong, 0.0, 0.0))
    assert safety.state == "fault"
    assert out == (0.0,) * 6
