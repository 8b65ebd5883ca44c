"""Measures of runs: known motions and forces put back into their equations."""

from math import log, pi, sqrt
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from cogrip.protocol.recording.reader import RecordingError
from cogrip.results.measures.columns import Array, PersonColumns, RunColumns, _person, read_columns
from cogrip.results.measures.goal import NO_GOAL, Goal, GoalWatch, course, unfit_goal
from cogrip.results.measures.interaction import correlate, interaction_force, lead_s, synchrony
from cogrip.results.measures.motion import (
    completion_s,
    deviation_m,
    endpoint_m,
    felt_stiffness_missing,
    felt_stiffness_npm,
    jerk_rms_mps3,
    lateral_force_n,
    mean_force_n,
    path_m,
    smoothness,
    tracking_rms_m,
)
from cogrip.results.measures.registry import MEASURES, measure

from tests.recording_files import rewrite

RATE, FRAMES = 1024, 128


def columns(value: ArrayLike) -> Array:
    found = np.asarray(value, dtype=float)
    return found[:, None] if found.ndim == 1 else found


def person(
    position_m: ArrayLike, force_n: ArrayLike | None = None, pull_n: ArrayLike | None = None, name: str = "P01"
) -> PersonColumns:
    position = columns(position_m)
    n = -(-len(position) * FRAMES // RATE)
    force = np.zeros_like(position) if force_n is None else columns(force_n)
    pull = np.zeros((n, position.shape[1])) if pull_n is None else columns(pull_n)
    return PersonColumns(name, RATE, np.arange(len(position)) / RATE, position, force, pull)


def run(
    *people: PersonColumns, object_m: ArrayLike | None = None, goal: Goal = NO_GOAL, wall_m: Array | None = None
) -> RunColumns:
    n, axes = people[0].pull_n.shape
    moved = np.zeros((n, axes)) if object_m is None else columns(object_m)
    return RunColumns(FRAMES, np.arange(n) / FRAMES, moved, people, goal, wall_m=wall_m)


T = np.arange(4 * RATE) / RATE


@pytest.mark.parametrize("axes", [1, 2])
@pytest.mark.parametrize("dwell_s", [0.0, 0.5])
def test_end_point_is_along_the_way_at_the_end_of_the_dwell(axes: int, dwell_s: float) -> None:
    """The object comes to the target's edge at 1 s, and creeps on through its middle."""
    times = np.arange(4 * FRAMES) / FRAMES
    along = np.where(times < 1.0, 0.04 * times, 0.04 + 0.02 * (times - 1.0))
    way = np.array([1.0]) if axes == 1 else np.array([0.6, -0.8])
    goal = Goal(place_m=tuple((0.05 * way).tolist()), within_m=0.0101, dwell_s=dwell_s)
    moved = run(person(np.zeros((4 * RATE, axes))), object_m=along[:, None] * way, goal=goal)
    assert moved.reached_s == pytest.approx(1.0, abs=1.0 / FRAMES)
    assert endpoint_m(moved, 0) == pytest.approx(-0.01 + 0.02 * dwell_s, abs=0.04 / FRAMES)
    far = Goal(place_m=tuple((0.5 * way).tolist()), within_m=0.01)
    assert endpoint_m(run(person(np.zeros((4 * RATE, axes))), object_m=along[:, None] * way, goal=far), 0) is None
    assert endpoint_m(run(person(np.zeros((RATE, axes)))), 0) is None


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_deviation_and_lateral_force_are_across_the_way_and_above_0_to_its_left(side: float) -> None:
    way, left = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    along, across = 0.05 * T[:, None] * way, side * np.sin(pi * T / 4.0)[:, None] * left
    start = np.array([0.02, -0.01])
    goal = Goal(place_m=tuple((0.2 * way).tolist()), within_m=0.01)
    moved = run(person(start + along + 0.01 * across, 3.0 * way + 2.0 * across), goal=goal)
    assert deviation_m(moved, 0) == pytest.approx(0.01 * side, rel=1e-3)
    assert lateral_force_n(moved, 0) == pytest.approx(2.0 * side, rel=1e-3)
    raised = np.concatenate([along + 0.01 * across, np.zeros((len(T), 1))], axis=1)
    assert deviation_m(run(person(raised), goal=goal), 0) == pytest.approx(0.01, rel=1e-3), (
        "without a side in three axes"
    )
    assert deviation_m(run(person(along + across)), 0) is None
    assert lateral_force_n(run(person(T), goal=Goal(place_m=(0.1,), within_m=0.01)), 0) is None


def test_path_is_the_way_there_and_back_and_no_encoder_step() -> None:
    sine = 0.03 * np.sin(2 * pi * 0.5 * T)
    assert path_m(run(person(sine)), 0) == pytest.approx(8 * 0.03, rel=0.01)
    counts = np.round(sine / 3e-5) * 3e-5
    assert path_m(run(person(counts)), 0) == pytest.approx(8 * 0.03, rel=0.01)
    assert path_m(run(person(np.stack([sine, sine, sine], axis=1))), 0) == pytest.approx(8 * 0.03 * sqrt(3), rel=0.01)


def test_jerk_of_a_sine_is_its_third_derivative() -> None:
    omega = 2 * pi
    found = jerk_rms_mps3(run(person(0.02 * np.sin(omega * T))), 0)
    assert found == pytest.approx(0.02 * omega**3 / sqrt(2), rel=0.03)


def test_ticks_that_were_left_out_change_no_measure() -> None:
    """A late loop skips ticks, a recorder may lose some, a device may give no sample, also at first: the hand moves on."""
    tick = np.arange(4 * RATE)
    rows = columns(0.02 * np.sin(2 * pi * T)) + columns(0.1 * T)
    rows[(tick < 3) | (tick % 700 == 5)] = np.nan
    left = tick % 512 < 500
    ticks = {
        "tick": tick[left],
        "time_s": 7.0 + T[left],
        "position_m": rows[left],
        "force_n": columns(1.0 * (tick >= 2048))[left],
    }
    end: Any = SimpleNamespace(who="P01", rate_hz=RATE, path="client-P01.mcap")
    found = _person(end, ticks, np.zeros((4 * FRAMES, 1)), 7.0)
    whole = person(0.02 * np.sin(2 * pi * T) + 0.1 * T, 1.0 * (tick >= 2048))
    assert np.allclose(found.time_s, T[3 : tick[left][-1] + 1])
    for of, rel in ((path_m, 0.01), (jerk_rms_mps3, 0.05), (mean_force_n, 0.01)):
        assert of(run(found), 0) == pytest.approx(of(run(whole), 0), rel=rel)
    with pytest.raises(RecordingError, match="no sample of P01's hand"):
        _person(end, {**ticks, "position_m": ticks["position_m"] * np.nan}, np.zeros((4 * FRAMES, 1)), 7.0)


@pytest.mark.parametrize(
    ("file", "record", "says"), [("client-ben", "tick", "no tick of ben"), ("server", "step", "no step of the room")]
)
def test_a_run_that_ended_before_somebody_held_on_is_refused(folder: Path, file: str, record: str, says: str) -> None:
    """An operator may end a session at once: recordings are there, and empty."""
    assert len(read_columns(folder).people) == 2
    rewrite(folder / f"{file}.mcap", lambda kind, message: None if kind == record else message.payload)
    with pytest.raises(RecordingError, match=says):
        read_columns(folder)


def test_smoothness_of_a_minimum_jerk_stroke_is_the_known_number() -> None:
    """With s = A (10 z^3 - 15 z^4 + 6 z^5): int jerk^2 = 720 A^2 / T^5, peak speed 1.875 A / T, so ln(720 / 1.875^2)."""
    z = T / T[-1]
    stroke = 0.1 * (10 * z**3 - 15 * z**4 + 6 * z**5)
    smooth = smoothness(run(person(stroke)), 0)
    assert smooth == pytest.approx(-log(720 / 1.875**2), abs=0.1)
    shaken = stroke + 0.0005 * np.sin(2 * pi * 8 * T)
    assert smoothness(run(person(shaken)), 0) < smooth - 2  # type: ignore[operator]
    assert smoothness(run(person(np.zeros(100))), 0) is None, "nobody moves"


def test_interaction_force_is_what_cancels() -> None:
    def force(*pulls: list[float]) -> float:
        rows = [person(np.zeros((64, len(pull))), pull_n=np.tile(pull, (8, 1))) for pull in pulls]
        found = interaction_force(run(*rows))
        assert found is not None
        return float(found[0])

    assert force([3.0], [-2.0]) == pytest.approx(2.0), "the smaller of two that pull apart"
    assert force([3.0], [2.0]) == 0.0
    assert force([3.0], [0.0]) == 0.0, "who does nothing is not pulled against"
    assert force([3.0], [-1.0], [-2.0]) == pytest.approx(3.0)
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    pulls = [np.array([3.0, 1.0]), np.array([-2.0, 0.5])]
    straight, turned = force(*[each.tolist() for each in pulls]), force(*[(turn @ each).tolist() for each in pulls])
    assert straight == pytest.approx(turned), "whatever the axes"
    assert interaction_force(run(person(np.zeros(64)))) is None, "nobody pulls against oneself"


def test_lead_is_the_lag_that_was_put_in() -> None:
    def hand(lag_s: float) -> Array:
        return columns(sum(np.sin(2 * pi * f * (T - lag_s) + f) / f for f in (0.7, 1.3, 2.9)))

    for lag in (0.0, 0.05, 0.1234, 0.3):
        both = run(person(hand(0.0)), person(hand(lag)))
        assert lead_s(both, 0) == pytest.approx(lag, abs=0.002)
        assert lead_s(both, 1) == pytest.approx(-lag, abs=0.002)
        assert synchrony(both, 0) == pytest.approx(1.0, abs=0.02)
    three = run(person(hand(0.0)), person(hand(0.1)), person(hand(0.2)))
    assert [lead_s(three, number) for number in range(3)] == [pytest.approx(x, abs=0.003) for x in (0.15, 0.0, -0.15)]
    assert synchrony(run(person(hand(0.0)), person(-hand(0.0))), 0) < 0.9  # type: ignore[operator]
    assert correlate(np.zeros((100, 1)), np.ones((100, 1)), 128) is None
    assert lead_s(run(person(hand(0.0))), 0) is None


def test_felt_stiffness_is_force_by_way_at_rest_alone() -> None:
    inside = np.concatenate([np.linspace(-0.01, 0.004, 3 * RATE), np.full(RATE, 0.004)])
    force = 700.0 * np.maximum(0.0, inside)

    def at_the_wall(position_m: Array, force_n: Array) -> float | None:
        return felt_stiffness_npm(run(person(position_m, force_n), wall_m=np.zeros(1)), 0)

    assert at_the_wall(inside, force) == pytest.approx(700.0)
    assert at_the_wall(inside[: 3 * RATE], force[: 3 * RATE]) is None, "it moves"
    assert at_the_wall(inside, 0.0 * force) is None
    for position_m, force_n, why in (
        (inside[: 3 * RATE], force[: 3 * RATE], "the hand moved by more than 0.2 mm in the last 0.1 s"),
        (inside, 0.0 * force, "the hand pressed with less than 0.05 N at the end"),
        (-inside, force, "the hand did not stand in the object at the end"),
        (inside[:10], force[:10], "shorter than 0.2 s"),
        (inside, force, None),
    ):
        told = run(person(position_m, force_n), wall_m=np.zeros(1))
        assert felt_stiffness_missing(told, 0) == why
        assert (felt_stiffness_npm(told, 0) is None) == (why is not None)
    moved = run(person(inside, force), object_m=np.full(4 * FRAMES, 0.007))
    assert felt_stiffness_npm(moved, 0) == pytest.approx(2.8 / (0.014 - 0.007)), "from where it stood to the object"


def test_tracking_error_is_the_distance_to_the_course() -> None:
    goal = Goal(track="sine&amplitude_m=0.02&frequency_hz=0.5&ramp_s=0.001")
    times = np.arange(4 * FRAMES) / FRAMES
    wanted = np.array(course(goal.track, 1, times.tolist()))
    assert wanted[FRAMES // 2, 0] == pytest.approx(0.02, rel=1e-3)
    hand = person(np.zeros(4 * RATE))
    assert tracking_rms_m(run(hand, object_m=wanted, goal=goal), 0) == pytest.approx(0.0, abs=1e-12)
    assert tracking_rms_m(run(hand, object_m=wanted + 0.003, goal=goal), 0) == pytest.approx(0.003)
    assert tracking_rms_m(run(hand, goal=goal), 0) == pytest.approx(0.02 / sqrt(2), rel=0.01)
    assert tracking_rms_m(run(hand), 0) is None


def test_goal_is_reached_when_the_object_came_to_stay() -> None:
    goal = Goal(place_m=(0.04,), within_m=0.005, dwell_s=0.1)
    watch = GoalWatch(goal)
    path = [0.0, 0.036, 0.03, 0.0351, 0.04, 0.0449, 0.04]
    seen = [watch.look(0.05 * frame, [1.0 + x]) for frame, x in enumerate(path)]
    assert seen == [False, False, False, False, False, True, True]
    assert watch.reached_s == pytest.approx(0.15), "it was left once, and is counted from when it came again"
    times = np.repeat(path, 7)[: 4 * FRAMES]
    there = run(person(np.zeros(len(times) * RATE // FRAMES)), object_m=times, goal=goal)
    assert completion_s(there, 0) == pytest.approx(there.reached_s)
    assert completion_s(run(person(np.zeros(RATE)), goal=goal), 0) is None


def test_goals_that_cannot_be_are_refused() -> None:
    assert unfit_goal(NO_GOAL, 1) == ""
    assert unfit_goal(Goal(place_m=(0.1,), within_m=0.1), 1) == ""
    assert "2 places" in unfit_goal(Goal(place_m=(0.1, 0.2), within_m=0.1), 1)
    assert "go together" in unfit_goal(Goal(place_m=(0.1,)), 1)
    assert "above 0" in unfit_goal(Goal(place_m=(0.1,), within_m=0.0), 1)
    assert "dwell_s = -1" in unfit_goal(Goal(place_m=(0.1,), within_m=0.1, dwell_s=-1.0), 1)
    assert "zigzag" in unfit_goal(Goal(track="zigzag"), 1)


def test_every_measure_has_a_number_or_none_for_a_run_of_one_tick() -> None:
    short = run(person(np.zeros(8)))
    assert set(measure(short, 0)) == {each.name for each in MEASURES}
    assert mean_force_n(run(person(np.zeros(8), np.full(8, -2.0))), 0) == 2.0
