"""The estimators that were compared, the motions they were compared on, and the rule that chooses."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.hand.velocity import MotionObserver, memory_for

from tests.bench.__main__ import main as bench
from tests.bench.velocity_trial import hands, session
from tests.bench.velocity_trial.comparison import Found, chosen, devices, estimate, estimators, measure
from tests.bench.velocity_trial.estimators import AdaptiveWindow, Estimator, FollowingAlphaBeta
from tests.bench.velocity_trial.hands import Motion, recorded_hands, resampled

HZ = 1024
T_C = 1.0 / HZ
Q = 3e-5
DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
VINTAGE = devices()["serial:vintage"]

MAKERS: dict[str, Callable[[int], Estimator]] = {
    "window": lambda axes: AdaptiveWindow(axes, T_C, Q),
    "following": lambda axes: FollowingAlphaBeta(axes, T_C, Q),
}
GAPS = st.lists(st.integers(1, 5), min_size=200, max_size=260)


# Laws that they keep, as the client's own does ------------------------------------------------------------------------


@pytest.mark.parametrize("name", MAKERS)
@given(st.floats(-1.0, 1.0), GAPS)
def test_a_steady_speed_is_found_exactly(name: str, speed_mps: float, gaps: list[int]) -> None:
    estimator, tick, velocity = MAKERS[name](2), 0, [0.0, 0.0]
    for gap in gaps:
        tick += gap
        velocity = estimator.update((speed_mps * tick * T_C, -speed_mps * tick * T_C), gap)
    assert velocity == pytest.approx([speed_mps, -speed_mps], abs=1e-4)


@pytest.mark.parametrize("name", MAKERS)
@given(st.floats(-0.1, 0.1))
def test_rest_is_exactly_no_speed(name: str, place: float) -> None:
    estimator = MAKERS[name](1)
    assert {estimator.update((place,))[0] for _ in range(40)} == {0.0}


@given(st.lists(st.integers(-30, 30), min_size=1, max_size=80))
def test_no_estimate_of_a_window_is_outside_of_the_speeds_that_were_seen(counts: list[int]) -> None:
    estimator, place, low, high = AdaptiveWindow(1, T_C, Q), 0, 0.0, 0.0
    estimator.update((0.0,))
    for count in counts:
        place += count
        low, high = min(low, count * Q * HZ), max(high, count * Q * HZ)
        (velocity,) = estimator.update((place * Q,))
        assert low - 1e-9 <= velocity <= high + 1e-9


@pytest.mark.parametrize("name", MAKERS)
def test_a_reset_forgets(name: str) -> None:
    estimator = MAKERS[name](1)
    for tick in range(30):
        estimator.update((0.01 * tick,))
    estimator.reset()
    assert estimator.update((7.0,)) == [0.0]
    assert estimator.update((7.0,)) == [0.0]


# Motions -------------------------------------------------------------------------------------------------------------


def test_a_swing_sampled_unevenly_comes_back_with_its_velocity() -> None:
    random = np.random.default_rng(3)
    time = np.cumsum(random.uniform(0.007, 0.009, 700))
    motion = resampled("swing", time, 0.03 * np.sin(2 * np.pi * 2.0 * time), HZ)
    at = time[0] + np.arange(len(motion.position_m)) / HZ
    inner = slice(HZ // 2, -HZ // 2)
    place, speed = 0.03 * np.sin(2 * np.pi * 2.0 * at), 0.03 * 4 * np.pi * np.cos(2 * np.pi * 2.0 * at)
    assert np.abs(motion.position_m - place)[inner].max() < 2e-4
    assert np.abs(motion.velocity_mps - speed)[inner].max() < 0.02 * 0.03 * 4 * np.pi


def test_missing_ticks_of_a_counted_recording_are_found_again() -> None:
    ticks = np.array([0, 1, 2, 5, 6, 8, 9, 10])
    rows: dict[str, list[str]] = {"rec": ["0"] * len(ticks)}
    for axis, speed in zip("xyz", (0.1, -0.05, 0.0), strict=True):
        rows[f"p{axis}_m"] = [repr(float(speed * tick * 1e-3)) for tick in ticks]
        rows[f"v{axis}_m_s"] = [repr(speed)] * len(ticks)
    ((name, time, place),) = hands._panda(rows)
    assert name == "recording 0"
    np.testing.assert_allclose(time, ticks * 1e-3, atol=1e-12)
    assert place.shape == (len(ticks), 3)


def test_gaps_cut_a_recording_and_short_pieces_are_left_out() -> None:
    time = np.concatenate((np.arange(0.0, 2.0, 0.01), np.arange(3.0, 3.5, 0.01), np.arange(4.0, 6.0, 0.01)))
    assert [(cut.start, cut.stop) for cut in hands._without_gaps(time)] == [(0, 200), (250, 450)]


# Measures ------------------------------------------------------------------------------------------------------------


def swing(hz: float, seconds: float = 8.0) -> Motion:
    w, at = 2 * np.pi * hz, np.arange(int(seconds * HZ)) / HZ
    return Motion("swing", 0.02 * np.sin(w * at), 0.02 * w * np.cos(w * at))


@pytest.mark.parametrize("late", [0, 1, 3])
@pytest.mark.parametrize("memory", [0.0, 0.5, 0.6])
def test_the_measured_delay_is_the_closed_form(memory: float, late: int) -> None:
    """(1 + mu) / (1 - mu) - 1/2 + L ticks; with the hold's half tick it is the lag of the bound."""
    record = replace(VINTAGE, resolution_m=0.0, latency_ticks=late)
    found = measure("", record, lambda: MotionObserver(1, T_C, memory), [swing(1.0)], T_C, 0.0)
    assert found.delay_s / T_C == pytest.approx((1 + memory) / (1 - memory) - 0.5 + late, abs=0.1)
    assert found.noise_mps < 0.01 * found.error_mps


