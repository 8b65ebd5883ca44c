"""The choice of impedance and filter by the loop's time, how slowly it follows, and impedances by frame number."""

from itertools import pairwise
from math import exp

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.line import line_in_use
from cogrip.protocol.line.line_in_use import ImpedanceChanges, LoopFollower
from cogrip.protocol.line.loop_meter import LoopMeter
from cogrip.protocol.settings import line_tuning
from cogrip.protocol.settings.line_tuning import bounded, corner_hz, filter_lag_s, flat_s, tuning
from cogrip.protocol.settings.types import Prefer

FRAME_S, FRAMES = 1.0 / 128.0, 8
loops = st.floats(1e-3, 32.0)
prefers = st.sampled_from(["light", "balanced", "stiff"])


@given(loops, prefers, st.floats(0.01, 1e6))
def test_a_line_is_no_heavier_and_no_stiffer_than_asked(loop_s: float, prefer: Prefer, carried: float) -> None:
    b, lag_s = tuning(loop_s, prefer, carried)
    assert line_tuning.LEAST_NSPM <= b <= line_tuning.MOST_NSPM
    if b > line_tuning.LEAST_NSPM:
        assert 0.5 * b * loop_s <= line_tuning.MASS_KG[prefer] * (1.0 + 1e-12)
        assert b <= carried * (1.0 + 1e-12)
        assert prefer == "stiff" or b <= line_tuning.USUAL_NSPM
    assert 0.0 <= lag_s <= max(line_tuning.LAG_S, line_tuning.SHARE * loop_s)
    assert (lag_s > 0.0) == (loop_s > line_tuning.LONG_S)


@given(st.floats(1e-3, 32.0), st.floats(1.0, 2.0), prefers)
def test_a_longer_line_has_no_more_impedance_and_no_shorter_filter(loop_s: float, times: float, prefer: Prefer) -> None:
    short, long = tuning(loop_s, prefer, 30.0), tuning(times * loop_s, prefer, 30.0)
    assert long.impedance_nspm <= short.impedance_nspm * (1.0 + 1e-12)
    assert long.filter_lag_s >= short.filter_lag_s * (1.0 - 1e-12)


@pytest.mark.parametrize(("prefer", "flat"), [("light", 0.05), ("balanced", 0.18), ("stiff", line_tuning.LONG_S)])
def test_short_lines_are_as_the_defaults_have_them(prefer: Prefer, flat: float) -> None:
    assert flat_s(prefer) == pytest.approx(flat)
    for loop_s in (1e-3, 0.5 * flat, flat * (1.0 - 1e-9)):
        assert tuning(loop_s, prefer) == (line_tuning.USUAL_NSPM, 0.0)
    assert tuning(flat * 1.001, prefer, 20.0) != (line_tuning.USUAL_NSPM, 0.0)


@pytest.mark.parametrize(
    ("asked", "had"), [(0.999, 1.0), (1.0, 1.0), (60.0, 60.0), (60.1, 60.0), (1e4, 60.0), (1e-3, 1.0)]
)
def test_what_a_seat_may_choose_is_bounded(asked: float, had: float) -> None:
    assert bounded(asked) == had


@given(st.floats(1e-3, 1e3))
def test_corner_and_lag_are_each_others(corner: float) -> None:
    assert corner_hz(filter_lag_s(corner)) == pytest.approx(corner)
    assert corner_hz(0.0) == filter_lag_s(0.0) == 0.0


def metered(frames: int) -> LoopMeter:
    meter = LoopMeter(128)
    for _ in range(128):
        meter.add(frames)
    return meter


def followed(begins_s: float, frames: int, seconds: float) -> list[float]:
    """Return the loops that a line goes by while its meter says `frames`."""
    follower, meter = LoopFollower(begins_s, "light", FRAME_S, FRAMES), metered(frames)
    found = [follower.loop_s]
    for _ in range(round(seconds / FRAME_S / FRAMES)):
        follower.update(meter)
        found.append(follower.loop_s)
    return found


@given(st.floats(0.05, 3.0), st.integers(7, 400))
def test_the_loop_is_followed_slowly_and_to_the_end(begins_s: float, frames: int) -> None:
    found, most = followed(begins_s, frames, 30.0), exp(FRAMES * FRAME_S / line_in_use.FOLLOW_S)
    for before, after in pairwise(found):
        assert 1.0 / most <= after / before * (1.0 + 1e-12)
        assert after / before <= most * (1.0 + 1e-12)
    assert abs(found[-1] - frames * FRAME_S) <= line_in_use.NEW * max(begins_s, frames * FRAME_S)


@pytest.mark.parametrize(("share", "follows"), [(0.99, False), (1.01, True)])
def test_a_loop_that_is_hardly_another_changes_nothing(share: float, follows: bool) -> None:
    frames = 100
    found = followed(frames * FRAME_S / (1.0 + share * line_in_use.NEW), frames, 10.0)
    assert (found[-1] > found[0]) == follows


def test_readings_that_do_not_agree_and_a_meter_that_is_not_full_change_nothing() -> None:
    follower, few = LoopFollower(0.3, "light", FRAME_S, FRAMES), LoopMeter(128)
    for number in range(400):
        follower.update(metered((60, 90)[number // 4 % 2]))
    for _ in range(100):
        few.add(90)
        follower.update(few)
    assert follower.loop_s == 0.3


@given(
    st.lists(st.tuples(st.integers(0, 200), st.floats(1.0, 60.0)), max_size=line_in_use.KEPT),
    st.lists(st.integers(-1, 300)),
)
def test_a_frame_has_the_newest_impedance_that_holds_for_it(changes: list[tuple[int, float]], asked: list[int]) -> None:
    known, newest, kept = ImpedanceChanges(20.0), -1, {-1: 20.0}
    for number, b in changes:
        known.add(number, b)
        if number > newest:
            newest, kept[number] = number, b
    for number in sorted(asked):
        assert known.at(number) == kept[max(each for each in kept if each <= max(number, -1))]


def test_whatever_is_said_little_is_kept() -> None:
    known = ImpedanceChanges(20.0)
    for number in range(10 * line_in_use.KEPT):
        known.add(10**6 + number, 5.0)
    assert len(known._coming) == line_in_use.KEPT
    assert known.at(10**6 - 1) == 20.0
