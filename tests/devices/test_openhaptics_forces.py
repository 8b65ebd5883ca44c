"""`openhaptics:`: samples and forces of one device, round by round of the library's scheduler."""

import ctypes
from math import hypot, inf, nan

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cogrip.devices.conformance import CHECKS, Subject
from cogrip.devices.device import DeviceError
from cogrip.devices.openhaptics.mailbox import HOLD_FRAMES, to_library

from tests.devices.moved_evenly import ends_softly, forces_over_a_jump
from tests.devices.openhaptics_bench import RATE_HZ


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_samples_and_forces_on_fewer_axes(bench, axes) -> None:
    device = bench.opened(axes=axes)
    assert device.capability.axes == axes == len(device.capability.workspace_m)
    bench.move(0, 10.0, -20.0, 30.0)
    bench.step()
    sample = device.read(1)
    assert sample.position_m == pytest.approx((0.030, 0.010, -0.020)[:axes])
    assert (sample.velocity_mps, sample.age_ticks) == (None, device.capability.latency_ticks)
    device.write((0.5, 1.0, -1.5)[:axes])
    bench.step()
    want = (0.5, 1.0, -1.5)[:axes] + (0.0,) * (3 - axes)
    assert bench.force() == tuple(-f for f in to_library(want))
    device.close()


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


@given(force=st.tuples(*[st.floats(-100.0, 100.0)] * 3))
@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_force_is_limited_and_keeps_its_direction(bench, force) -> None:
    device = bench.opened()
    counted = device.counts.get("force limited", 0)
    acting = device.write(force)
    bench.step()
    fraction = min(1.0, 3.3 / max(hypot(*force), 1e-300))
    sent = [-fraction * part for part in force]
    assert bench.force() == pytest.approx(to_library(sent), abs=1e-12)
    assert (acting or force) == pytest.approx([-part for part in sent], abs=1e-12)
    assert device.counts.get("force limited", 0) - counted == (hypot(*force) > 3.3)
    device.close()


@pytest.mark.parametrize(
    "bad", [(nan, 0.0, 0.0), (0.0, inf, 0.0), (0.0, 0.0, -inf), (1.7e308,) * 3, (1.0, 1.0), (1.0,) * 4]
)
def test_a_force_that_is_none_makes_it_zero(bench, bad) -> None:
    device = bench.opened()
    device.write((1.0, 1.0, 1.0))
    bench.step()
    assert bench.force() == (-1.0, -1.0, -1.0)
    with pytest.raises(DeviceError, match="axes" if len(bad) != 3 else "not finite"):
        device.write(bad)
    bench.step()
    assert bench.force() == (0.0, 0.0, 0.0)
    device.write((0.0, 0.0, 1.0))
    bench.step()
    assert bench.force() == (0.0, -1.0, 0.0)
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


@pytest.mark.parametrize("axes", [1, 2, 3])
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_it_keeps_what_every_device_promises(bench, check, axes) -> None:
    def acting(_) -> tuple[float, ...]:
        right, up, near = bench.force()
        return (-near, -right, -up)[:axes]

    def pace(_) -> None:
        bench.step()

    check(Subject(lambda: bench.device(0, axes), RATE_HZ, pace, acting))


@pytest.mark.parametrize("model", ["touch", "premium1.5"])
@pytest.mark.parametrize("jump_m", [0.03, -0.03])
def test_a_jump_of_30_mm_is_no_kick(bench, model, jump_m) -> None:
    def move(x_m: float) -> None:
        bench.move(0, 0.0, 0.0, 1e3 * x_m)
        bench.step()

    if model != "touch":
        bench.lib.stub_model(0, b"Phantom Premium 1.5", *map(ctypes.c_double, (8.5, 1.4, 3.5)))
    client, forces = forces_over_a_jump(bench.device(0, 1), move, jump_m)
    ends_softly(client, forces)
