"""`forcedimension:` and `openhaptics:` alike, each on a stand-in for its vendor's library: axes, forces, jumps, addresses."""

from itertools import chain, pairwise, product
from math import hypot, inf, nan

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cogrip.client.inputs import DeviceOpened
from cogrip.client.supervised_device import SupervisedDevice
from cogrip.devices.conformance import CHECKS, Subject
from cogrip.devices.device import DeviceError
from cogrip.devices.registry import make
from cogrip.protocol.settings.rates import due_ns

from tests.client.seated_client import DEVICE_HZ, Client, M
from tests.devices.vendor_bench import VendorBench
from tests.extent import every

SPEED_MPS = 0.05  # 1 N on a damper of 20 N s/m
JUMP_TICK, TICKS = 500, 700
STILL = (0.0, 0.0, 0.0)
VENDORS = {"forcedimension": "sdk", "openhaptics": "bench"}


@pytest.fixture(params=VENDORS)
def vendor(request: pytest.FixtureRequest):
    """The library in the test's hands."""
    return request.getfixturevalue(VENDORS[request.param])


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_samples_and_forces_on_fewer_axes(vendor, axes: int) -> None:
    """A force F loads the hand along the axes in which positions are told."""
    device = vendor.flowing(axes=axes)
    assert device.capability.axes == axes == len(device.capability.workspace_m)
    vendor.place(0.030, 0.010, -0.020)
    vendor.step()
    sample = device.read(10)
    assert sample.position_m == pytest.approx((0.030, 0.010, -0.020)[:axes])
    assert (sample.velocity_mps, sample.age_ticks) == (None, device.capability.latency_ticks)
    device.write((0.5, 1.0, -1.5)[:axes])
    vendor.step()
    assert vendor.load() == (0.5, 1.0, -1.5)[:axes] + (0.0,) * (3 - axes)
    device.close()
    assert vendor.load() == STILL


@given(force=st.tuples(*[st.floats(-100.0, 100.0)] * 3))
@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
def test_force_is_limited_and_keeps_its_direction(vendor, force) -> None:
    device = vendor.flowing()
    counted, most = device.counts.get("force limited", 0), device.capability.peak_force_n
    acting = device.write(force)
    vendor.step()
    fraction = min(1.0, most / max(hypot(*force), 1e-300))
    assert vendor.load() == pytest.approx([fraction * part for part in force], abs=1e-12)
    assert (acting or force) == pytest.approx(vendor.load(), abs=1e-12)
    assert device.counts.get("force limited", 0) - counted == (hypot(*force) > most)
    device.close()


@pytest.mark.parametrize(
    "bad", [(nan, 0.0, 0.0), (0.0, inf, 0.0), (0.0, 0.0, -inf), (1.7e308,) * 3, (1.0, 1.0), (1.0,) * 4]
)
def test_a_force_that_is_none_makes_it_zero(vendor, bad) -> None:
    device = vendor.flowing()
    for force in ((1.0, 1.0, 1.0), bad, (0.0, 0.0, 1.0)):
        if force is bad:
            with pytest.raises(DeviceError, match="axes" if len(bad) != 3 else "not finite"):
                device.write(bad)
        else:
            device.write(force)
        vendor.step()
        assert vendor.load() == (STILL if force is bad else force)
    device.close()


@pytest.mark.parametrize("bad", [(nan, 0.0, 0.0), (0.0, -inf, 0.0)])
def test_position_that_is_no_number_is_no_sample_and_no_force(vendor, bad) -> None:
    device = vendor.flowing()
    for tick, place in enumerate((STILL, bad, (0.01, 0.02, 0.03)), 10):
        device.write((1.0, 0.0, 0.0))
        vendor.place(*place)
        vendor.step()
        sample = device.read(tick)
        if place is bad:
            assert sample is None
            assert vendor.load() == STILL
            assert device.counts == {"position not finite": 1}
        else:
            assert sample.position_m == pytest.approx(place)
    device.write((1.0, 0.0, 0.0))
    vendor.step()
    assert vendor.load() == (1.0, 0.0, 0.0)
    device.close()


@pytest.mark.parametrize(
    ("check", "axes"), every(2, product(CHECKS, (1, 2, 3))), ids=lambda value: getattr(value, "__name__", None)
)
def test_it_keeps_what_every_device_promises(vendor, check, axes: int) -> None:
    rate_hz = 1000  # both servos'
    check(Subject(lambda: vendor.device(0, axes), rate_hz, lambda _: vendor.step(), lambda _: vendor.load(axes)))


