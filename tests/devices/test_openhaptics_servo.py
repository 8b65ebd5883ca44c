"""`openhaptics:` with the servo's own thread running: whole values, no deadlock, zero force however the process ends."""

import pytest

from cogrip.devices.conformance import CHECKS, DeviceSubject
from cogrip.devices.openhaptics.mailbox import HOLD_FRAMES

from tests.devices.openhaptics_bench import RATE_HZ
from tests.devices.vendor_bench import end_without_closing
from tests.extent import long


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_servo_keeps_what_every_device_promises(servo, check) -> None:
    """The suite runs in real time, that of the servo thread."""
    check(DeviceSubject(lambda: servo.device(0), RATE_HZ, lambda _: servo.lib.stub_wait(1)))


def test_servo_two_devices_exchange_whole_values_with_its_thread(servo) -> None:
    """Positions have three equal parts and so have the forces: a mixture of two values would show."""
    servo.lib.stub_ramp(1)
    devices = [servo.opened(1), servo.opened(2)]
    for tick in range(400):
        servo.lib.stub_wait(1 if tick % 8 == 0 else 0)  # mostly in the midst of frames
        for device in devices:
            sample = device.read(tick)
            assert sample is None or len(set(sample.position_m)) == 1
            device.write((0.001 * tick,) * 3)
    servo.lib.stub_wait(2)
    for number, device in enumerate(devices, 1):
        assert servo.lib.stub_worst(number) == pytest.approx(0.399 * 3**0.5)  # the last one has been sent
        assert servo.lib.stub_torn(number) == 0
        assert set(device.counts) <= {"force not renewed"}  # the machine may be busy
        device.close()
        assert servo.force(number) == (0.0, 0.0, 0.0)


def test_servo_drops_the_force_of_a_loop_that_hangs(servo) -> None:
    device = servo.opened()
    device.write((1.0, 0.0, 0.0))
    servo.lib.stub_wait(HOLD_FRAMES + 3)
    assert servo.force() == (0.0, 0.0, 0.0)
    assert device.counts == {"force not renewed": 1}
    device.close()


def test_servo_devices_come_and_go(servo) -> None:
    """The library's lock is held in every callback: a call from here that kept the interpreter's lock would never come back."""
    left = servo.opened(1)
    for _ in range(20):
        right = servo.opened(2)
        left.write((1.0, 0.0, 0.0))
        servo.lib.stub_wait(2)
        right.close()
    left.close()
    assert servo.lib.stub_worst(1) == 1.0
    assert set(left.counts) <= {"force not renewed"}


TELL = """
force = (ctypes.c_double * 3)()
lib.stub_force(0, force)
print([f + 0.0 for f in force], lib.stub_running(), lib.stub_wrongs())
"""


@pytest.mark.parametrize("end", ["pass", long("raise RuntimeError"), "raise KeyboardInterrupt", long("sys.exit(3)")])
def test_servo_of_a_process_that_ends_without_closing(servo, end) -> None:
    until_it_pushes = "lib.stub_wait(3)\nlib.stub_worst.restype = ctypes.c_double\nprint(lib.stub_worst(0))\n"
    said = end_without_closing(servo.address(0), servo.path, TELL, until_it_pushes + end)
    assert said == ["1.0", "[0.0, 0.0, 0.0] 0 b''"]
