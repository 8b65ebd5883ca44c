"""The five-bar linkage and the models made of it: two ways round, slopes, power, and the numbers in the records."""

from dataclasses import replace
from math import cos, degrees, hypot, isclose, pi, radians, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.devices.arm.kinematics import joint_torque
from cogrip.devices.device import DeviceError
from cogrip.devices.haply.five_bar import FiveBar
from cogrip.devices.haply.models import MODELS, MOST_NM, HaplyModel, HaplySettings, model_of
from cogrip.devices.settings import read_settings

models = st.sampled_from(sorted(MODELS))
shares = st.floats(-1.0, 1.0)
forces = st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))
facings = st.sampled_from((1.0, -1.0))
every_model = pytest.mark.parametrize("name", sorted(MODELS))


def place(model: HaplyModel, share_x: float, share_y: float) -> tuple[float, float, float]:
    (_, x), (_, y) = model.record.workspace_m
    return share_x * x, share_y * y, 0.0


@given(models, shares, shares, facings)
def test_inverse_puts_the_links_where_they_meet_and_forward_undoes_it(
    name: str, share_x: float, share_y: float, facing: float
) -> None:
    """Links have their lengths, and the tip is on the left of the elbows."""
    model = MODELS[name]
    bar = replace(model.five_bar, facing=facing)
    x, y, _ = position = place(model, share_x, share_y)
    t1, t2, _ = angles = bar.inverse(position)
    assert bar.forward(angles) == pytest.approx(position, abs=1e-12)
    assert bar.inverse(bar.forward(angles)) == pytest.approx(angles, rel=0.0, abs=1e-9)
    px, py = bar.origin_m[0] - facing * y, bar.origin_m[1] + facing * x
    ax, ay = bar.proximal_m * cos(t1), bar.proximal_m * sin(t1)
    bx, by = bar.base_m + bar.proximal_m * cos(t2), bar.proximal_m * sin(t2)
    assert hypot(px - ax, py - ay) == pytest.approx(bar.distal_m, rel=1e-12)
    assert hypot(px - bx, py - by) == pytest.approx(bar.distal_m, rel=1e-12)
    assert (bx - ax) * (py - ay) - (by - ay) * (px - ax) > 0.0


@given(models, shares, shares, facings)
def test_jacobian_is_the_slope_of_forward(name: str, share_x: float, share_y: float, facing: float) -> None:
    model, step = MODELS[name], 1e-6
    bar = replace(model.five_bar, facing=facing)
    angles = bar.inverse(place(model, share_x, share_y))
    jacobian = bar.jacobian(angles)
    largest = max(abs(entry) for row in jacobian for entry in row)
    for joint in (0, 1):
        shift = step * np.eye(3)[joint]
        slope = np.subtract(bar.forward(tuple(angles + shift)), bar.forward(tuple(angles - shift))) / (2.0 * step)
        assert np.abs(np.array(jacobian)[:, joint] - slope).max() < 1e-6 * largest
    assert jacobian[2] == (0.0, 0.0, 0.0)
    assert all(row[2] == 0.0 for row in jacobian)


def test_common_frame_has_the_motors_far_from_the_user_unless_told() -> None:
    """The bisector of the motors runs along x; Haply's X goes to the left, so the motor at d is left of the one at 0."""
    bar = MODELS["2diy"].five_bar
    up = radians(90.0)
    near, far = bar.forward((up + 0.5, up - 0.5, 0.0)), bar.forward((up + 1.2, up - 1.2, 0.0))
    assert far[0] < near[0]  # arms spread wide: the tip is at the motors, away from the user
    assert near[1] == pytest.approx(0.0, abs=1e-12)
    aside = bar.forward((up + 0.3, up - 0.7, 0.0))  # both motors turned toward +X of Haply's
    assert aside[1] < 0.0
    turned = replace(bar, facing=-1.0).forward((up + 0.3, up - 0.7, 0.0))
    assert turned == pytest.approx((-aside[0], -aside[1], 0.0))


@pytest.mark.parametrize("angles", [(pi, 0.0, 0.0), (float("nan"), 0.0, 0.0)])
def test_angles_at_which_it_does_not_close_have_no_answer(angles: tuple[float, float, float]) -> None:
    bar = FiveBar(0.09, 0.07, 0.038, (0.0, 0.0))
    assert bar.forward(angles) is None
    assert bar.jacobian(angles) is None


