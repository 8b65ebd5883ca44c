"""Encoders that lie are found, and hands that do not lie are left alone. Counts of every model, 1024 readings a second."""

import csv
from functools import cache, partial
from itertools import product
from math import dist, hypot, pi, sin, sqrt
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cogrip.devices.arm.encoder_watch import QUICK_COUNTS, SLACK_COUNTS, STUCK_S, EncoderWatch
from cogrip.devices.arm.models import MODELS
from cogrip.devices.plausibility import GAP_S

from tests.devices.held_device import RATE_HZ, hold, opened
from tests.extent import every

STUCK = round(STUCK_S * RATE_HZ)
GAP_TICKS = round(GAP_S * RATE_HZ)
DATA = Path(__file__).parents[3] / "shared" / "data"
NAMES = ("aluhaptics", "polhem", "vintage", "woodenhaptics")  # the others have the same joints, or coarser ones
DIRECTIONS = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
QUIET = ("hold", "reach&amplitude_m=0.04&direction=0.5,1,0.3", "tremor&direction=1,1,1")
every_model = pytest.mark.parametrize("name", NAMES)


def watch(name: str) -> EncoderWatch:
    model = MODELS[name]
    return EncoderWatch(3, model.record.resolution_m, RATE_HZ, partial(tip_at, model))


def tip_at(model, raw) -> tuple[float, float, float]:
    return model.kinematics.forward(model.drive.angles(raw))


def counts(name: str, positions) -> list[tuple[int, ...]]:
    """Return the encoders' counts; None where the arm cannot reach."""
    model = MODELS[name]
    angles = [model.kinematics.inverse(tuple(position)) for position in positions]
    return [tuple(map(round, model.drive.counts(one))) for one in angles if one is not None]


def alarms(name: str, readings) -> list[str]:
    judge = watch(name)
    return [said for said in (judge.check(reading, 1) for reading in readings) if said]


@cache
def rows(file: str) -> list[dict[str, str]]:
    path = DATA / file
    if not path.exists():
        pytest.skip(f"{path} is not there")
    with path.open() as lines:
        return list(csv.DictReader(lines))


def columns(chosen: list[dict[str, str]], *names: str) -> np.ndarray:
    return np.array([[float(row[name]) for name in names] for row in chosen])


def lever(file: str, run: str) -> np.ndarray:
    """0.075 m a radian; one axis, some centimetres."""
    chosen = [row for row in rows(file) if row["run"] == run]
    time_s, place = columns(chosen, "t_s")[:, 0], 0.075 * columns(chosen, "theta_m_rad")
    return evenly(time_s, np.hstack((place, 0.0 * place, 0.0 * place)))


def stylus() -> np.ndarray:
    """Until it is put into its dock: there it stops dead, as a joint does that has lost its encoder."""
    chosen = [row for row in rows("touch_freehand_wpi_100hz.csv") if float(row["t_s"]) < 25.2]
    return evenly(columns(chosen, "t_s")[:, 0], 1e-3 * columns(chosen, "pz_mm", "px_mm", "py_mm"))


def guided(rec: str) -> np.ndarray:
    """Its clock misses ticks: the true steps are those of its speeds."""
    chosen = [row for row in rows("panda_handguided_symbol17_rec0_2_4.csv") if row["rec"] == rec]
    place, speed = columns(chosen, "px_m", "py_m", "pz_m"), columns(chosen, "vx_m_s", "vy_m_s", "vz_m_s")
    speed = 0.5 * (speed[1:] + speed[:-1])
    square = (speed**2).sum(axis=1)
    steps = np.round((np.diff(place, axis=0) * speed).sum(axis=1) / np.maximum(square, 1e-9) / 1e-3)
    time_s = 1e-3 * np.cumsum(np.r_[0.0, np.where(square > 1e-4, steps.clip(1, 20), 1.0)])
    return evenly(time_s, place)


