"""A replayed person is a device like all others: it promises, refuses and ends as they do."""

from pathlib import Path

import numpy as np
import pytest

from cogrip.devices import make

from tests.devices.replayed_hands import RATE_HZ, TICKS, played


@pytest.fixture(params=["run", "run at another speed", "table"])
def address(request: pytest.FixtureRequest, run: Path, table: Path) -> str:
    found: dict[str, str] = {
        "run": f"replay:{run}#user=ben",
        "run at another speed": f"replay:{run}#user=anna&speed=0.3&loop=1&start_s=0.2",
        "table": f"replay:{table}#time=t_s&x=x_mm&y=y_mm&scale=0.001",
    }
    return found[request.param]


def test_the_motion_stays_inside_the_workspace_of_the_record(address: str) -> None:
    device = make(address, axes=2)
    shown = played(address, 3 * TICKS, axes=2)
    for axis, (low, high) in enumerate(device.capability.workspace_m):
        assert low < shown[:, axis].min() <= shown[:, axis].max() < high


def test_the_same_samples_again_after_reopening_whatever_the_force(address: str) -> None:
    first = played(address, 2000, axes=2)
    device = make(address, axes=2)
    for force in (0.0, 20.0):
        device.open(RATE_HZ)
        rows = []
        for tick in range(2000):
            sample = device.read(tick)
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
