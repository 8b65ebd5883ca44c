"""Buttons, orientation and gripper of devices, by whatever stands for them. Virtual time."""

from ctypes import c_double
from math import cos, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from cogrip.devices import make
from cogrip.devices.arm.gimbal import POLHEM, POLHEM_HID, VINTAGE, Gimbal
from cogrip.devices.arm.models import MODELS
from cogrip.devices.device import DeviceError
from cogrip.devices.simulated.presses import Press, read_presses
from cogrip.protocol.laws.rotations import exp, of_matrix, turned

from tests.devices import arm_bench
from tests.devices.forcedimension_bench import Sdk
from tests.devices.held_device import RATE_HZ, hold, opened
from tests.devices.openhaptics_bench import Bench as Hd

NO_FORCE = (0.0, 0.0, 0.0)
counts = st.tuples(*[st.integers(-400, 400)] * 3)
small = st.tuples(*[st.floats(-0.3, 0.3)] * 3)


def matrix(axis: int, angle: float) -> NDArray[np.float64]:
    """The rotation matrix about x, y or z, as textbooks write it."""
    c, s = cos(angle), sin(angle)
    return np.array([
        [[1, 0, 0], [0, c, -s], [0, s, c]], [[c, 0, s], [0, 1, 0], [-s, 0, c]], [[c, -s, 0], [s, c, 0], [0, 0, 1]],
    ][axis])  # fmt: skip


def turning(q: tuple[float, ...]) -> NDArray[np.float64]:
    return np.array([turned(q, axis) for axis in np.eye(3)]).T


@given(counts, small)
def test_a_polhem_turns_as_its_maker_writes(raw: tuple[int, int, int], off: tuple[float, float, float]) -> None:
    """Rz(t1) Ry(-lam) Rx(tD) Ry(tE) Rx(tF), tD, tE = -2 pi n / 1024, tF = 2 pi n / 1024; over HID from f, e, d."""
    model = MODELS["polhem"]
    home = model.kinematics.inverse(NO_FORCE)
    assert home is not None
    angles = (home[0] + off[0], home[1] + off[1], home[2] + off[2])
    lam = model.kinematics.forearm(angles)  # type: ignore[attr-defined]
    for gimbal, (d, e, f) in ((POLHEM, raw), (POLHEM_HID, raw[::-1])):
        found = gimbal.orientation(model.kinematics, angles, raw)
        if lam is None:
            assert found is None
            continue
        assert found is not None
        k = 2 * pi / 1024
        want = matrix(2, angles[0]) @ matrix(1, -lam) @ matrix(0, -k * d) @ matrix(1, -k * e) @ matrix(0, k * f)
        np.testing.assert_allclose(turning(found), want, atol=1e-12)


@given(counts, small)
def test_a_vintage_phantom_turns_as_its_maker_writes(
    raw: tuple[int, int, int], angles: tuple[float, float, float]
) -> None:
    """Rz(t1) Rz(tD) Ry(tE) Rx(tF), tD = -2 pi n / 2000, tE, tF = 2 pi n / 2000."""
    found = VINTAGE.orientation(MODELS["vintage"].kinematics, angles, raw)
    assert found is not None
    k, (d, e, f) = 2 * pi / 2000, raw
    want = matrix(2, angles[0]) @ matrix(2, -k * d) @ matrix(1, k * e) @ matrix(0, k * f)
    np.testing.assert_allclose(turning(found), want, atol=1e-12)


@pytest.mark.parametrize(("name", "gimbal", "home"), [("vintage", VINTAGE, (0, 0, 0)), ("polhem", POLHEM, (0, 30, 0))])
def test_a_serial_arm_reads_its_gimbal(name: str, gimbal: Gimbal, home: tuple[int, int, int]) -> None:
    device = arm_bench.opened(name)
    device.arm.gimbal = (100, -50, 25)
    sample = device.hold(NO_FORCE, 5)[-1]
    assert device.driver.capability.gives_orientation
    calibrated = np.add((100, -50, 25), home).tolist()
    assert sample.orientation == gimbal.orientation(MODELS[name].kinematics, device.driver.angles, calibrated)


@pytest.mark.parametrize("pose", ["home", "stored"])
def test_a_hid_arm_reads_gimbal_and_button(pose: str) -> None:
    """Counters that were loaded have the home counts in them; counters that began in the home pose have not."""
    device = opened(f"emulated:polhem-hid?pose={pose}&press=1@0.05+0.1", axes=3)
    device.firmware.gimbal = [100, -50, 25]
    samples = hold(device, 300)
    down = [tick for tick, sample in enumerate(samples) if sample and sample.buttons]
    assert (down[0], down[-1]) == pytest.approx((0.05 * RATE_HZ, 0.15 * RATE_HZ), abs=3)
    assert len(down) == down[-1] - down[0] + 1
    home = 30 if pose == "home" else 0
    model, angles = device.driver.model, device.driver.angles
    assert samples[-1].orientation == POLHEM_HID.orientation(model.kinematics, angles, (100, -50 + home, 25))