def evenly(time_s: np.ndarray, place_m: np.ndarray) -> np.ndarray:
    """1024 times a second, in the middle of the workspace and not beyond 85 mm of it."""
    from scipy.interpolate import PchipInterpolator  # half a second, not for every worker

    place_m = place_m - 0.5 * (place_m.max(axis=0) + place_m.min(axis=0))
    fraction = min(1.0, 0.085 / np.sqrt((place_m**2).sum(axis=1)).max())
    grid = np.arange(time_s[0], time_s[-1], 1.0 / RATE_HZ)
    return PchipInterpolator(time_s, fraction * place_m, axis=0)(grid)


LEVERS = {
    "tue_1dof_PF_kp15.csv": ("free", "spring", "foam2", "rigid"),
    "tue_1dof_PP_kp8.csv": ("free", "spring", "foam", "rigid"),
}
HANDS = {f"{file[9:11]} {run}": (lever, file, run) for file, runs in LEVERS.items() for run in runs}
HANDS |= {"stylus": (stylus,), **{f"guided {rec}": (guided, rec) for rec in "024"}}

hand_and_model = pytest.mark.parametrize(("hand", "name"), every(13, product(HANDS, NAMES)))  # another model each time


@cache
def recorded(hand: str) -> np.ndarray:
    read, *arguments = HANDS[hand]
    return read(*arguments)


@hand_and_model
def test_recorded_hands_are_believed(name: str, hand: str) -> None:
    positions = recorded(hand)
    for sense in DIRECTIONS:
        readings = counts(name, positions[:, sense].tolist())
        assert len(readings) > 0.6 * len(positions)
        assert alarms(name, readings) == []


SIMULATED = (
    "hold",
    "reach&amplitude_m=0.08&direction=0.3,1,0.2",
    "reach&amplitude_m=0.05&stroke_s=0.25",
    "tremor&tremor_m=0.002&direction=1,-1,0.5",
    "sine&amplitude_m=0.02&frequency_hz=5&direction=1,0.5,0",
)


