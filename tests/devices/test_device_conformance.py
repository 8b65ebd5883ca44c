"""Every address in the registry, with every hand, behaves as `Device` promises. Virtual time, seeded."""

from __future__ import annotations

from math import inf, nan

import pytest

from cogrip.devices import Capability, DeviceError, Sample, describe, make

RATE_HZ = 1024
HANDS = ("hold", "push", "reach&direction=1", "sine", "tremor&seed=3")
ADDRESSES = [f"{listing.address}?hand={hand}" for listing in describe() for hand in HANDS]
every_device = pytest.mark.parametrize(
    ("address", "axes"), [(address, axes) for address in ADDRESSES for axes in (1, 2, 3)]
)


@every_device
def test_capability_is_there_before_opening_and_makes_sense(address: str, axes: int) -> None:
    record = make(address, axes=axes).capability
    assert isinstance(record, Capability)
    assert record.axes == axes == len(record.workspace_m)
    assert all(low < high for low, high in record.workspace_m)
    assert 0.0 < record.continuous_force_n <= record.peak_force_n < inf
    for limit in (record.stiffness_npm, record.damping_nspm, record.slew_nps, record.speed_mps):
        assert limit > 0.0
    assert record.resolution_m >= 0.0
    assert record.apparent_mass_kg > 0.0
    assert record.rate_hz >= 1024


@every_device
def test_closed_device_refuses_and_says_what_to_do(address: str, axes: int) -> None:
    device = make(address, axes=axes)
    with pytest.raises(DeviceError, match="call open"):
        device.read(0)
    with pytest.raises(DeviceError, match="call open"):
        device.write((0.0,) * axes)
    device.close()
    device.close()
    device.open(RATE_HZ)
    device.close()
    device.close()
    with pytest.raises(DeviceError, match="call open"):
        device.read(1)


@every_device
def test_samples_have_the_stated_shape_at_every_tick(address: str, axes: int) -> None:
    device = make(address, axes=axes)
    device.open(RATE_HZ)
    for tick in [*range(20), 25, 100, 100]:
        sample = device.read(tick)
        assert isinstance(sample, Sample)
        assert len(sample.position_m) == axes
        assert (sample.velocity_mps is not None) == device.capability.gives_velocity
        if sample.velocity_mps is not None:
            assert len(sample.velocity_mps) == axes
        device.write([0.1] * axes)
    device.close()


@every_device
def test_bad_calls_are_errors_and_leave_the_device_working(address: str, axes: int) -> None:
    device = make(address, axes=axes)
    with pytest.raises(DeviceError, match="rate_hz=0"):
        device.open(0)
    with pytest.raises(DeviceError, match="rate_hz"):
        device.open(device.capability.rate_hz + 1)
    device.open(RATE_HZ)
    with pytest.raises(DeviceError, match="open already"):
        device.open(RATE_HZ)
    device.read(5)
    with pytest.raises(DeviceError, match="tick=4"):
        device.read(4)
    with pytest.raises(DeviceError, match="axes"):
        device.write((0.0,) * (axes + 1))
    for bad in (nan, inf, -inf):
        with pytest.raises(DeviceError, match="not finite"):
            device.write((bad,) * axes)
    assert device.read(6) is not None


@every_device
def test_same_calls_give_the_same_samples_again_after_reopening(address: str, axes: int) -> None:
    def run() -> list[Sample | None]:
        device.open(RATE_HZ)
        samples = []
        for tick in range(300):
            samples.append(device.read(tick))
            device.write([0.3 if tick % 50 < 20 else -0.2] * axes)
        device.close()
        return samples

    device = make(address, axes=axes)
    first = run()
    assert run() == first
    device = make(address, axes=axes)
    assert run() == first


@every_device
def test_skipped_ticks_hold_the_force(address: str, axes: int) -> None:
    """An overrun that skips ticks ends where the same force written at each of them would have."""
    slow, fast = make(address, axes=axes), make(address, axes=axes)
    for device in (slow, fast):
        device.open(RATE_HZ)
        device.read(0)
        device.write([0.5] * axes)
    for tick in range(1, 40):
        fast.read(tick)
        fast.write([0.5] * axes)
    assert slow.read(40) == fast.read(40)


@pytest.mark.parametrize("address", ADDRESSES)
def test_positive_force_moves_the_device_towards_minus_x(address: str) -> None:
    """The sign of P eq. 9: m x'' = F_hand - F."""
    loaded, free = make(address), make(address)
    for device, force in ((loaded, 2.0), (free, 0.0)):
        device.open(RATE_HZ)
        device.read(0)
        device.write([force])
    low, high = loaded.read(100), free.read(100)
    assert low is not None
    assert high is not None
    assert low.position_m[0] < high.position_m[0] - 1e-3


@pytest.mark.parametrize("listing", describe(), ids=lambda listing: listing.address)
def test_close_writes_zero_force(listing) -> None:
    device = make(listing.address)
    device.open(RATE_HZ)
    device.write([1.0])
    assert device.force_n == (1.0,)
    device.close()
    assert device.force_n == (0.0,)
