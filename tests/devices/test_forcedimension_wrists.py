"""Torques of wrists and forces of grippers of `forcedimension:`, on a stand-in for libdrd compiled here."""

from ctypes import c_double
from math import cos, sin

import pytest

from cogrip.devices.device import DeviceError
from cogrip.devices.forcedimension.forcedimension_device import STATUS_TICKS
from cogrip.devices.forcedimension.models import GRIPPER, GRIPPERS, RECORDS, WRIST, WRISTS, axes_of
from cogrip.devices.registry import axes_of as axes_at
from cogrip.devices.registry import make

from tests.devices.forcedimension_bench import RATE_HZ, TORQUE
from tests.devices.held_device import refused

FORCE, TURN = (1.0, 2.0, -3.0), (0.05, -0.02, 0.01)


def wrist(sdk, model: str = "delta6"):
    sdk.become(model)
    return sdk.flowing(axes=6, keys=f"&model={model}")


def gripper(sdk, model: str = "omega7"):
    sdk.become(model)
    sdk.lib.stub_gap(0, c_double(0.012))
    return sdk.flowing(axes=4, keys=f"&model={model}")


def turn(sdk, angle_rad: float) -> None:
    """Turn the handle about the third axis."""
    c, s = cos(angle_rad), sin(angle_rad)
    sdk.lib.stub_turn(0, (c_double * 9)(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0))


@pytest.mark.parametrize("model", RECORDS)
def test_axes_are_those_that_have_motors(model: str) -> None:
    address = f"forcedimension:0?model={model}"
    most = axes_at(address)
    assert most == axes_of(model) == (6 if model in WRISTS else 4 if model in GRIPPERS else 3)
    assert make(address, axes=most).capability.axes == most
    if model not in WRISTS:
        refused_words = f"axes=6 is out of 1 to 3: model={model} has no wrist with motors; such are delta6"
        with pytest.raises(DeviceError, match=refused_words):
            make(address, axes=6)
    if model not in GRIPPERS:
        with pytest.raises(DeviceError, match=f"axes=4 is out of 1 to 3: model={model} has no gripper with force"):
            make(address, axes=4)


def test_a_model_that_is_not_stated_has_no_torques() -> None:
    with refused("axes=6 is out of 1 to 3: no model is stated"):
        make("forcedimension:0", axes=6).open(RATE_HZ)
    with refused("axes=5 is out of 1 to 4"):
        make("forcedimension:0?model=delta6", axes=5).open(RATE_HZ)


@pytest.mark.parametrize("model", WRISTS)
def test_a_wrench_loads_the_hand_and_a_pose_is_read(sdk, model: str) -> None:
    device = wrist(sdk, model)
    turn(sdk, 0.3)
    sdk.place(0.01, -0.02, 0.03)
    assert device.read(5).position_m == pytest.approx((0.01, -0.02, 0.03, 0.0, 0.0, 0.3))
    assert device.write((*FORCE, *TURN)) is None
    assert sdk.load() == FORCE
    assert sdk.own()[:3] == tuple(-part for part in TURN)
    assert f"torque limit {WRIST.peak_torque_nm:g} 0" in sdk.journal()
    device.close()
    assert sdk.own() == (0.0,) * 4


def test_a_torque_above_the_limit_keeps_its_direction_and_the_force_stays(sdk) -> None:
    device = wrist(sdk)
    device.read(5)
    acting = device.write((*FORCE, 0.3, 0.0, 0.4))
    assert acting == pytest.approx((*FORCE, 0.12, 0.0, 0.16))
    assert sdk.own()[:3] == pytest.approx((-0.12, 0.0, -0.16))
    assert device.counts == {"force limited": 1}
    acting = device.write((30.0, 0.0, 0.0, *TURN))
    assert acting == pytest.approx((20.0, 0.0, 0.0, *TURN))
    device.close()


@pytest.mark.parametrize("wrench", [(1.0, 0.0, 0.0, float("nan"), 0.0, 0.0), (1.0, 0.0, 0.0)])
def test_what_is_no_wrench_becomes_none(sdk, wrench) -> None:
    device = wrist(sdk)
    device.read(5)
    device.write((*FORCE, *TURN))
    with pytest.raises(DeviceError, match="the force is zero now"):
        device.write(wrench)
    assert (sdk.force(), sdk.own()) == ((0.0,) * 3, (0.0,) * 4)
    device.close()


