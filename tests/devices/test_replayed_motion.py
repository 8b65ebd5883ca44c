"""Recorded people as devices: what was recorded comes out, at the tick at which it is due, whatever the force."""

from itertools import product
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.devices import Sample, make
from cogrip.protocol.settings.rates import due_ns

from tests.devices.held_device import RATE_HZ, hold, opened
from tests.devices.replayed_hands import TICKS, played, recorded, write_recording
from tests.extent import every


@pytest.mark.parametrize(("user", "file"), [("0", "anna"), ("anna", "anna"), ("1", "ben"), ("ben", "ben")])
def test_at_its_own_rate_the_samples_are_the_recorded_ones(run: Path, user: str, file: str) -> None:
    """A replayed motion is exact, by name and by number, the last sample too; after it the hand is at rest."""
    positions, velocities = recorded(run / f"client-{file}.mcap")
    device = opened(f"replay:{run}#user={user}", axes=2)
    for tick, sample in enumerate(hold(device, TICKS, (5.0, -5.0))):
        assert sample.position_m == tuple(positions[tick])
        assert sample.velocity_mps == (tuple(velocities[tick]) if file == "ben" else None)
    still = Sample(tuple(positions[-1].tolist()), (0.0, 0.0) if file == "ben" else None)
    assert device.read(TICKS) == device.read(TICKS + 1) == device.read(10 * TICKS) == still


def test_the_record_is_that_of_the_device_that_was_recorded(run: Path) -> None:
    same = attrgetter("model", "gives_velocity", "peak_force_n", "resolution_m")
    for number, address in ((0, "sim:phantom"), (1, "sim:ideal")):
        there = make(f"replay:{run}#user={number}", axes=2).capability
        assert same(there) == same(make(address, axes=2).capability)
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
    rate_hz=st.sampled_from([250, 1000, 1024, 4096, 8192]),
)
def test_speed_start_stop_and_rate_are_places_in_the_recording(
    run: Path, speed: float, start_s: float, length_s: float, rate_hz: int
) -> None:
    """Tick k shows what was recorded at start_s + k speed / rate, on a line between two samples, until stop_s."""
    stop_s = start_s + length_s
    positions, _ = recorded(run / "client-anna.mcap")
    device = opened(f"replay:{run}#user=anna&speed={speed!r}&start_s={start_s!r}&stop_s={stop_s!r}", 2, rate_hz)
    end = min(stop_s * RATE_HZ, TICKS - 1)
    grid = np.arange(TICKS)
    largest_step = np.abs(np.diff(positions, axis=0)).max(axis=0) * max(1.0, speed * RATE_HZ / rate_hz)
    for tick in (0, 1, 2, 17, 100, 333, 1000, 3000, 200_000):
        sample = device.read(tick)
        place = start_s * RATE_HZ + tick * speed * RATE_HZ / rate_hz
        expected = [np.interp(min(place, end), grid, axis) for axis in positions.T]
        if place <= end - 1e-6:
            assert sample.position_m == pytest.approx(expected, abs=1e-9)
        else:  # rests on the last tick before the end: less than a step away
            assert np.all(np.abs(np.subtract(sample.position_m, expected)) <= largest_step + 1e-12)


@pytest.mark.parametrize("speed", [0.5, 2.0])
def test_velocity_goes_with_the_speed(run: Path, speed: float) -> None:
    _, velocities = recorded(run / "client-ben.mcap")
    device = opened(f"replay:{run}#user=ben&speed={speed}", axes=2)
    for row in range(0, TICKS - 2, 2):
        sample = device.read(round(row / speed))
        assert sample.velocity_mps == tuple(velocities[row] * speed)


@pytest.fixture(scope="module")
def two_minutes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of 120 s, a micrometre a tick, of which every sixteenth was run."""
    path = tmp_path_factory.mktemp("minutes") / "long.mcap"
    write_recording(path, [(tick, [tick * 1e-6]) for tick in range(0, 120 * RATE_HZ + 1, 16)], "sim:ideal")
    return path


@pytest.mark.parametrize(("rate_hz", "speed"), [(1024, 1.0), (1000, 1.0), (4096, 1.0), (1024, 0.5), (1024, 2.0)])
def test_two_minutes_take_two_minutes(two_minutes: Path, rate_hz: int, speed: float) -> None:
    """The motion is a function of the tick, and tick k is due at k / rate: nothing can drift. To 0.1 % as promised."""
    seconds, samples = 120.0, 120 * RATE_HZ + 1
    device = opened(f"replay:{two_minutes}#speed={speed}", rate_hz=rate_hz)
    last_m = (samples - 1) * 1e-6
    tick = round(seconds / speed * rate_hz)
    early = device.read(round(0.999 * tick))
    assert early.position_m[0] == pytest.approx(0.999 * last_m, abs=1.1e-6 * max(1.0, speed * RATE_HZ / rate_hz))
    there = device.read(tick)
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


@pytest.mark.parametrize(
    ("user", "more"),
    every(3, product(("anna", "ben"), ("", "&speed=2", "&start_s=0.4&stop_s=0.9", "&speed=0.7&start_s=0.3"))),
)
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
    device = opened(f"replay:{run}#user=ben&loop=1", axes=2)
    first = device.read(0)
    device.read(TICKS)
    before = device.read(TICKS + RATE_HZ - 2)
    assert before.velocity_mps == pytest.approx((0.0, 0.0), abs=1e-5)
    assert device.read(TICKS + RATE_HZ - 1) == first
