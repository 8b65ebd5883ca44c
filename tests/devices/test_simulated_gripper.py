"""`sim:gripper`: an arm with a gripper that has force, held by fingers; and who may take the seat that asks for one."""

from dataclasses import replace
from math import inf, nan

import pytest

from cogrip.devices.device import DeviceError, Gripper
from cogrip.devices.for_user import first_axes, make_for
from cogrip.devices.registry import axes_of, make
from cogrip.protocol.settings.sections import User

from tests.devices.held_device import RATE_HZ, hold, opened

ADDRESS = "sim:gripper?hand=hold&squeeze_m=0.005&squeeze_s=0.1&fingers_s=0.2&hold_s=1"
"""Fingers that close, which the conformance suite holds too."""


def openings(address: str, force_n: float, ticks: int) -> list[float]:
    samples = hold(opened(address, axes=4), ticks, (0.0, 0.0, 0.0, force_n))
    return [sample.position_m[3] for sample in samples]


def test_fingers_close_and_open_again() -> None:
    first, *closed = openings(ADDRESS, 0.0, 2000)
    assert first == pytest.approx(0.025, abs=1e-5)
    assert (closed[900], closed[-1]) == pytest.approx((0.005, 0.025), abs=1e-4)


@pytest.mark.parametrize("force_n", [-3.0, -20.0])
def test_a_force_opens_the_fingers_by_what_they_give_way(force_n: float) -> None:
    """Below 0 it loads fingers that close; it saturates at the peak, and ends at the stop."""
    last = openings(f"{ADDRESS}&grip_friction_n=0&grip_damping_nspm=20", force_n, 900)[-1]
    assert last == pytest.approx(0.005 + min(8.0, -force_n) / 500.0, abs=1e-3)


def test_the_arm_alone_is_a_phantom() -> None:
    record = make("sim:gripper", axes=3).capability
    assert record == replace(make("sim:phantom", axes=3).capability, model="gripper")
    assert axes_of("sim:gripper") == 4
    assert make("sim:gripper", axes=4).capability.first(3).gripper is None


@pytest.mark.parametrize(
    "name", ["peak_force_n", "continuous_force_n", "damping_nspm", "slew_nps", "speed_mps", "apparent_mass_kg"]
)
@pytest.mark.parametrize("value", [0.0, -1.0, nan, inf, 1e7])
def test_every_limit_of_a_gripper_is_finite(name: str, value: float) -> None:
    gripper = make("sim:gripper", axes=4).capability.gripper
    assert isinstance(gripper, Gripper)
    with pytest.raises(DeviceError, match=r"gripper: "):
        replace(gripper, **{name: value})


def test_a_record_has_a_gripper_or_another_number_of_axes() -> None:
    record = make("sim:gripper", axes=4).capability
    for wrong in ({"gripper": None}, {"grip_m": None}, {"axes": 3}):
        with pytest.raises(DeviceError, match="4 axes need a gripper's record and grip_m"):
            replace(record, **wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("device", ["sim:phantom", "sim:freeflyer"])
def test_a_device_without_force_on_its_gripper_does_not_take_the_seat(device: str) -> None:
    with pytest.raises(DeviceError):
        make_for(User(device=device, tool="pinch"), 4)


def test_in_a_seat_of_places_the_opening_is_a_newest_value() -> None:
    """As of any gripper without force: three axes, no force on the fingers, the opening beside them."""
    device = first_axes(make(ADDRESS, axes=4), 3)
    record = device.capability
    assert (record.axes, record.gripper, record.grip_m) == (3, None, (0.0, 0.03))
    device.open(RATE_HZ)
    sample = hold(device, 400, (0.0, 0.0, 1.0))[-1]
    assert len(sample.position_m) == 3
    assert sample.grip_m == pytest.approx(0.005, abs=1e-4)