@every_model
def test_home_pose_is_in_reach_and_out_of_reach_is_not(name: str) -> None:
    model = MODELS[name]
    bar = model.five_bar
    home = bar.forward(model.drive.angles(model.home_counts))
    assert model.inside(home)
    again = bar.inverse(home)
    assert [degrees(t) for t in again[:2]] == pytest.approx(model.wiring.home_deg, abs=1e-9)
    assert not model.inside((bar.proximal_m + bar.distal_m, 0.0, 0.0))
    assert not model.inside((-bar.origin_m[1] - 0.01, 0.0, 0.0))  # behind the motors
    assert not model.inside((float("nan"), 0.0, 0.0))
    assert bar.inverse((1.0, 0.0, 0.0)) is None


@every_model
def test_record_states_what_the_weakest_place_and_the_centre_give(name: str) -> None:
    model = MODELS[name]
    bar, record = model.five_bar, model.record
    weakest = min(
        MOST_NM / max(hypot(jacobian[0][k], jacobian[1][k]) for k in (0, 1))
        for i in range(-20, 21)
        for j in range(-20, 21)
        if (jacobian := bar.jacobian(bar.inverse(place(model, i / 20, j / 20)))) is not None
    )
    assert 0.99 * weakest < record.peak_force_n <= weakest
    centre = bar.jacobian(bar.inverse((0.0, 0.0, 0.0)))
    step_m = max(hypot(centre[0][k], centre[1][k]) * model.drive.rad_per_count[k] for k in (0, 1))
    assert step_m <= record.resolution_m < 1.1 * step_m


@given(models, shares, shares, forces)
def test_commands_never_exceed_the_clamp_and_keep_the_direction(
    name: str, share_x: float, share_y: float, force: tuple[float, float, float]
) -> None:
    model = MODELS[name]
    angles = model.five_bar.inverse(place(model, share_x, share_y))
    commands, limited = model.currents(angles, force)
    assert all(abs(command) <= 12300 for command in commands)
    assert commands[2] == 0
    exact = model.drive.currents(joint_torque(model.five_bar.jacobian(angles), force))
    assert abs(exact[0] * commands[1] - exact[1] * commands[0]) <= 2.0 * max(map(abs, exact)) + 1e-9
    if not limited:
        assert all(abs(given - want) < 1.0 + 1e-9 for given, want in zip(commands, exact, strict=True))


def settings(**query: str) -> HaplySettings:
    return read_settings(HaplySettings, {"model": "2diy", **query}, "here")


def test_settings_turn_joints_and_motors_and_the_plane() -> None:
    plain = model_of(settings(), "here")
    assert plain == MODELS["2diy"]
    turned = model_of(settings(dir="1,-1"), "here")
    angles = plain.five_bar.inverse((0.01, 0.02, 0.0))
    a, b, _ = plain.drive.counts(angles)
    assert turned.drive.counts(angles)[:2] == pytest.approx((a, -b))
    commands, other = (model.currents(angles, (0.3, 0.2, 0.0))[0] for model in (plain, turned))
    assert other == (commands[0], -commands[1], 0)
    assert turned.home_counts[1] == -plain.home_counts[1]
    motors = model_of(settings(motor_dir="-1,1"), "here")
    assert motors.currents(angles, (0.3, 0.2, 0.0))[0] == (-commands[0], commands[1], 0)
    assert motors.drive.counts(angles) == plain.drive.counts(angles)
    near = model_of(settings(motors="near"), "here")
    assert near.kinematics.forward(angles) == pytest.approx((-0.01, -0.02, 0.0))


def test_settings_set_limits_and_home() -> None:
    weak = model_of(settings(limit_nm="0.05,0.1", peak_force_n="1.2"), "here")
    assert weak.drive.limit_ma[:2] == pytest.approx((5000.0, 10000.0))
    assert weak.record.peak_force_n == 1.2
    assert isclose(weak.record.continuous_force_n, 0.5 * 0.05 / 0.123)
    home = model_of(settings(home_deg="170,10"), "here")
    assert [degrees(t) for t in home.drive.angles(home.home_counts)[:2]] == pytest.approx((170.0, 10.0))


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("dir", "1", "two numbers, each -1 or 1"),
        ("motor_dir", "1,0", "two numbers, each -1 or 1"),
        ("limit_nm", "0.1,0.124", "two numbers, each 0.001 to 0.123"),
        ("limit_nm", "0,0.1", "two numbers, each 0.001 to 0.123"),
        ("home_deg", "361,0", "two numbers, each -360 to 360"),
        ("peak_force_n", "21", "at most 20, in N; got '21'"),
        ("motors", "left", "far, near"),
        ("model", "inverse3", "2diy, 2diy-metal, pantograph"),
    ],
)
def test_settings_out_of_bounds_are_refused_with_the_bound(key: str, value: str, text: str) -> None:
    with pytest.raises(DeviceError, match=text):
        model_of(settings(**{key: value}), "here")