def test_noise_is_what_counts_make_of_it_and_grows_with_them() -> None:
    coarse, fine = (
        measure("", replace(VINTAGE, resolution_m=q), lambda: MotionObserver(1, T_C, 0.5), [swing(0.7)], T_C, 0.0)
        for q in (6e-5, 3e-5)
    )
    assert coarse.noise_mps == pytest.approx(2.0 * fine.noise_mps, rel=0.1)
    assert coarse.peak_mps <= 0.25 * 6e-5 / T_C * 1.6, "hardly more than what one count moves"


def test_an_old_sample_is_what_was_there_before() -> None:
    motion = swing(1.0, 0.5)
    young, old = (estimate(motion, lambda: MotionObserver(1, T_C, 0.0), 0.0, late) for late in (0, 2))
    np.testing.assert_allclose(old[3:], young[1:-2], rtol=1e-9, atol=1e-12)


# The choice ----------------------------------------------------------------------------------------------------------


def found(name: str, noise: float, largest: float) -> Found:
    return Found(name, 0.0, 0.0, 0.0, noise, noise, largest)


@pytest.mark.parametrize(
    ("rows", "winner"),
    [
        ([("a", 1.0, 24.9), ("b", 2.0, 25.0), ("c", 3.0, 90.0)], "b"),  # enough is enough
        ([("a", 1.0, 17.9), ("b", 2.0, 18.0), ("c", 3.0, 20.0)], "b"),  # none carries 25: 90 % of 20
        ([("a", 1.0, 17.9), ("c", 3.0, 20.0)], "c"),
    ],
)
def test_the_rule_of_choice(rows: list[tuple[str, float, float]], winner: str) -> None:
    assert chosen([found(*row) for row in rows]).estimator == winner


def test_every_device_without_velocity_is_compared_once() -> None:
    every = devices()
    keys = [(one.apparent_mass_kg, one.resolution_m, one.latency_ticks) for one in every.values()]
    assert len(set(keys)) == len(keys)
    assert {"sim:phantom", "serial:vintage", "openhaptics:touch"} <= set(every)
    assert not any(one.gives_velocity for one in every.values())


def test_a_session_at_rest_and_one_that_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """0.8 is too slow for the vintage Phantom at b = 20, its own is not; a plain difference is too loud."""
    monkeypatch.setattr(session, "_SECONDS", 2.0)
    makers = estimators(VINTAGE, T_C)
    assert session.comes_to_rest(VINTAGE, makers["client"], 20.0)
    assert not session.comes_to_rest(VINTAGE, makers["memory 0.8"], 20.0)
    assert not session.comes_to_rest(VINTAGE, makers["memory 0"], 20.0)
    assert not session.comes_to_rest(VINTAGE, makers["window 16"], 20.0)


@pytest.mark.long
def test_on_a_real_hand_the_client_is_near_the_best_of_its_kind() -> None:
    """Recorded on a Touch, seen by the vintage Phantom's encoders: less noise than faster ones, less delay than slower."""
    name = "touch_freehand_wpi_100hz.csv"
    if not (DATA / name).is_file():
        pytest.skip(f"../shared/data/{name} is not here")
    motions = recorded_hands(DATA, HZ, (name,))
    assert [len(motion.position_m) // HZ for motion in motions] == [27, 27, 27]
    rows: dict[str, Any] = {}
    for memory in (0.0, 0.4, memory_for(VINTAGE, T_C), 0.6, 0.8):
        rows[f"{memory:.2f}"] = measure(
            "", VINTAGE, lambda memory=memory: MotionObserver(1, T_C, memory), motions, T_C, 0.0
        )
    noises = [row.noise_mps for row in rows.values()]
    assert noises == sorted(noises, reverse=True)
    own = rows["0.50"]
    assert own.force_n(own.noise_mps) < 0.05
    assert own.force_n(own.peak_mps) < 0.175
    assert own.delay_s == pytest.approx(3.4e-3, abs=0.2e-3)


def test_the_bench_says_what_is_missing(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert bench(["velocity", "--data", str(tmp_path)]) == 2
    assert "tue_1dof_PP_kp8.csv is not here" in capsys.readouterr().err
    assert bench(["velocity", "--device", "sim:fantom"]) == 2
    assert "--device sim:fantom: is none of sim:phantom" in capsys.readouterr().err
