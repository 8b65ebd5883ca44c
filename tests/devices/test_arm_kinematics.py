"""Forward and inverse kinematics: Phantom's and Polhem's mechanisms. The laws hold at random poses of the workspace.

Numbers that are printed with the tables are in test_arm_models; of the Polhem none are: its linkage is tested by its lengths.
"""

from math import acos, cos, degrees, hypot, inf, nan, pi, sin

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from cogrip.devices.arm.kinematics import joint_torque
from cogrip.devices.arm.models import MODELS
from cogrip.devices.arm.parallel_drive import ParallelDrive, Weights
from cogrip.devices.arm.polhem import Polhem

from tests.devices.test_arm_records import centres

WOODEN = MODELS["woodenhaptics"].kinematics
PREMIUM = MODELS["vintage"].kinematics
LINKAGE = MODELS["polhem"].kinematics
NOWHERE = (0.0, 2.2, 2.0)  # the elbow back, the crank towards it
HOME = MODELS["polhem"].drive.angles(MODELS["polhem"].home_counts)

every_model = pytest.mark.parametrize("name", MODELS)
unit = st.floats(-1.0, 1.0)
force = st.tuples(*[st.floats(-10.0, 10.0)] * 3)
rate = st.tuples(*[st.floats(-3.0, 3.0)] * 3)


@st.composite
def poses(draw: st.DrawFn, name: str) -> tuple[float, float, float]:
    """Joint angles with the tip in the model's workspace, a thousandth of a radian and more from an arm stretched straight."""
    model = MODELS[name]
    x, y, z = draw(st.tuples(unit, unit, unit))
    size = max(1.0, hypot(x, y, z))
    angles = model.kinematics.inverse((model.reach_m * x / size, model.reach_m * y / size, model.reach_m * z / size))
    assume(angles is not None)
    jacobian = model.kinematics.jacobian(angles)
    assume(jacobian is not None)
    volume = abs(np.linalg.det(np.array(jacobian)))
    assume(volume > 1e-3 * np.prod(np.linalg.norm(np.array(jacobian), axis=0)))
    return angles


def difference(function, angles, step=1e-5):
    """d function / d angles by central differences, columns per joint."""
    columns = []
    for joint in range(3):
        there, here = list(angles), list(angles)
        there[joint] += 0.5 * step
        here[joint] -= 0.5 * step
        columns.append((np.array(function(tuple(there))) - np.array(function(tuple(here)))) / step)
    return np.array(columns).T


def energy_slope(arm, angles, g: float) -> np.ndarray:
    """Slopes of the potential energy of the links [N m]."""
    return difference(lambda at: [g * sum(mass * z for mass, _, z in centres(arm, at))], angles)[0]


@every_model
@given(data=st.data())
def test_inverse_undoes_forward(name, data) -> None:
    angles = data.draw(poses(name))
    back = MODELS[name].kinematics.inverse(MODELS[name].kinematics.forward(angles))
    assert back == pytest.approx(angles, abs=1e-9)


@every_model
@given(data=st.data())
def test_jacobian_is_the_central_difference(name, data) -> None:
    angles = data.draw(poses(name))
    jacobian = np.array(MODELS[name].kinematics.jacobian(angles))
    assert np.abs(jacobian - difference(MODELS[name].kinematics.forward, angles)).max() <= 1e-6 * np.abs(jacobian).max()


@every_model
@given(data=st.data(), push=force, joint_rate=rate)
def test_force_times_velocity_is_torque_times_joint_rate(name, data, push, joint_rate) -> None:
    jacobian = MODELS[name].kinematics.jacobian(data.draw(poses(name)))
    velocity = np.array(jacobian) @ joint_rate
    scale = np.linalg.norm(push) * np.abs(jacobian).max() * np.linalg.norm(joint_rate)
    assert np.dot(push, velocity) == pytest.approx(
        np.dot(joint_torque(jacobian, push), joint_rate), abs=1e-12 * (1.0 + scale)
    )


@every_model
def test_points_that_are_far_or_not_finite_are_out_of_reach(name) -> None:
    kinematics = MODELS[name].kinematics
    for point in ((10.0, 0.0, 0.0), (0.0, -10.0, 0.0), (0.0, 0.0, 10.0), (nan, 0.0, 0.0), (0.0, 0.0, inf)):
        assert kinematics.inverse(point) is None


