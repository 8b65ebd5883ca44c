"""A CSV file as a device: it passes through every row, at the time that stands there."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.devices import make

from tests.devices.replayed_hands import played

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"


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
    text = np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")
    angle = text[text["run"] == "spring"]["theta_m_rad"]
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
