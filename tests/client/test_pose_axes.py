"""Axes of a hand that turns, as lengths: power is kept, angles add up, bounds hold; limits of force and torque apart."""

from dataclasses import replace
from math import hypot, inf, nan

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cogrip.client.hand.further_axes import in_lengths
from cogrip.client.hand.pose_axes import PoseAxes
from cogrip.client.safety.limiter import Safety
from cogrip.devices import make
from cogrip.devices.device import Sample

from tests.client.live_safety import full, give

LENGTH_M, TICK_S = 0.03, 1.0 / 1024.0
RECORD = make("sim:phantom6", axes=6).capability
assert RECORD.rotation is not None
TURNING = RECORD.rotation
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


@example([(0.0, 0.0, 0.2)] * 63)  # two turns
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


def test_a_sample_that_is_no_number_changes_nothing() -> None:
    axes = PoseAxes(LENGTH_M)
    axes.lengths(Sample((0.0,) * 6, None))
    assert not np.isfinite(axes.lengths(Sample((0.0, 0.0, 0.0, nan, 0.0, 0.0), None)).position_m[3])
    assert axes.lengths(Sample((0.0,) * 5 + (0.5,), None)).position_m[5] == pytest.approx(LENGTH_M * 0.5)


@given(st.floats(0.01, 0.1), six, st.tuples(*[st.floats(-1.0, 1.0)] * 6))
def test_a_record_in_lengths_bounds_every_axis(
    length_m: float, at: tuple[float, ...], share: tuple[float, ...]
) -> None:
    record = in_lengths(RECORD, length_m)
    force = [RECORD.peak_force_n * part for part in share[:3]]
    torque = [TURNING.peak_torque_nm * part / length_m for part in share[3:]]
    if hypot(*share[:3]) <= 1.0 and hypot(*share[3:]) <= 1.0:
        assert hypot(*force, *torque) <= record.peak_force_n * (1.0 + 1e-12)
    assert record.damping_nspm <= RECORD.damping_nspm
    assert record.damping_nspm * length_m**2 <= TURNING.damping_nms * (1.0 + 1e-12)
    assert record.apparent_mass_kg * length_m**2 <= TURNING.apparent_inertia_kgm2 * (1.0 + 1e-12)
    assert record.speed_mps >= RECORD.speed_mps


def live(**changed: object) -> Safety:
    return full(RECORD, TICK_S, LENGTH_M, **changed)


@pytest.mark.parametrize(
    ("force_n", "torque_nm"), [(100.0, 0.0), (0.0, 10.0), (100.0, 10.0), (3.0, 10.0), (100.0, 0.05)]
)
def test_force_and_torque_have_peaks_of_their_own(force_n: float, torque_nm: float) -> None:
    safety = live()
    out = give(safety, (force_n, 0.0, 0.0, 0.0, torque_nm / LENGTH_M, 0.0), round(0.4 / TICK_S))[-1]
    assert out[0] == pytest.approx(min(force_n, RECORD.peak_force_n))
    assert LENGTH_M * out[4] == pytest.approx(min(torque_nm, TURNING.peak_torque_nm))
    assert safety.limited == (force_n > RECORD.peak_force_n or torque_nm > TURNING.peak_torque_nm)


def test_a_torque_changes_no_faster_than_its_record_lets_it() -> None:
    safety = live(rotation=replace(TURNING, slew_nmps=2.0))
    out = np.array(give(safety, (1.0, 0.0, 0.0, 0.1 / LENGTH_M, 0.0, 0.0), 200))
    torque_nm = LENGTH_M * out[:, 3]
    assert np.diff(torque_nm, prepend=0.0).max() <= 2.0 * TICK_S * (1.0 + 1e-9)
    assert torque_nm[-1] == pytest.approx(0.1)
    assert out[-1, 0] == 1.0, "the force's slope is its own"
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
    out = give(safety, wish, round(8.0 / TICK_S))[-1]
    assert safety.derated
    assert "N m" in safety.warning
    assert LENGTH_M * out[3] < 0.1
    assert out[0] == 0.5
    give(safety, wish, round(30.0 / TICK_S))
    assert safety.state == "fault"
    assert "0.05 N m" in safety.reason


@pytest.mark.parametrize("wrong", [nan, inf, -inf])
def test_a_torque_that_is_no_number_ends_the_force(wrong: float) -> None:
    safety = live()
    safety.limit((1.0, 0.0, 0.0, 1.0, 0.0, 0.0))
    assert give(safety, (1.0, 0.0, 0.0, wrong, 0.0, 0.0), 100)[-1] == (0.0,) * 6
    assert safety.state == "fault"