def test_a_handle_whose_orientation_cannot_be_read_gives_no_sample(sdk) -> None:
    device = wrist(sdk)
    sdk.lib.stub_turn(0, (c_double * 9)(*[0.0] * 9))
    assert device.read(5) is None
    assert device.counts == {"orientation not read": 1}
    device.close()


def test_torques_that_were_switched_off_are_a_fault(sdk) -> None:
    device = wrist(sdk)
    sdk.lib.stub_status(0, TORQUE, 0)
    with pytest.raises(DeviceError, match="its controller has switched the torques off"):
        [sdk.ticked(device, tick, (*FORCE, *TURN)) for tick in range(3, 4 + STATUS_TICKS)]
    assert device.write((*FORCE, *TURN)) == (0.0,) * 6
    assert (sdk.force(), sdk.own()) == ((0.0,) * 3, (0.0,) * 4)
    device.close()


def test_the_watchdog_ends_torques_too_and_they_come_back(sdk) -> None:
    device = wrist(sdk)
    sdk.ticked(device, 10, (*FORCE, *TURN))
    sdk.lib.stub_wait(60)
    assert sdk.own() == (0.0,) * 4
    told = [sdk.ticked(device, 70 + tick, (*FORCE, *TURN)) for tick in range(60)]
    assert told.count((0.0,) * 6) == 22
    assert sdk.own()[:3] == tuple(-part for part in TURN)
    device.close()


@pytest.mark.parametrize("verb", ["torque", "force"])
def test_a_wrench_that_is_not_taken_is_a_fault(sdk, verb: str) -> None:
    device = wrist(sdk)
    sdk.lib.stub_fail(verb.encode())
    device.write((*FORCE, *TURN))
    sdk.lib.stub_fail(b"")
    with pytest.raises(DeviceError, match="lost"):
        device.read(5)
    device.close()


@pytest.mark.parametrize(
    ("model", "axes", "words"), [("sigma6", 6, "its wrist has no motors"), ("omega7", 4, "its gripper has no motor")]
)
def test_one_that_says_of_itself_that_it_has_no_motors_is_refused(sdk, model: str, axes: int, words: str) -> None:
    sdk.become(model)
    sdk.lib.stub_passive(0, 1)
    with pytest.raises(DeviceError, match=words):
        sdk.opened(axes=axes, keys=f"&model={model}")
    sdk.opened(keys=f"&model={model}").close()


@pytest.mark.parametrize(("model", "left"), [("omega7", 0), ("sigma7", 0), ("omega7", 1)])
def test_a_gripper_is_loaded_as_it_opens(sdk, model: str, left: int) -> None:
    """A force that loads fingers as they open closes the gripper: against the number that opens it, left-handed with it."""
    sdk.lib.stub_left(0, left)
    device = gripper(sdk, model)
    assert device.read(5).position_m[3] == 0.012
    assert device.write((*FORCE, 2.5)) is None
    assert sdk.load() == FORCE
    assert sdk.own()[3] == (2.5 if left else -2.5)
    assert device.write((*FORCE, -20.0)) == (*FORCE, -GRIPPER.peak_force_n)
    assert sdk.journal()[1:] == [
        "limit 12 0",
        f"grip limit {GRIPPER.peak_force_n:g} 0",
        "watchdog 255 0",
        "enable 1 0",
        "enable grip 1 0",
    ]
    device.close()
    assert sdk.own()[3] == 0.0


def test_a_gripper_that_cannot_be_enabled_or_read_is_told(sdk) -> None:
    device = gripper(sdk)
    sdk.lib.stub_gap(0, c_double(float("nan")))
    assert device.read(5) is None
    assert device.counts == {"gripper not read": 1}
    device.close()
    sdk.lib.stub_gap(0, c_double(0.01))
    device = sdk.opened(axes=4, keys="&model=omega7")
    sdk.lib.stub_fail(b"enable grip")
    assert sdk.ticked(device, 0, (*FORCE, 1.0)) == (0.0,) * 4
    sdk.lib.stub_fail(b"")
    with pytest.raises(DeviceError, match="its forces cannot be enabled"):
        device.read(1)
    device.close()
