"""Recorded people as devices: what was recorded comes out, at the tick at which it is due, whatever the force."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, nan, sin
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.recorded import client_topics, start_text
from cogrip.devices import Capability, DeviceError, Sample, make
from cogrip.devices.registry import axes_of
from cogrip.protocol.rates import due_ns
from cogrip.protocol.recording.header import Header, versions_here
from cogrip.protocol.recording.reader import open_recording
from cogrip.protocol.recording.records import Tick, kind_of
from cogrip.protocol.recording.sink import encode
from cogrip.protocol.recording.writer import RecordingWriter
from cogrip.protocol.session import make_hello
from cogrip.protocol.settings import resolve
from cogrip.sim.lab_run import run_laboratory

RATE_HZ = 1024
SECONDS = 1.5
TICKS = round(SECONDS * RATE_HZ)
DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"
Numbers = np.ndarray[Any, np.dtype[np.float64]]
Place = Sequence[float] | None


def write_recording(
    path: Path, places: Sequence[tuple[int, Place]], address: str = "sim:phantom", axes: int = 1, name: str = "anna"
) -> None:
    """A client's recording of these (tick, position), None where there was no sample; its velocity is the tick's number."""
    device = make(address, axes=axes)
    hello = make_hello(software="x", nonce=1, room="r", name=name, digest="", device=address, axes=axes, rate_hz=1e3)
    start = start_text(hello, device.capability)
    header = Header("client", name, start, RATE_HZ, 1, 0, True, versions_here(), client_topics(name))
    with path.open("wb") as file:
        writer = RecordingWriter(file, header)
        for tick, place in places:
            size = len(place) if place else axes
            row = (float(tick),) * size
            record = Tick(tick, 0, 0, tuple(place) if place else None, row, row, 0.0, 0.0, (), (), (0.0,) * size)
            writer.put(0, due_ns(0, tick, RATE_HZ), encode(record))
        writer.finish()


def recorded(path: Path) -> tuple[Numbers, Numbers]:
    """Position and velocity of every tick as the file holds them, read by nothing under test."""
    recording = open_recording(path)
    ticks = [
        msgspec.json.decode(message.payload, type=Tick)
        for message in recording.messages()
        if kind_of(recording.topics[message.topic]) == "tick"
    ]
    return np.array([tick.position_m for tick in ticks]), np.array([tick.velocity_mps for tick in ticks])


def played(address: str, ticks: int, axes: int = 1, rate_hz: int = RATE_HZ) -> Numbers:
    """Positions of so many ticks, shape (ticks, axes)."""
    device = make(address, axes=axes)
    device.open(rate_hz)
    rows = []
    for tick in range(ticks):
        sample = device.read(tick)
        assert sample is not None
        rows.append(sample.position_m)
        device.write((0.5,) * axes)
    device.close()
    return np.array(rows)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two people on two axes, one with encoders, one whose device gives velocities."""
    folder = tmp_path_factory.mktemp("run")
    table: dict[str, Any] = {
        "seconds": SECONDS,
        "object": {"axes": 2},
        "link": {"delay_ms": 10},
        "users": [
            {"name": "anna", "hand": "reach&direction=1,0.5"},
            {"name": "ben", "device": "sim:ideal", "hand": "tremor&amplitude_m=0.02&direction=1,-1&seed=4"},
        ],
    }
    run_laboratory(resolve(table), folder)
    return folder


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hand every 1/256 s, in millimetres."""
    path = tmp_path_factory.mktemp("table") / "hand.csv"
    rows = [f"{k / 256},{10 * sin(k / 20) + 3},{k % 7}" for k in range(300)]
    path.write_text("\n".join(["t_s,x_mm,y_mm", *rows]) + "\n")
    return path


# What comes out ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("user", "file"), [("0", "anna"), ("anna", "anna"), ("1", "ben"), ("ben", "ben")])
def test_at_its_own_rate_the_samples_are_the_recorded_ones(run: Path, user: str, file: str) -> None:
    """To the bit, by name and by number, the last one too; after it the hand rests."""
    positions, velocities = recorded(run / f"client-{file}.mcap")
    device = make(f"replay:{run}#user={user}", axes=2)
    device.open(RATE_HZ)
    for tick in range(TICKS):
        sample = device.read(tick)
        assert sample is not None
        assert sample.position_m == tuple(positions[tick])
        assert sample.velocity_mps == (tuple(velocities[tick]) if file == "ben" else None)
        device.write((5.0, -5.0))
    rest = Sample(tuple(positions[-1].tolist()), (0.0, 0.0) if file == "ben" else None)
    assert device.read(TICKS) == device.read(TICKS + 1) == device.read(10 * TICKS) == rest


def test_the_record_is_that_of_the_device_that_was_recorded(run: Path) -> None:
    for number, address in ((0, "sim:phantom"), (1, "sim:ideal")):
        there, original = make(f"replay:{run}#user={number}", axes=2).capability, make(address, axes=2).capability
        assert (there.model, there.gives_velocity, there.peak_force_n, there.resolution_m) == (
            original.model,
            original.gives_velocity,
            original.peak_force_n,
            original.resolution_m,
        )
        assert make(f"replay:{run}#user={number}", axes=1).capability == there.first(1)


def test_one_file_is_a_run_of_one(run: Path) -> None:
    positions, _ = recorded(run / "client-ben.mcap")
    for address in (f"replay:{run / 'client-ben.mcap'}", f"replay:{run / 'client-ben.mcap'}#user=ben"):
        assert np.array_equal(played(address, TICKS, axes=2), positions)


def test_a_name_that_is_a_number_is_a_name(tmp_path: Path) -> None:
    for name, place in (("1", 0.01), ("zoe", 0.02)):  # in the order of the files "1" sits on seat 0
        write_recording(tmp_path / f"client-{name}.mcap", [(0, [place]), (1, [place])], name=name)
    assert played(f"replay:{tmp_path}#user=1", 1)[0, 0] == 0.01
    assert played(f"replay:{tmp_path}#user=0", 1)[0, 0] == 0.01
    assert played(f"replay:{tmp_path}#user=zoe", 1)[0, 0] == 0.02


@given(
    speed=st.one_of(st.sampled_from([0.5, 1.0, 2.0]), st.floats(0.05, 10.0)),
    start_s=st.floats(0.0, 1.2),
    length_s=st.floats(0.05, 2.0),
    rate_hz=st.sampled_from([128, 1000, 1024, 4096, 8192]),
)
def test_speed_start_stop_and_rate_are_places_in_the_recording(
    run: Path, speed: float, start_s: float, length_s: float, rate_hz: int
) -> None:
    """Tick k shows what was recorded at start_s + k speed / rate, on a line between two samples, until stop_s."""
    stop_s = start_s + length_s
    positions, _ = recorded(run / "client-anna.mcap")
    device = make(f"replay:{run}#user=anna&speed={speed!r}&start_s={start_s!r}&stop_s={stop_s!r}", axes=2)
    device.open(rate_hz)
    end = min(stop_s * RATE_HZ, TICKS - 1)
    grid = np.arange(TICKS)
    largest_step = np.abs(np.diff(positions, axis=0)).max(axis=0) * max(1.0, speed * RATE_HZ / rate_hz)
    for tick in (0, 1, 2, 17, 100, 333, 1000, 3000, 200_000):
        sample = device.read(tick)
        assert sample is not None
        place = start_s * RATE_HZ + tick * speed * RATE_HZ / rate_hz
        if place <= end - 1e-6:
            expected = [np.interp(place, grid, axis) for axis in positions.T]
            assert sample.position_m == pytest.approx(expected, abs=1e-9)
        else:  # rests on the last tick before the end: less than a step away
            expected = [np.interp(end, grid, axis) for axis in positions.T]
            assert np.all(np.abs(np.subtract(sample.position_m, expected)) <= largest_step + 1e-12)


@pytest.mark.parametrize("speed", [0.5, 2.0])
def test_velocity_goes_with_the_speed(run: Path, speed: float) -> None:
    _, velocities = recorded(run / "client-ben.mcap")
    device = make(f"replay:{run}#user=ben&speed={speed}", axes=2)
    device.open(RATE_HZ)
    for row in range(0, TICKS - 2, 2):
        sample = device.read(round(row / speed))
        assert sample is not None
        assert sample.velocity_mps == tuple(velocities[row] * speed)


@pytest.mark.parametrize(("rate_hz", "speed"), [(1024, 1.0), (1000, 1.0), (4096, 1.0), (1024, 0.5), (1024, 2.0)])
def test_two_minutes_take_two_minutes(tmp_path: Path, rate_hz: int, speed: float) -> None:
    """The motion is a function of the tick, and tick k is due at k / rate: nothing can drift. To 0.1 % as promised."""
    seconds = 120.0
    samples = round(seconds * RATE_HZ) + 1
    write_recording(tmp_path / "long.mcap", [(tick, [tick * 1e-6]) for tick in range(samples)], "sim:ideal")
    device = make(f"replay:{tmp_path / 'long.mcap'}#speed={speed}")
    device.open(rate_hz)
    last_m = (samples - 1) * 1e-6
    tick = round(seconds / speed * rate_hz)
    early = device.read(round(0.999 * tick))
    assert early is not None
    assert early.position_m[0] == pytest.approx(0.999 * last_m, abs=1.1e-6 * max(1.0, speed * RATE_HZ / rate_hz))
    there = device.read(tick)
    assert there is not None
    assert there.position_m[0] == pytest.approx(last_m, abs=1e-12)
    assert there.velocity_mps == pytest.approx(((samples - 1) * speed,), rel=1e-9), "its own"
    assert device.read(tick + 1) == device.read(2 * tick) == Sample(there.position_m, (0.0,))
    assert due_ns(0, tick, rate_hz) * 1e-9 == pytest.approx(seconds / speed, rel=1e-8)


@given(
    gaps=st.lists(st.integers(1, 40), min_size=1, max_size=30),
    first=st.integers(0, 5),
    empty=st.sets(st.integers(1, 28)),
    places=st.lists(st.floats(-0.1, 0.1), min_size=31, max_size=31),
)
def test_missed_ticks_are_filled_on_a_line(
    tmp_path_factory: pytest.TempPathFactory, gaps: list[int], first: int, empty: set[int], places: list[float]
) -> None:
    """Ticks that the loop skipped, and ticks without a sample, are between their neighbours; time is kept."""
    path = tmp_path_factory.mktemp("holes") / "client-anna.mcap"
    ticks = [first, *(first + int(total) for total in np.cumsum(gaps))]
    rows = [
        (tick, None if number in empty and number < len(ticks) - 1 else (places[number],))
        for number, tick in enumerate(ticks)
    ]
    write_recording(path, rows, "sim:ideal")
    known = [(tick - first, place[0]) for tick, place in rows if place]
    times, values = zip(*known, strict=True)
    shown = played(f"replay:{path}", times[-1] + 1)[:, 0]
    assert np.array_equal(shown[list(times)], values)
    assert shown == pytest.approx(np.interp(np.arange(times[-1] + 1), times, values), abs=1e-15)


@pytest.mark.parametrize("more", ["", "&speed=2", "&start_s=0.4&stop_s=0.9", "&speed=0.7&start_s=0.3"])
@pytest.mark.parametrize("user", ["anna", "ben"])
def test_a_loop_goes_back_without_a_kick(run: Path, user: str, more: str) -> None:
    """The return takes a second by minimum jerk: no step is larger than the motion's own or that of the return."""
    ticks = 4 * TICKS
    once = played(f"replay:{run}#user={user}{more}", ticks, axes=2)
    looped = played(f"replay:{run}#user={user}{more}&loop=1", 2 * ticks, axes=2)
    own = np.abs(np.diff(once, axis=0)).max(axis=0)
    end = int(np.flatnonzero(np.abs(np.diff(once, axis=0)).max(axis=1) > 0.0).max()) + 1
    back = 1.875 * np.abs(once[-1] - once[0]) / RATE_HZ  # peak of minimum jerk: 15/8 of the mean speed
    assert np.all(np.abs(np.diff(looped, axis=0)).max(axis=0) <= np.maximum(own, back) + 1e-9)
    assert np.array_equal(looped[: end + 1], once[: end + 1])
    period = next(k for k in range(end + RATE_HZ - 20, len(looped) // 2) if np.array_equal(looped[k], looped[0]))
    assert end <= period - RATE_HZ + 20
    assert np.array_equal(looped[period : 2 * period], looped[:period])


def test_loop_velocity_rests_at_both_ends_of_the_return(run: Path) -> None:
    device = make(f"replay:{run}#user=ben&loop=1", axes=2)
    device.open(RATE_HZ)
    device.read(TICKS)
    before = device.read(TICKS + RATE_HZ - 2)
    again = device.read(TICKS + RATE_HZ - 1)
    assert before is not None
    assert again is not None
    assert before.velocity_mps == pytest.approx((0.0, 0.0), abs=1e-5)
    device.close()
    device.open(RATE_HZ)
    assert device.read(0) == again


# A table -------------------------------------------------------------------------------------------------------------


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
    assert end is not None
    assert end.position_m[0] == pytest.approx(1.0, abs=1e-9)


# A device like all others --------------------------------------------------------------------------------------------


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


# What cannot be played -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tail", "words"),
    [
        ("#user=cleo", r"no recording of user cleo; there is: 0 \(anna\), 1 \(ben\)"),
        ("#user=2", r"no recording of user 2; there is: 0 \(anna\), 1 \(ben\)"),
        ("#usr=1", "unknown key 'usr'; did you mean 'user'"),
        ("#sped=1", "unknown key 'sped'; did you mean 'speed'"),
        ("#speed=0", "speed='0' is not accepted.*0.01"),
        ("#speed=10.5", "speed='10.5' is not accepted.*10"),
        ("#speed=nan", "speed='nan' is not accepted"),
        ("#start_s=-1", "start_s='-1' is not accepted"),
        ("#stop_s=nan", "stop_s='nan' is not accepted"),
        ("#loop=perhaps", "loop='perhaps' is not accepted"),
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
