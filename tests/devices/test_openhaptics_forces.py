"""`openhaptics:`: samples and forces of one device, round by round of the library's scheduler."""

import pytest

from cogrip.devices.device import DeviceError
from cogrip.devices.openhaptics.mailbox import HOLD_FRAMES


def test_each_frame_is_read_once(bench) -> None:
    device = bench.opened()
    assert device.read(0) is None
    bench.step()
    assert device.read(1) is not None
    assert device.read(1) is None
    bench.step(3)
    assert device.read(2) is not None
    with pytest.raises(DeviceError, match="read\\(tick=1\\) after tick 2; ticks must not fall"):
        device.read(1)
    device.close()


def test_a_loop_that_stops_leaves_no_force(bench) -> None:
    device = bench.opened()
    device.write((1.0, 0.0, 0.0))
    bench.step(HOLD_FRAMES)
    assert bench.force() == (0.0, 0.0, -1.0)
    bench.step()
    assert bench.force() == (0.0, 0.0, 0.0)
    assert device.counts == {"force not renewed": 1}
    assert device.read(60) is not None
    device.close()


def test_close_sends_zero_within_a_frame_of_its_own(bench) -> None:
    device = bench.opened()
    device.write((1.0, 0.0, 0.0))
    bench.step()
    frames = bench.lib.stub_frames(0)
    device.close()
    assert bench.force() == (0.0, 0.0, 0.0)
    assert bench.lib.stub_frames(0) == frames + 1
