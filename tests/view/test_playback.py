"""Playback by a virtual clock."""

from collections.abc import Sequence
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.view.frames import ZERO, SceneFrame
from cogrip.view.playback import LEAST_SPEED, MOST_FRAMES, MOST_SPEED, Playback
from cogrip.view.recording import CHUNK_S

RATE_HZ = 64
DURATION_S = 25.0


def frames_of(chunk: int) -> Sequence[SceneFrame]:
    numbers = range(round(chunk * CHUNK_S * RATE_HZ), round(min((chunk + 1) * CHUNK_S, DURATION_S + 1e-9) * RATE_HZ))
    return [SceneFrame(3, number, number / RATE_HZ, ZERO, ZERO, ()) for number in numbers]


@pytest.fixture
def playback() -> Playback:
    return Playback(frames_of, 3, DURATION_S)


def times(frames: Sequence[SceneFrame]) -> list[float]:
    return [frame.time_s for frame in frames]


def test_it_begins_paused_with_its_first_frame(playback: Playback) -> None:
    assert playback.status(5.0) == "paused"
    assert playback.next_s(5.0) is not None
    assert times(playback.due(5.0)) == [0.0]
    assert times(playback.due(9.0)) == []
    assert playback.next_s(9.0) is None


def test_every_frame_is_given_once_in_order(playback: Playback) -> None:
    playback.play(100.0)
    found = [frame.number for step in range(round(DURATION_S * 50) + 5) for frame in playback.due(100.0 + step / 50)]
    assert found == list(range(round(DURATION_S * RATE_HZ)))
    assert playback.status(100.0 + DURATION_S) == "ended"
    playback.play(200.0)  # anew
    assert (playback.status(200.0), times(playback.due(200.0))) == ("playing", [0.0])


def test_the_last_frames_are_asked_for_after_the_end_too(playback: Playback) -> None:
    playback.seek(24.0, 0.0)
    playback.play(0.0)
    playback.due(0.9)
    assert playback.status(1.1) == "ended"
    assert playback.next_s(1.1) is not None
    assert times(playback.due(1.1))[-1] == DURATION_S - 1 / RATE_HZ
    assert playback.next_s(1.2) is None


def test_seeking_shows_the_frame_that_was_there_then(playback: Playback) -> None:
    playback.due(0.0)
    playback.seek(12.01, 1.0)
    assert times(playback.due(1.0)) == [int(12.01 * RATE_HZ) / RATE_HZ]
    playback.seek(1e6, 2.0)
    assert times(playback.due(2.0)) == [DURATION_S - 1 / RATE_HZ]
    playback.seek(-3.0, 3.0)
    assert times(playback.due(3.0)) == [0.0]


def test_speed_changes_where_it_is(playback: Playback) -> None:
    playback.play(0.0)
    playback.set_speed(0.5, 2.0)
    assert playback.place_s(6.0) == pytest.approx(4.0)
    playback.set_speed(1e9, 6.0)
    assert playback.speed == MOST_SPEED
    playback.set_speed(1e-9, 6.0)
    assert playback.speed == LEAST_SPEED
    playback.pause(6.0)
    assert playback.place_s(60.0) == pytest.approx(4.0)


def test_a_range_is_played_again_and_again(playback: Playback) -> None:
    playback.loop((9.5, 10.5), 0.0)
    playback.play(0.0)
    found = times([frame for step in range(1, 161) for frame in playback.due(step / 64)])
    assert set(found) <= {number / RATE_HZ for number in range(608, 673)}
    assert sum(later < earlier for earlier, later in pairwise(found)) == 2
    assert playback.status(99.0) == "playing"
    playback.loop(None, 2.5)
    assert playback.place_s(3.0) == pytest.approx(10.5)


def test_chunks_are_asked_for_before_they_are_needed(playback: Playback) -> None:
    assert playback.wanted(0.0) == (0, 1)
    playback.seek(24.0, 0.0)
    assert playback.wanted(0.0) == (2,)
    playback.loop((5.0, 15.0), 0.0)
    assert playback.wanted(0.0) == (0, 1)
    playback.seek(14.0, 0.0)
    assert playback.wanted(0.0) == (1, 0)


@pytest.mark.parametrize("range_s", [(5.0, 5.0), (6.0, 5.0), (-1.0, 5.0), (5.0, 26.0), (float("nan"), 5.0)])
def test_what_cannot_be_played_is_refused(playback: Playback, range_s: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="is no range within 0 to 25 s"):
        playback.loop(range_s, 0.0)
    for speed in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="cannot be had"):
            playback.set_speed(speed, 0.0)
    with pytest.raises(ValueError, match="is no time"):
        playback.seek(float("nan"), 0.0)


ACTS = st.one_of(
    st.tuples(st.just("play")),
    st.tuples(st.just("pause")),
    st.tuples(st.just("seek"), st.floats(-10.0, 40.0)),
    st.tuples(st.just("set_speed"), st.floats(0.01, 100.0)),
    st.tuples(st.just("loop"), st.sampled_from([None, (0.0, 1.0), (9.9, 10.1), (24.0, 25.0)])),
)


@given(st.lists(st.tuples(st.floats(0.0, 3.0), ACTS), max_size=30))
def test_whatever_is_asked_it_shows_frames_up_to_its_place(acts: list[tuple[float, tuple[object, ...]]]) -> None:
    playback, now_s = Playback(frames_of, 3, DURATION_S), 0.0
    for wait_s, (verb, *arguments) in acts:
        now_s += wait_s
        getattr(playback, str(verb))(*arguments, now_s)
        place_s = playback.place_s(now_s)
        assert 0.0 <= place_s <= DURATION_S
        found = times(playback.due(now_s))
        assert len(found) <= MOST_FRAMES
        assert found == sorted(found)
        assert all(time_s <= place_s for time_s in found)
