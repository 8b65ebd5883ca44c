"""Sources that cannot be replayed are named with the cure; a cut one is played as far as it goes."""

from pathlib import Path

import numpy as np
import pytest

from cogrip.devices import DeviceError, Sample, make
from cogrip.devices.registry import axes_of

from tests.devices.replayed_hands import RATE_HZ, TICKS, Place, played, recorded, write_recording


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
    ],
)
def test_what_cannot_be_played_is_named_with_the_cure(run: Path, tail: str, words: str) -> None:
    with pytest.raises(DeviceError, match=words):
        make(f"replay:{run}{tail}", axes=2).open(RATE_HZ)


def test_stop_and_start_have_a_narrowest_side_that_plays(run: Path) -> None:
    """Both sides of "nothing to play": the last sample is at 1535 / 1024 s."""
    last_s = (TICKS - 1) / RATE_HZ
    make(f"replay:{run}#start_s={last_s - 1e-3}", axes=2).open(RATE_HZ)
    with pytest.raises(DeviceError, match="nothing to play"):
        make(f"replay:{run}#start_s={last_s}", axes=2).open(RATE_HZ)


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
        make(address).open(RATE_HZ)


def test_too_many_axes_are_refused_when_made_and_when_recorded_on_fewer(run: Path) -> None:
    with pytest.raises(DeviceError, match="axes=4 is out of 1 to 3"):
        make(f"replay:{run}", axes=4)
    device = make(f"replay:{run}", axes=3)
    with pytest.raises(DeviceError, match="was recorded on 2 axes, 3 are asked for"):
        device.open(RATE_HZ)


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


def test_what_a_device_of_three_axes_left_in_a_room_of_one_plays_on_one(tmp_path: Path) -> None:
    path = tmp_path / "client-anna.mcap"
    write_recording(path, [(0, [0.01]), (1, [0.02])], axes=3)
    device = make(f"replay:{path}")
    assert device.capability.axes == 1
    device.open(RATE_HZ)
    assert device.read(1) == Sample((0.02,), None)


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
        make(f"replay:{path}").open(RATE_HZ)


def test_a_digit_that_is_no_number_is_a_user_who_is_not_there(run: Path) -> None:
    with pytest.raises(DeviceError, match="no recording of user ²"):
        make(f"replay:{run}#user=²", axes=2).open(RATE_HZ)


def test_what_was_cut_off_is_played_as_far_as_it_goes(run: Path, tmp_path: Path) -> None:
    whole, _ = recorded(run / "client-anna.mcap")
    data = (run / "client-anna.mcap").read_bytes()
    cut = tmp_path / "client-anna.mcap"
    cut.write_bytes(data[: len(data) // 2])
    positions, _ = recorded(cut)
    assert 100 < len(positions) < len(whole)
    assert np.array_equal(played(f"replay:{cut}", len(positions), axes=2), whole[: len(positions)])
