"""A replayed person is a device like all others; one of a CSV file passes through every row, at the time that stands there.

Sources that cannot be replayed are named with the cure; a cut one is played as far as it goes.
"""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.devices import DeviceError, Sample, make
from cogrip.devices.registry import axes_of
from cogrip.protocol.settings.room import resolve
from cogrip.results.writing.laboratory_run import run_laboratory

from tests.devices.held_device import RATE_HZ, hold, opened
from tests.devices.replayed_hands import TICKS, Place, played, recorded, replays, write_recording


@pytest.mark.parametrize("kind", range(3))
def test_the_same_samples_come_again_inside_the_workspace_whatever_the_force(kind: int, run: Path, table: Path) -> None:
    device = opened(replays(run, table)[kind], axes=2)
    first = hold(device, 3 * TICKS)
    shown = np.array([sample.position_m for sample in first])
    for axis, (low, high) in enumerate(device.capability.workspace_m):
        assert low < shown[:, axis].min() <= shown[:, axis].max() < high
    device.close()
    device.open(RATE_HZ)
    assert hold(device, 3 * TICKS, (20.0, -20.0)) == first


def test_a_replay_has_played_out_at_its_last_sample_and_a_loop_never(run: Path) -> None:
    for keys, tick in (("", TICKS - 1), ("&stop_s=0.5", RATE_HZ // 2), ("&loop=1", None)):
        device = opened(f"replay:{run}#user=ben{keys}", axes=2)
        over = [each for each in range(3 * TICKS) if device.read(each) and device.played_out]
        assert (over[0] if over else None) == (tick if tick is None else pytest.approx(tick, abs=2)), keys


@pytest.mark.parametrize(("origin", "off"), [("start", 1.0), ("keep", 0.0)])
def test_a_table_shows_its_own_samples(table: Path, origin: str, off: float) -> None:
    """1024 Hz is four ticks a row; `start` plays the motion from where the device is."""
    shown = played(f"replay:{table}#time=t_s&x=x_mm&y=y_mm&scale=0.001&origin={origin}", 4 * 299 + 1, axes=3)
    rows = np.loadtxt(table, delimiter=",", skiprows=1)[:, 1:] * 1e-3
    assert shown[::4, :2] == pytest.approx(rows - off * rows[0], abs=1e-12)
    assert np.all(shown[:, 2] == 0.0), "an axis without a column does not move"
    assert np.abs(np.diff(shown[:, 1])).max() < 0.006, "monotone between the samples"


@given(st.integers(2, 4000))
def test_the_last_row_of_a_table_is_played(tmp_path_factory: pytest.TempPathFactory, rows: int) -> None:
    path = tmp_path_factory.mktemp("last") / "hand.csv"
    path.write_text(f"t,x\n0,0\n{(rows - 1) / 1000},1\n")
    end = opened(f"replay:{path}#time=t&x=x", rate_hz=1000).read(rows - 1)
    assert end.position_m[0] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("speed", [1, 2])
def test_a_replay_presses_what_was_pressed(tmp_path: Path, speed: int) -> None:
    """At the recorded ticks, at the speed of the play-back; and no more once it is over."""
    users = [{"name": "anna", "device": "sim:phantom?press=2@0.1+0.2", "hand": "hold"}]
    run_laboratory(resolve({"seconds": 0.5, "users": users}), tmp_path)
    device = opened(f"replay:{tmp_path}#user=anna&speed={speed}")
    assert device.capability.buttons == 2
    held = [sample.buttons if sample else 0 for sample in hold(device, 600)]
    first, last = round(0.1 * RATE_HZ), round(0.3 * RATE_HZ)
    assert held == [2 * (tick < 512 // speed and first <= tick * speed < last) for tick in range(600)]


# What cannot be played -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tail", "words"),
    [
        ("#user=cleo", r"no recording of user cleo; there is: 0 \(anna\), 1 \(ben\)"),
        ("#user=2", r"no recording of user 2; there is: 0 \(anna\), 1 \(ben\)"),
        ("#usr=1", "unknown key 'usr'; did you mean 'user'"),
        ("#sped=1", "unknown key 'sped'; did you mean 'speed'"),
        ("#speed=0", "speed: expects a number of at least 0.01; got '0'"),
        ("#speed=10.5", "speed: expects a number of at most 10; got '10.5'"),
        ("#speed=nan", "speed: expects a number.*; got 'nan'"),
        ("#start_s=-1", "start_s: expects a number of at least 0, in s; got '-1'"),
        ("#stop_s=nan", "stop_s: expects a number of at least 0, in s; got 'nan'"),
        ("#loop=perhaps", "loop: expects true or false; got 'perhaps'"),
        ("#start_s=1.5", "from 1.5 s to 1.5 s there is nothing to play; the recording is 1.500 s long"),
        ("#start_s=9", "nothing to play; the recording is 1.500 s long"),
        ("#start_s=1&stop_s=0.5", "from 1 s to 0.5 s there is nothing to play"),
        ("#stop_s=0", "from 0 s to 0 s there is nothing to play"),
        ("#user=anna&user=ben", "key 'user' is given twice"),
        ("/settings.json", "is not a recording .*name a run folder or its .mcap file"),
        ("/nowhere", "there is no such run; name a run folder or a .mcap file"),
        ("/server.mcap", "no recording of user 0; there is: nobody"),
        ("#user=²", "no recording of user ²"),
    ],
)
def test_what_cannot_be_played_is_named_with_the_cure(run: Path, tail: str, words: str) -> None:
    with pytest.raises(DeviceError, match=words):
        opened(f"replay:{run}{tail}", axes=2)


def test_stop_and_start_have_a_narrowest_side_that_plays(run: Path) -> None:
    """Both sides of "nothing to play": the last sample is at 1535 / 1024 s."""
    last_s = (TICKS - 1) / RATE_HZ
    opened(f"replay:{run}#start_s={last_s - 1e-3}", axes=2)
    with pytest.raises(DeviceError, match="nothing to play"):
        opened(f"replay:{run}#start_s={last_s}", axes=2)


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("replay:", "name a run folder, a .mcap file or a .csv file"),
        ("replay:hand.csv", "needs the key 'time'; add time="),
        ("replay:hand.csv#time=t&x=x&user=1", "unknown key 'user'"),
        ("replay:hand.csv#time=t&x=x&hand_stiffness_npm=1", "unknown key 'hand_stiffness_npm'"),
        ("replay:none.csv#time=t&x=x", "cannot read 'none.csv'"),
    ],
)
def test_bad_addresses_are_named(address: str, words: str) -> None:
    with pytest.raises(DeviceError, match=words):
        opened(address)


def test_too_many_axes_are_refused_when_made_and_when_recorded_on_fewer(run: Path) -> None:
    with pytest.raises(DeviceError, match="axes=4 is out of 1 to 3"):
        make(f"replay:{run}", axes=4)
    with pytest.raises(DeviceError, match="was recorded on 2 axes, 3 are asked for"):
        opened(f"replay:{run}", axes=3)


def test_a_device_of_three_axes_in_a_room_of_one_was_recorded_on_one(tmp_path: Path) -> None:
    """The record says 3, the samples have 1: what was not recorded cannot be played."""
    path = tmp_path / "client-anna.mcap"
    write_recording(path, [(0, [0.01]), (1, [0.02])], axes=3)
    assert axes_of(f"replay:{path}") == 1
    device = make(f"replay:{path}", axes=3)
    with pytest.raises(DeviceError, match="was recorded on 1 ax"):
        _ = device.capability
    with pytest.raises(DeviceError, match="was recorded on 1 ax"):
        device.open(RATE_HZ)
    device = opened(f"replay:{path}")
    assert device.capability.axes == 1
    assert device.read(1) == Sample((0.02,), None)


def test_an_address_says_how_many_axes_were_recorded(run: Path, table: Path) -> None:
    for address, axes in (
        (f"replay:{run}", 2),
        (f"replay:{run / 'client-ben.mcap'}#speed=2", 2),
        (f"replay:{table}#time=t_s&x=x_mm", 1),
        (f"replay:{table}#time=t_s&x=x_mm&y=y_mm", 2),
        (f"replay:{table}#time=t_s&x=x_mm&z=y_mm", 3),
        ("sim:phantom", 3),
    ):
        assert axes_of(address) == axes, address
        assert make(address, axes=axes).capability.axes == axes
    for nobody in (f"replay:{run}#user=cleo", "replay:nowhere"):
        with pytest.raises(DeviceError, match="there is"):
            axes_of(nobody)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([], "client-anna.mcap holds no ticks"),
        ([(0, None)], "holds 0 samples; a motion needs at least 2"),
        ([(0, [0.01])], "holds 1 samples; a motion needs at least 2"),
        ([(0, [0.01]), (1, None)], "holds 1 samples; a motion needs at least 2"),
    ],
)
def test_a_motion_needs_two_samples(tmp_path: Path, rows: list[tuple[int, Place]], words: str) -> None:
    path = tmp_path / "client-anna.mcap"
    write_recording(path, rows)
    with pytest.raises(DeviceError, match=words):
        opened(f"replay:{path}")


def test_what_was_cut_off_is_played_as_far_as_it_goes(run: Path, tmp_path: Path) -> None:
    whole, _ = recorded(run / "client-anna.mcap")
    data = (run / "client-anna.mcap").read_bytes()
    cut = tmp_path / "client-anna.mcap"
    cut.write_bytes(data[: len(data) // 2])
    positions, _ = recorded(cut)
    assert 100 < len(positions) < len(whole)
    assert np.array_equal(played(f"replay:{cut}", len(positions), axes=2), whole[: len(positions)])
