"""A replayed person is a device like all others; one of a CSV file passes through every row, at the time that stands there."""

import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.devices import make
from cogrip.protocol.settings import resolve
from cogrip.sim.runs.laboratory_run import run_laboratory

from tests.devices.replayed_hands import RATE_HZ, TICKS, played

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"


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


@pytest.mark.parametrize(("origin", "off"), [("start", 1.0), ("keep", 0.0)])
def test_a_table_shows_its_own_samples(table: Path, origin: str, off: float) -> None:
    """1024 Hz is four ticks a row; `start` plays the motion from where the device is."""
    shown = played(f"replay:{table}#time=t_s&x=x_mm&y=y_mm&scale=0.001&origin={origin}", 4 * 299 + 1, axes=3)
    rows = np.loadtxt(table, delimiter=",", skiprows=1)[:, 1:] * 1e-3
    assert shown[::4, :2] == pytest.approx(rows - off * rows[0], abs=1e-12)
    assert np.all(shown[:, 2] == 0.0), "an axis without a column does not move"
    assert np.abs(np.diff(shown[:, 1])).max() < 0.006, "monotone between the samples"


def test_a_real_hand_is_played_as_it_was_measured() -> None:
    path = DATA / "tue_1dof_PP_kp8.csv"
    if not path.exists():
        pytest.skip(f"../shared/data/{path.name} is not here")
    with path.open() as lines:
        angle = np.array([float(row["theta_m_rad"]) for row in csv.DictReader(lines) if row["run"] == "spring"])
    address = f"replay:{path}#time=t_s&x=theta_m_rad&scale=0.075&where=run:spring&origin=keep"
    assert played(address, len(angle), rate_hz=2000)[:, 0] == pytest.approx(0.075 * angle, abs=1e-9)


@given(st.integers(2, 4000))
def test_the_last_row_of_a_table_is_played(tmp_path_factory: pytest.TempPathFactory, rows: int) -> None:
    path = tmp_path_factory.mktemp("last") / "hand.csv"
    path.write_text(f"t,x\n0,0\n{(rows - 1) / 1000},1\n")
    device = make(f"replay:{path}#time=t&x=x")
    device.open(1000)
    end = device.read(rows - 1)
    assert end.position_m[0] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("speed", [1, 2])
def test_a_replay_presses_what_was_pressed(tmp_path: Path, speed: int) -> None:
    """At the recorded ticks, at the speed of the play-back; and no more once it is over."""
    users = [{"name": "anna", "device": "sim:phantom?press=2@0.1+0.2", "hand": "hold"}]
    run_laboratory(resolve({"seconds": 0.5, "users": users}), tmp_path)
    device = make(f"replay:{tmp_path}#user=anna&speed={speed}", axes=1)
    assert device.capability.buttons == 2
    device.open(1024)
    held = []
    for tick in range(600):
        sample = device.read(tick)
        held.append(sample.buttons if sample else 0)
        device.write((0.0,))
    first, last = round(0.1 * 1024), round(0.3 * 1024)
    assert [tick for tick, buttons in enumerate(held) if buttons] == [
        tick for tick in range(512 // speed) if first <= tick * speed < last
    ]
    assert set(held) == {0, 2}