def test_reach_of_the_parallel_drive_ends_where_the_links_are_straight_and_folded() -> None:
    arm = ParallelDrive(0.0, (0.2, 0.15), (0.0, 0.0, 0.0), Weights(0.0, 0.0, 0.0, 0.0))
    for inside, outside in ((0.3499, 0.3501), (0.0501, 0.0499)):
        assert arm.inverse((inside, 0.0, 0.0)) is not None
        assert arm.inverse((outside, 0.0, 0.0)) is None


@given(st.data())
def test_elbow_of_the_parallel_drive_points_up_and_back(data) -> None:
    _, upper, forearm = data.draw(poses("vintage"))
    assert 0.0 < upper + forearm < pi


@given(st.tuples(*[st.floats(-1.5, 1.5)] * 3))
def test_gravity_of_the_parallel_drive_is_the_gradient_of_its_potential_energy(angles) -> None:
    """hfabapi's own term is not: its torque of b depends on the angle of c, its torque of c on that of b not."""
    assert WOODEN.gravity(angles) == (0.0, 0.0, 0.0)
    w = Weights(0.170, 0.110, 0.051, 0.091, 9.82)
    weighed = ParallelDrive(0.08, (0.205, 0.245), (0.22, 0.0, 0.08), w)

    assert weighed.gravity(angles) == pytest.approx(energy_slope(weighed, angles, 9.82), abs=1e-8)


def points_of(linkage: Polhem, angles) -> dict[str, np.ndarray]:
    """The joints in the plane of the turret, from the angles and from where the tip is said to be."""
    l0, l1, l2, _, l4, _ = linkage.lengths_m
    x, y, z = np.array(linkage.forward(angles)) + linkage.origin_m
    tip = np.array([x * cos(angles[0]) + y * sin(angles[0]), z])
    assert x * sin(angles[0]) == pytest.approx(y * cos(angles[0]), abs=1e-12)
    elbow = np.array([l0 / 2 + l1 * cos(angles[1]), l1 * sin(angles[1])])
    crank = np.array([-l0 / 2 + l2 * cos(angles[2]), l2 * sin(angles[2])])
    along = (tip - elbow) / np.linalg.norm(tip - elbow)
    fixed = {"O1": np.array([l0 / 2, 0.0]), "O2": np.array([-l0 / 2, 0.0])}
    return {**fixed, "T": tip, "B": elbow, "A": crank, "C": elbow - l4 * along}


@given(st.data())
def test_linkage_closes_with_every_link_as_long_as_it_is(data) -> None:
    angles = data.draw(poses("polhem"))
    at = points_of(LINKAGE, angles)
    lengths = {"O1 O2": 0.034, "O1 B": 0.165, "O2 A": 0.025, "A C": 0.190, "B C": 0.034, "B T": 0.1308}
    for pair, length in lengths.items():
        first, second = pair.split()
        assert np.linalg.norm(at[first] - at[second]) == pytest.approx(length, abs=1e-12), pair
    assert np.linalg.norm(at["T"] - at["C"]) == pytest.approx(0.034 + 0.1308, abs=1e-12)  # the forearm is straight
    assert np.cross([*(at["A"] - at["B"]), 0.0], [*(at["C"] - at["B"]), 0.0])[2] < 0.0  # as it is put together


def source_forearm(tb: float, tc: float) -> float:
    """lam as hfabapi writes it. Raises ValueError where an arc cosine has no value."""
    l0, l1, l2, l3, l4, _ = LINKAGE.lengths_m
    a, s = l0 + l1 * cos(tb), l1 * sin(tb)
    d1, d2 = hypot(a - l2 * cos(tc), s - l2 * sin(tc)), hypot(a, s)
    return (
        tb
        - acos((l1**2 - l0**2 + d2**2) / (2 * l1 * d2))
        - acos((l4**2 - l3**2 + d1**2) / (2 * l4 * d1))
        - acos((d1**2 + d2**2 - l2**2) / (2 * d1 * d2))
    )