@pytest.mark.parametrize(("hand", "name"), every(3, product(SIMULATED, NAMES)))
def test_simulated_hands_are_believed(name: str, hand: str) -> None:
    device = opened(f"sim:phantom?hand={hand}&resolution_m=0&mass_kg=0.075", axes=3)
    comes_and_goes = ((2.0, 1.0, -1.0), (-2.0, 0.0, 1.0))
    samples = hold(device, 3000, lambda tick: comes_and_goes[tick % 512 // 256])
    assert alarms(name, counts(name, [sample.position_m for sample in samples])) == []


@every_model
@pytest.mark.parametrize("speed_mps", [0.05, 0.3, 1.4])
@pytest.mark.parametrize("rebound", [0.0, 0.15])
def test_a_hand_that_flies_into_an_end_stop_has_not_jumped(name: str, speed_mps: float, rebound: float) -> None:
    """It stops within one reading, at 50 to 1400 m/s^2; then it goes along the stop, or a little way back."""
    positions, x, v = [], -0.04, speed_mps
    for tick in range(500):
        x = max(-0.04, min(0.03, x + v / RATE_HZ))
        if x == 0.03:
            v = -rebound * speed_mps
        positions.append((x, 0.02 * sin(0.01 * tick), 0.01))
    assert [text for text in alarms(name, counts(name, positions)) if "jumped" in text] == []


def shaken(name: str, acceleration_mps2: float, amplitude_m: float, centre, direction) -> list[tuple[int, ...]]:
    amplitude_m = min(amplitude_m, 1.4**2 / acceleration_mps2)  # no faster than 1.4 m/s
    omega = sqrt(acceleration_mps2 / amplitude_m)
    size = hypot(*direction)
    positions = []
    for tick in range(800):
        z = min(1.0, tick / 400)
        along = z**3 * (10.0 - 15.0 * z + 6.0 * z * z) * amplitude_m * sin(omega * tick / RATE_HZ)
        positions.append([at + along * part / size for at, part in zip(centre, direction, strict=True)])
    return counts(name, positions)


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("acceleration_mps2", "name"), every(5, product((5.0, 20.0, 50.0, 100.0, 150.0, 200.0), NAMES))
)
def test_motions_up_to_200_mps2_are_believed(name: str, acceleration_mps2: float) -> None:
    random = Random(f"{name} {acceleration_mps2}")
    for _ in range(12):
        amplitude = random.choice((0.0005, 0.002, 0.005, 0.02))
        reach = 0.7 * MODELS[name].reach_m - amplitude
        centre = [random.uniform(-0.577, 0.577) * reach for _ in range(3)]
        direction = [random.gauss(0.0, 1.0) for _ in range(3)]
        readings = shaken(name, acceleration_mps2, amplitude, centre, direction)
        assert [text for text in alarms(name, readings) if "jumped" in text] == []


@every_model
def test_motions_that_begin_in_full_flight_are_believed(name: str) -> None:
    """After `open`, and after a gap, nobody knows how fast it goes."""
    for speed_mps in (-1.4, 0.3, 1.4):
        positions = [(speed_mps * tick / RATE_HZ * 0.5, speed_mps * (tick - 30) / RATE_HZ, 0.0) for tick in range(60)]
        readings = counts(name, positions)
        assert alarms(name, readings) == []
        judge = watch(name)
        for tick, reading in enumerate(readings):
            if not 20 <= tick < 20 + GAP_TICKS:
                assert judge.check(reading, GAP_TICKS + 1 if tick == 20 + GAP_TICKS else 1) == ""


@every_model
@given(gaps=st.lists(st.integers(1, GAP_TICKS), min_size=5, max_size=60), seed=st.integers(0, 99))
@example(gaps=[1] * 60, seed=0)  # before, an encoder jumped at the first tick that was late
def test_readings_that_are_missed_or_uneven_are_no_jumps(name: str, gaps: list[int], seed: int) -> None:
    """Each is taken on time or nearly a tick late, and the last one, which comes again, says nothing."""
    judge, random = watch(name), Random(seed)
    tick = 0
    for gap in gaps:
        tick += gap
        place = 0.03 * sin(2.0 * pi * 3.0 * (tick + random.choice((0.0, 0.97))) / RATE_HZ)
        [reading] = counts(name, [(place, 0.5 * place, 0.02 - place)])
        assert judge.check(reading, gap) == ""
    assert judge.check(reading, 0) == ""


def slipped(reading, joint: int, size: int) -> list[int]:
    """The reading with one encoder so many counts off."""
    return [count + size * (number == joint) for number, count in enumerate(reading)]


@every_model
@given(
    joint=st.integers(0, 2),
    size=st.one_of(st.integers(150, 10000), st.integers(-10000, -150)),
    at=st.integers(30, 900),
    hand=st.sampled_from(QUIET),
)
@hypothesis_settings(max_examples=25)
def test_a_jump_is_found_at_once(name: str, joint: int, size: int, at: int, hand: str) -> None:
    readings = simulated(name, hand)
    judge = watch(name)
    assert [judge.check(reading, 1) for reading in readings[:at]] == [""] * at
    said = judge.check(slipped(readings[at], joint, size), 1)
    assert said.startswith(f"encoder {'abc'[joint]} jumped by ")


@cache
def simulated(name: str, hand: str) -> list[tuple[int, ...]]:
    samples = hold(opened(f"sim:phantom?hand={hand}&resolution_m=0", axes=3), 1000)
    return counts(name, [sample.position_m for sample in samples])


@every_model
def test_both_sides_of_what_counts_as_a_jump(name: str) -> None:
    """A slip of an arm at rest in the middle, on the joint that moves the tip most."""
    [still] = counts(name, [(0.0, 0.0, 0.0)])
    model = MODELS[name]
    # a t^2 / 2, and the speed is 1.5 ticks old
    reach = 250.0 / RATE_HZ**2 * 2.0 + SLACK_COUNTS * model.record.resolution_m
    middle = tip_at(model, still)
    for joint in range(3):
        moved_m = [dist(tip_at(model, slipped(still, joint, size)), middle) for size in range(1000)]
        least = next(size for size, moved in enumerate(moved_m) if moved > reach)
        for size, found in ((least - 1, False), (least + 1, True)):
            judge = watch(name)
            for _ in range(5):
                judge.check(still, 1)
            assert bool(judge.check(slipped(still, joint, size), 1)) == found
        assert moved_m[least] < 1e-3  # a millimetre at most goes by


@pytest.mark.parametrize(("silence_s", "hand", "name"), every(5, product((0.001, 0.006, 0.011), QUIET, NAMES)))
def test_a_jump_of_400_counts_in_a_silence_is_found(name: str, hand: str, silence_s: float) -> None:
    """It is a pose that is wrong by a centimetre. Before, 6 ms and the wait for a lost reply left room for 25 mm."""
    readings, gap = simulated(name, hand), round(silence_s * RATE_HZ) + 1
    for begin in range(100, 900, 50):
        for joint in range(3):
            for size in (400, -400):
                judge = watch(name)
                assert all(judge.check(reading, 1) == "" for reading in readings[begin - 30 : begin])
                assert "jumped by" in judge.check(slipped(readings[begin + gap - 1], joint, size), gap)


@hand_and_model
def test_recorded_hands_are_believed_where_readings_are_missing(name: str, hand: str) -> None:
    random, judge = Random(hand), watch(name)
    readings = counts(name, recorded(hand).tolist())
    tick = gap = 1
    while tick < len(readings):
        assert judge.check(readings[tick], gap) == ""
        gap = random.choice((1, 1, 1, 3, 7, 12, GAP_TICKS, 2 * GAP_TICKS))
        tick += gap


def sliding(name: str, speed_counts: float, joint: int, ticks: int = 200) -> list[list[float]]:
    """The joint goes at an even speed, the others at a third of it."""
    [still] = counts(name, [(0.0, 0.0, 0.0)])
    return [
        [at + round(speed_counts * (1.0 if number == joint else 0.3) * tick) for number, at in enumerate(still)]
        for tick in range(ticks)
    ]


@pytest.mark.parametrize("joint", range(3))
@pytest.mark.parametrize("speed", [2.0, 3.3, 8.0])
def test_an_encoder_that_stands_still_on_the_way_is_found_within_20_ms(joint: int, speed: float) -> None:
    judge = watch("vintage")
    readings = sliding("vintage", speed, joint)
    for tick, reading in enumerate(readings):
        if tick > 100:
            reading[joint] = readings[100][joint]
        said = judge.check(reading, 1)
        if said:
            break
    assert said == f"encoder {'abc'[joint]} is stuck"
    assert tick - 100 == STUCK  # readings, the first of which is 1 ms after the last count
    assert 1e3 * STUCK / RATE_HZ <= 20.0


@pytest.mark.parametrize(("speed", "flicker"), [(4.0, 1), (4.0, -1), (0.3, 0), (0.7 * QUICK_COUNTS, 0)])
def test_one_that_shows_a_count_or_hardly_moved_is_not_stuck(speed: float, flicker: int) -> None:
    readings = sliding("vintage", speed, 1)
    for tick, reading in enumerate(readings[101:], 101):
        reading[1] = readings[100][1] + flicker * (tick // 15 % 2)
    assert alarms("vintage", readings) == []


@pytest.mark.parametrize("milliseconds", [15, 40, 100])
def test_one_that_slows_down_and_stops_is_not_stuck(milliseconds: int) -> None:
    slowing = np.linspace(6.0, 0.0, round(1e-3 * milliseconds * RATE_HZ) + 1)[1:]
    places = np.cumsum(np.r_[[6.0] * 101, slowing, [0.0] * (299 - len(slowing))])
    assert alarms("vintage", [(0, round(place), round(0.3 * place)) for place in places]) == []


def test_after_a_gap_it_is_judged_anew() -> None:
    judge = watch("vintage")
    readings = sliding("vintage", 4.0, 1)
    for number, reading in enumerate(readings[:50] + [readings[50]] * 100):
        assert judge.check(reading, GAP_TICKS + 1 if number == 50 else 1) == ""
