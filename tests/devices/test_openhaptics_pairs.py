"""`openhaptics:`: two devices on one servo, which has one current device and one stack of errors."""

import ctypes

import pytest

from cogrip.devices.device import DeviceError

from tests.devices.openhaptics_bench import RATE_HZ, make


def test_two_devices_come_and_go_while_the_servo_runs(bench) -> None:
    left = bench.opened(1)
    bench.step()
    right = bench.opened(2)
    bench.move(1, 1.0, 0.0, 0.0)
    bench.move(2, 2.0, 0.0, 0.0)
    left.write((1.0, 0.0, 0.0))
    right.write((2.0, 0.0, 0.0))
    bench.step()
    assert (left.read(1).position_m[1], right.read(1).position_m[1]) == pytest.approx((0.001, 0.002))
    assert (bench.force(1)[2], bench.force(2)[2]) == (-1.0, -2.0)
    left.close()
    bench.step(2)
    assert bench.force(1) == (0.0, 0.0, 0.0)
    assert bench.force(2)[2] == -2.0
    assert right.read(2) is not None
    left.open(RATE_HZ)
    bench.step()
    assert left.read(0) is not None
    right.close()
    left.close()
    assert [line for line in bench.journal() if line in ("start", "stop")] == ["start", "stop"]


@pytest.mark.parametrize("servo_first", [False, True])
def test_a_second_device_that_cannot_be_had_does_not_hurt_the_first(bench, servo_first) -> None:
    """The library files the error under the device that was current, which is the first one, whoever takes it."""
    left = bench.opened(1)
    left.write((1.0, 0.0, 0.0))
    bench.lib.stub_round_at_init(servo_first)
    with pytest.raises(DeviceError, match="Nobody: is not to be had: No such device"):
        make(f"openhaptics:Nobody?library={bench.path}").open(RATE_HZ)
    bench.step()
    assert left.read(1) is not None
    assert bench.force(1) == (0.0, 0.0, -1.0)
    assert left.counts == {}
    left.close()


def test_a_second_device_is_asked_and_enabled_itself(bench) -> None:
    """Frames of the first one go on while the second is opened, and make the first one current again."""
    left = bench.opened(1)
    bench.lib.stub_model(2, b"PHANTOM Omni", ctypes.c_double(2.0), ctypes.c_double(0.5), ctypes.c_double(0.5))
    bench.lib.stub_calibration(2, 0x5001, 4, 1)
    bench.lib.stub_round_at_init(1)
    right = bench.opened(2, keys="&model=omni")
    assert right.capability.peak_force_n == 2.0
    assert "update calibration Right Device 4" in bench.journal()
    assert "enable Right Device" in bench.journal()
    left.close()
    right.close()


def test_a_frame_that_another_device_was_made_current_in_is_not_used(bench) -> None:
    left, right = bench.opened(1), bench.opened(2)
    bench.move(1, 1.0, 1.0, 1.0)
    bench.move(2, 2.0, 2.0, 2.0)
    bench.step()
    assert left.read(1) is not None
    left.write((1.0, 0.0, 0.0))
    bench.lib.stub_steal_current(2)
    bench.step()
    assert left.read(2) is None
    assert bench.force(1) == bench.force(2) == (0.0, 0.0, 0.0)
    assert left.counts == {"another device was current": 1}
    bench.step()
    assert left.read(3).position_m == pytest.approx((0.001,) * 3)
    assert bench.force(1) == (0.0, 0.0, -1.0)
    left.close()
    right.close()