@given(st.floats(0.02, 3.1), st.floats(0.0, 2.0 * pi))
@example(HOME[1], HOME[2])
def test_forearm_is_where_the_source_has_it_where_the_source_s_linkage_closes(tb, tc) -> None:
    l0, l1, l2, l3, l4, _ = LINKAGE.lengths_m
    back = np.array([-l0 - l1 * cos(tb), -l1 * sin(tb)])  # from B to O2
    down = back + np.array([l2 * cos(tc), l2 * sin(tc)])  # from B to A
    assume(back[0] * down[1] - back[1] * down[0] < -1e-9)
    cosine = (l4**2 - l3**2 + down @ down) / (2 * l4 * np.linalg.norm(down))
    assume(abs(abs(cosine) - 1.0) > 1e-9)
    ours = LINKAGE.forearm((0.3, tb, tc))
    assert (ours is None) == (abs(cosine) > 1.0)
    if ours is not None:
        turn = ours - source_forearm(tb, tc)
        assert turn - 2.0 * pi * round(turn / (2.0 * pi)) == pytest.approx(0.0, abs=1e-7)


def test_home_pose_and_centre_of_the_polhem() -> None:
    assert [degrees(angle) for angle in HOME] == pytest.approx([120.450064, 124.799858, 238.466750], abs=1e-6)
    assert degrees(LINKAGE.forearm(HOME)) == pytest.approx(-30.272289, abs=1e-6)
    assert LINKAGE.forward(HOME) == pytest.approx((-0.222641, 0.030859, 0.037052), abs=1e-6)
    assert LINKAGE.inverse(LINKAGE.forward(HOME)) == pytest.approx(HOME, abs=1e-9)
    assert LINKAGE.inverse((0.0, 0.0, 0.0)) == pytest.approx((0.0, 0.912695, 2.360105), abs=1e-6)


def test_polhem_is_nowhere_where_the_rod_does_not_reach() -> None:
    """The crank turns towards the elbow until forearm and rod lie in one line; from there on the rod is too long."""
    near, far = 4.2, NOWHERE[2]
    assert LINKAGE.forward((0.0, 2.2, near)) is not None
    assert LINKAGE.forward(NOWHERE) is None
    while near - far > 1e-12:
        middle = 0.5 * (near + far)
        near, far = (middle, far) if LINKAGE.forward((0.0, 2.2, middle)) is not None else (near, middle)
    beyond = (0.0, 2.2, far)
    assert LINKAGE.jacobian(beyond) is None
    assert LINKAGE.forearm(beyond) is None
    assert LINKAGE.gravity(beyond) == (0.0, 0.0, 0.0)
    assert LINKAGE.jacobian((0.0, 2.2, near)) is None  # in line: no torque of the crank holds the forearm
    assert LINKAGE.jacobian((0.0, 2.2, near + 0.05)) is not None


def test_polhem_out_of_reach_is_none_on_both_ways() -> None:
    straight = 0.165 + 0.1308 + 0.017 - 0.2045
    assert LINKAGE.inverse((straight + 1e-6, 0.0, -0.0325)) is None  # past the stretched arm
    assert LINKAGE.inverse((0.15, 0.0, 0.0)) is None  # the arm is long enough, the rod is not
    assert LINKAGE.forward((0.0, nan, 1.0)) is None
    pinched = Polhem((0.0, 0.1, 0.1, 0.1, 0.05, 0.1), (0.0, 0.0, 0.0))
    assert pinched.forward((0.0, 1.0, 1.0)) is None  # A upon B: no direction
    assert pinched.inverse((0.0, 0.0, 0.0)) is None  # the tip upon O1


@given(st.data())
def test_gravity_of_the_polhem_is_the_gradient_of_its_potential_energy(data) -> None:
    angles = data.draw(poses("polhem"))
    assert Polhem(LINKAGE.lengths_m, LINKAGE.origin_m).gravity(angles) == (0.0, 0.0, 0.0)
    torque = LINKAGE.gravity(angles)
    assert torque == pytest.approx(energy_slope(LINKAGE, angles, 9.81), abs=1e-6 * max(map(abs, torque)))


@pytest.mark.parametrize(
    ("tip", "torque"),
    [
        ((0.0, 0.0, 0.0), (0.0, 0.166152291835, 0.0183359590121)),
        ((0.03, 0.02, -0.05), (0.0, 0.247505740519, 0.0179560158374)),
        ((-0.05, 0.0, 0.05), (0.0, 0.0272979883995, 0.0221777580087)),
        ((0.08, -0.02, 0.02), (0.0, 0.240355963886, 0.0229425980699)),
    ],
)
def test_gravity_of_the_polhem_is_its_maker_s(tip, torque) -> None:
    """Answers of polhemComputeMotorAmps of hfabapi, compiled, to no force, by differences over a milliradian."""
    assert LINKAGE.gravity(LINKAGE.inverse(tip)) == pytest.approx(torque, abs=3e-8)
