"""A replayed person is a device like all others: it promises, refuses and ends as they do."""

from math import inf, nan
from pathlib import Path

import numpy as np
import pytest

from cogrip.devices import Capability, DeviceError, Sample, make

from tests.devices.replayed_hands import RATE_HZ, TICKS, played


@pytest.fixture(params=["run", "run at another speed", "table"])
def address(request: pytest.FixtureRequest, run: Path, table: Path) -> str:
    found: dict[str, str] = {
        "run": f"replay:{run}#user=ben",
        "run at another speed": f"replay:{run}#user=anna&speed=0.3&loop=1&start_s=0.2",
        "table": f"replay:{table}#time=t_s&x=x_mm&y=y_mm&scale=0.001",
    }
    return found[request.param]


def test_capability_is_there_before_opening_and_makes_sense(address: str) -> None:
    record = make(address, axes=2).capability
    assert isinstance(record, Capability)
    assert record.axes == 2 == len(record.workspace_m)
    assert all(low < high for low, high in record.workspace_m)
    assert 0.0 < record.continuous_force_n <= record.peak_force_n < inf
    for limit in (record.stiffness_npm, record.damping_nspm, record.slew_nps, record.speed_mps):
        assert limit > 0.0
    assert record.resolution_m >= 0.0
    assert record.apparent_mass_kg > 0.0
    assert record.rate_hz >= RATE_HZ


def test_the_motion_stays_inside_the_workspace_of_the_record(address: str) -> None:
    device = make(address, axes=2)
    shown = played(address, 3 * TICKS, axes=2)
    for axis, (low, high) in enumerate(device.capability.workspace_m):
        assert low < shown[:, axis].min() <= shown[:, axis].max() < high


def test_closed_device_refuses_and_says_what_to_do(address: str) -> None:
    device = make(address, axes=2)
    device.close()
    for _ in range(2):
        with pytest.raises(DeviceError, match="call open"):
            device.read(0)
        with pytest.raises(DeviceError, match="call open"):
            device.write((0.0, 0.0))
        device.open(RATE_HZ)
        device.close()
        device.close()


def test_samples_have_the_stated_shape_at_every_tick(address: str) -> None:
    device = make(address, axes=2)
    device.open(RATE_HZ)
    for tick in (*range(20), 25, 100, 100, 10_000):
        sample = device.read(tick)
        assert isinstance(sample, Sample)
        assert len(sample.position_m) == 2
        assert (sample.velocity_mps is not None) == device.capability.gives_velocity
        if sample.velocity_mps is not None:
            assert len(sample.velocity_mps) == 2
        device.write((0.1, 0.1))


def test_bad_calls_are_errors_and_leave_the_device_working(address: str) -> None:
    device = make(address, axes=2)
    for rate_hz in (0, -1, device.capability.rate_hz + 1):
        with pytest.raises(DeviceError, match=f"rate_hz={rate_hz}"):
            device.open(rate_hz)
    device.open(RATE_HZ)
    with pytest.raises(DeviceError, match="open already"):
        device.open(RATE_HZ)
    device.read(5)
    with pytest.raises(DeviceError, match="tick=4"):
        device.read(4)
    for few_or_many in ((0.0,), (0.0,) * 3):
        with pytest.raises(DeviceError, match="axes"):
            device.write(few_or_many)
    device.write((1.0, 2.0))
    for bad in (nan, inf, -inf):
        with pytest.raises(DeviceError, match="not finite"):
            device.write((0.0, bad))
    assert device.force_n == (1.0, 2.0)  # type: ignore[attr-defined]
    assert device.read(6) is not None


def test_the_same_samples_again_after_reopening_whatever_the_force(address: str) -> None:
    first = played(address, 2000, axes=2)
    device = make(address, axes=2)
    for force in (0.0, 20.0):
        device.open(RATE_HZ)
        rows = []
        for tick in range(2000):
            sample = device.read(tick)
            assert sample is not None
            rows.append(sample.position_m)
            device.write((force, -force))
        device.close()
        assert np.array_equal(rows, first)


def test_close_writes_zero_force(address: str) -> None:
    device = make(address, axes=2)
    device.open(RATE_HZ)
    device.write((1.0, 1.0))
    device.close()
    assert device.force_n == (0.0, 0.0)  # type: ignore[attr-defined]


def test_a_replay_has_played_out_at_its_last_sample_and_a_loop_never(run: Path) -> None:
    for keys, tick in (("", TICKS - 1), ("&stop_s=0.5", RATE_HZ // 2), ("&loop=1", None)):
        device = make(f"replay:{run}#user=ben{keys}", axes=2)
        device.open(RATE_HZ)
        over = []
        for each in range(3 * TICKS):
            device.read(each)
            if device.played_out:  # type: ignore[attr-defined]
                over.append(each)
        assert (over[0] if over else None) == (tick if tick is None else pytest.approx(tick, abs=2)), keys