def test_a_gimbal_that_cannot_be_read_has_no_orientation() -> None:
    device = arm_bench.opened("vintage")
    send = device.arm.faults.send
    device.arm.faults.send = lambda data, now_ns: send(data.replace(b",0]", b",2]"), now_ns)
    assert {sample.orientation for sample in device.hold(NO_FORCE, 9)[3:] if sample} == {None}


def test_presses_by_schedule() -> None:
    assert read_presses("", "x") == ()
    assert read_presses("1@2.0+0.3", "x") == (Press(1, 2.0, 0.3),)
    assert read_presses("32@0+1000000,1@1000000+0", "x") == (Press(32, 0, 1e6), Press(1, 1e6, 0))


@pytest.mark.parametrize(
    "text",
    ["0@1+1", "33@1+1", "1@1", "1+1", "1@-1+1", "1@1+1,", "1@1000001+1", "1@1+1000001", "1@nan+1", "x", "1@1e3+1"],
)
def test_presses_that_cannot_be_are_refused(text: str) -> None:
    with pytest.raises(DeviceError, match=r"press=.*write BUTTON@START_S\+HOLD_S, such as press=1@2.0\+0.3"):
        make(f"sim:phantom?press={text}", axes=1)


@pytest.mark.parametrize("address", ["sim:phantom", "sim:ideal", "sim:freeflyer"])
def test_a_simulated_hand_presses_at_its_ticks(address: str) -> None:
    axes = 6 if "freeflyer" in address else 2
    device = opened(f"{address}?press=3@0.01+0.02,1@0.02+0", axes, 1000)
    assert device.capability.buttons == 3
    found = [sample.buttons for sample in hold(device, 40)]
    assert found == [4 * (10 <= tick < 30) + (tick == 20) for tick in range(40)]
    assert make(address, axes=axes).capability.buttons == 0


def test_openhaptics_gives_buttons_and_orientation_in_our_axes(bench: Hd) -> None:
    """The library's x, y, z are our y, z, x: a turn about its x is one about our y."""
    device = bench.opened(0, keys="&model=touch")
    for axis, ours in ((0, 1), (1, 2), (2, 0)):
        columns = matrix(axis, 0.7).T.ravel()
        bench.lib.stub_turn(0, (c_double * 9)(*columns))
        bench.lib.stub_buttons(0, 0b1011 if axis else 0)
        bench.step(2)
        sample = device.read(10 + axis)
        np.testing.assert_allclose(turning(sample.orientation), matrix(ours, 0.7), atol=1e-12)
        assert sample.buttons == (0b1011 if axis else 0)
    bench.lib.stub_turn(0, (c_double * 9)(*[0.0] * 9))
    bench.step(2)
    assert device.read(20).orientation is None, "that is no rotation"
    device.close()


def test_force_dimension_gives_buttons_orientation_and_grip(sdk: Sdk) -> None:
    sdk.become("omega7")
    device = sdk.opened(0, keys="&model=omega7")
    assert (device.capability.gives_orientation, device.capability.grip_m) == (True, (0.0, 0.03))
    sdk.lib.stub_turn(0, (c_double * 9)(*matrix(1, -0.4).ravel()))
    sdk.lib.stub_gap(0, c_double(0.0125))
    sdk.lib.stub_buttons(0, 0b11)
    sample = device.read(1)
    np.testing.assert_allclose(turning(sample.orientation), matrix(1, -0.4), atol=1e-12)
    assert (sample.grip_m, sample.buttons) == (0.0125, 1), "the record has one button"
    for verb in (b"orientation", b"gripper"):
        sdk.lib.stub_fail(verb)
        sample = device.read(2)
        assert (sample.orientation is None) is (verb == b"orientation")
        assert (sample.grip_m is None) is (verb == b"gripper")
    assert device.counts == {"orientation not read": 1, "gripper not read": 1}
    sdk.lib.stub_fail(b"")
    device.close()


def test_a_force_dimension_device_of_no_stated_model_has_the_handle_that_it_has(sdk: Sdk) -> None:
    sdk.become("sigma7")
    device = sdk.device(0, keys="")
    assert not device.capability.gives_orientation
    device.open(1024)
    assert device.capability.gives_orientation
    assert device.capability.peak_force_n == 8.0, "the weakest model's"
    device.close()


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 3), st.floats(1e-3, pi))
def test_a_rotation_matrix_and_its_quaternion_turn_alike(axis: tuple[float, float, float], angle: float) -> None:
    size = float(np.linalg.norm(axis))
    if size < 1e-3:
        return
    rows = turning(exp([angle / size * part for part in axis]))
    found = of_matrix(rows.tolist())
    assert found is not None
    np.testing.assert_allclose(turning(found), rows, atol=1e-12)


@pytest.mark.parametrize("rows", [np.zeros((3, 3)), 2.0 * np.eye(3), -np.eye(3), np.full((3, 3), np.nan)])
def test_what_is_no_rotation_has_no_quaternion(rows: NDArray[np.float64]) -> None:
    assert of_matrix(rows.tolist()) is None