def forces_over_a_jump(vendor: VendorBench, keys: str, jump_m: float) -> tuple[Client, list[float]]:
    """The forces that a client of one axis asks the device for, tick by tick."""
    client, forces, device = Client(impedance_nspm=20.0), [], vendor.device(0, 1, keys)
    handle = SupervisedDevice(device, client.core, DEVICE_HZ)

    def move(x_m: float) -> None:
        vendor.place(x_m, 0.0, 0.0)
        vendor.step()

    move(-0.02)
    client.core.handle(DeviceOpened(device.capability), client.core.now_ns)
    handle.open()
    for tick in range(TICKS):
        now_ns = due_ns(0, tick, DEVICE_HZ)
        move(-0.02 + SPEED_MPS * tick / DEVICE_HZ + (jump_m if tick >= JUMP_TICK else 0.0))
        if tick % M == 0 and tick:
            client.hear(now_ns)
        client.core.sense(tick, handle.read(tick), now_ns)
        handle.write(client.core.act(now_ns))
        forces.append(client.core.force_n[0])
    handle.close()
    return client, forces


@pytest.mark.parametrize(
    ("fixture", "model"), [("sdk", "omega3"), ("sdk", "delta3"), ("bench", "touch"), ("bench", "premium1.5")]
)
@pytest.mark.parametrize("jump_m", [0.03, -0.03])
def test_a_jump_of_30_mm_is_no_kick(request: pytest.FixtureRequest, fixture: str, model: str, jump_m: float) -> None:
    """Before, a step of 24 N (omega.3) or 40 N (delta.3), from one limit to the other."""
    vendor = request.getfixturevalue(fixture)
    vendor.become(model)
    client, forces = forces_over_a_jump(vendor, f"&model={model}" if fixture == "sdk" else "", jump_m)
    assert forces[JUMP_TICK - 1] > 0.8
    assert client.core.safety.state == "fault"
    assert client.core.safety.reason.startswith(("the position jumped: 29.", "the position jumped: 30."))
    assert max(abs(new - old) for old, new in pairwise(forces)) < 0.5
    assert not any(forces[JUMP_TICK + round(0.05 * DEVICE_HZ) :]), "none left within 50 ms"


def test_forces_that_the_watchdog_switched_off_come_back_by_the_ramp(sdk) -> None:
    """A loop that was away for 40 ms: before, no force for the rest of the session, and the ledger had all of it."""
    client, device = Client(), sdk.device(0, 1)
    handle = SupervisedDevice(device, client.core, DEVICE_HZ)
    client.core.handle(DeviceOpened(device.capability), client.core.now_ns)
    handle.open()
    sdk.lib.stub_wait(200)
    pushed, counted = {}, {}
    for tick in chain(range(JUMP_TICK), range(JUMP_TICK + 40, JUMP_TICK + 500)):
        now_ns = due_ns(0, tick, DEVICE_HZ)
        if tick == JUMP_TICK + 40:
            sdk.lib.stub_wait(39)
        sdk.place(-0.02 + SPEED_MPS * tick / DEVICE_HZ, 0.0, 0.0)
        if tick % M == 0 and tick:
            client.hear(now_ns)
        client.core.sense(tick, handle.read(tick), now_ns)
        handle.write(client.core.act(now_ns))
        pushed[tick], counted[tick] = sdk.load(1)[0], client.core.force_n[0]
    handle.close()
    assert client.core.safety.state == "live"
    assert client.core.safety.counts["device let go"] == 1
    assert device.counts["forces off"] == 1
    assert pushed[JUMP_TICK - 1] > 0.8
    assert pushed == counted, "the ledger has what acts"
    assert [tick for tick in pushed if tick > 10 and not pushed[tick]] == [JUMP_TICK + 40 + more for more in range(22)]
    back = [pushed[tick] for tick in range(JUMP_TICK + 62, JUMP_TICK + 500)]
    assert max(new - old for old, new in pairwise([0.0, *back])) < 0.02
    assert back[-1] > 0.8


@pytest.mark.parametrize(
    ("address", "most_n"), [("forcedimension:0?model=omega3", 12.0), ("openhaptics:x?model=touch", 3.3)]
)
def test_peak_force_key_lowers_and_never_raises(address: str, most_n: float) -> None:
    assert make(f"{address}&peak_force_n=0.5", axes=3).capability.continuous_force_n == 0.5
    assert make(f"{address}&peak_force_n=30", axes=3).capability.peak_force_n == most_n
