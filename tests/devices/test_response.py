"""A device that is pushed by small forces: each thing that may be wrong with it is named, and nothing where nothing is."""

from itertools import product

import pytest

from cogrip.devices.conformance import DeviceSubject, UnfitDeviceError, moves_as_its_record_says
from cogrip.devices.device import Device
from cogrip.devices.registry import make
from cogrip.devices.response import MOST_N, MOST_SHARE, faults, respond

from tests.devices.faulty_device import FAULTS, MOTOR_GAIN, POSITION_GAIN, POSITION_SIGN, SIGN, SWAP, FaultyDevice
from tests.extent import every

RATE_HZ = 1024
ARMS = ("sim:phantom", "sim:ideal", "emulated:vintage", "emulated:woodenhaptics", "emulated:inverse3", "emulated:2diy")
HANDS = ("hold", "hold&hand_stiffness_npm=0&hand_damping_nspm=0", "hold&hand_stiffness_npm=60&hand_damping_nspm=1")
WORDS = {
    SIGN: "x: it moves against its force: the sign of its motor or of its position there is wrong",
    POSITION_SIGN: "x: it moves against its force: the sign of its motor or of its position there is wrong",
    SWAP: "x: a push along it moves the device along y: these axes are swapped",
    MOTOR_GAIN: "its motor gain or position gain is too large, or its record's mass",
    POSITION_GAIN: "its motor gain or position gain is too large, or its record's mass",
}


def at_once(tick: int) -> int:
    return tick


def opened(arm: str, hand: str = "hold", fault: str = "", late_ticks: int = 0) -> Device:
    axes = 2 if arm.endswith("2diy") else 3
    device = FaultyDevice(make(f"{arm}?hand={hand}", axes=axes), fault, late_ticks)
    device.open(RATE_HZ)
    return device


@pytest.mark.sample(6)
@pytest.mark.parametrize(("arm", "hand"), list(product(ARMS, HANDS)))
def test_nothing_is_wrong_with_a_device_that_is_well(arm: str, hand: str) -> None:
    assert faults(opened(arm, hand), at_once) == []


@pytest.mark.parametrize(("arm", "hand", "fault"), every(11, product(ARMS, HANDS, FAULTS)))
def test_signs_axes_and_gains_are_named(arm: str, hand: str, fault: str) -> None:
    found = faults(opened(arm, hand, fault), at_once)
    assert WORDS[fault] in "; ".join(found)
    assert len(found) <= (1 if "sign" in fault else 3), found


@pytest.mark.parametrize(("arm", "late_ticks"), every(4, product(ARMS, range(2, 9))))
def test_samples_that_are_late_untold_are_named_with_the_ticks(arm: str, late_ticks: int) -> None:
    late = [answer.late_ticks for answer in respond(opened(arm, late_ticks=late_ticks), at_once)]
    assert any(abs(found - late_ticks) <= 1 for found in late), late


@pytest.mark.parametrize("arm", ARMS)
def test_it_is_pushed_gently_and_not_at_all_afterwards(arm: str) -> None:
    device, asked = opened(arm), []
    write = device.write
    device.write = lambda force_n: (asked.append(tuple(force_n)), write(force_n))[1]  # type: ignore[method-assign]
    faults(device, at_once)
    most = max(max(map(abs, force)) for force in asked)
    assert 0.2 <= most <= min(MOST_N, MOST_SHARE * device.capability.peak_force_n)
    assert not any(asked[-1])
    assert all(sum(map(bool, force)) <= 1 for force in asked), "an axis at a time"


def test_one_that_does_not_move_is_never_said_to_be_well() -> None:
    found = faults(opened("sim:phantom", "hold&hand_stiffness_npm=50000&hand_damping_nspm=500"), at_once)
    assert len(found) == 3
    assert all(
        "did not move under 1 N: it is held, stuck or at a stop, or its motors are off" in each for each in found
    )


def test_one_that_somebody_moves_is_never_said_to_be_well() -> None:
    found = faults(opened("sim:phantom", "tremor&tremor_m=0.003"), at_once)
    assert len(found) == 1
    assert found[0].startswith(("x: something else moved it meanwhile", "x: did not move under 1 N"))


@pytest.mark.parametrize("fault", ["", *FAULTS])
def test_the_conformance_suite_finds_each(fault: str) -> None:
    subject = DeviceSubject(lambda: FaultyDevice(make("emulated:vintage", axes=3), fault), yields=True)
    if not fault:
        moves_as_its_record_says(subject)
        return
    with pytest.raises(UnfitDeviceError, match="moves as its record says: "):
        moves_as_its_record_says(subject)
