"""Clock offset and one-way delays by stamps: the error is within the stated bound, and half the asymmetry of the delays."""

import heapq
from itertools import count
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.protocol.wire.clock import DRIFT_PPM, MOST_RTT_NS, Clock
from cogrip.protocol.wire.messages import Stamp

MS = 1_000_000
S = 1_000 * MS
FRAME_NS = 7_812_500
AHEAD_NS = 10**15  # the far clock is by so much ahead


def exchanged(directions: list[tuple[int, int]], ahead_ns: int = AHEAD_NS) -> Clock:
    """(there, back) one after another; the far end answers after 3 ms. The near end's clock."""
    near, far, now_ns = Clock(), Clock(), 1_000 * MS
    for there, back in directions:
        asked = near.stamp(now_ns)
        now_ns += there
        far.read(asked, now_ns + ahead_ns)
        now_ns += 3 * MS
        answer = far.stamp(now_ns + ahead_ns)
        now_ns += back
        near.read(answer, now_ns)
    return near


@pytest.mark.parametrize(("there_ms", "back_ms"), [(20, 20), (5, 45), (45, 5), (0, 30), (1, 0)])
@pytest.mark.parametrize("ahead_ns", [0, AHEAD_NS, -999 * MS])
def test_the_error_is_half_of_what_the_ways_differ_by_exactly(there_ms: int, back_ms: int, ahead_ns: int) -> None:
    clock = exchanged([(there_ms * MS, back_ms * MS)] * 20, ahead_ns)
    assert clock.offset_ns == ahead_ns + (there_ms - back_ms) * MS // 2
    assert clock.uncertainty_ns == (there_ms + back_ms) * MS // 2
    assert clock.forward_ns == clock.return_ns == (there_ms + back_ms) * MS // 2  # as far as any stamp can tell
    assert (clock.contradictions, clock.implausible) == (0, 0)


@given(st.lists(st.tuples(st.integers(0, S), st.integers(0, S)), min_size=1, max_size=20), st.integers(-S + MS, 10**15))
def test_the_truth_is_never_farther_away_than_it_says(directions: list[tuple[int, int]], ahead_ns: int) -> None:
    clock = exchanged(directions, ahead_ns)
    assert clock.offset_ns is not None
    assert clock.uncertainty_ns is not None
    assert clock.forward_ns is not None
    assert clock.return_ns is not None
    assert abs(clock.offset_ns - ahead_ns) <= clock.uncertainty_ns + 1
    there, back = directions[-1]
    assert clock.forward_ns + clock.return_ns == there + back
    assert clock.forward_ns >= 0
    assert clock.return_ns >= 0


def test_the_least_way_there_and_the_least_way_back_need_not_be_of_one_round_trip() -> None:
    clock = exchanged([(10 * MS, 90 * MS), (80 * MS, 20 * MS)])  # no round trip is below 100 ms
    assert clock.uncertainty_ns == pytest.approx(15 * MS, abs=0.2 * MS)  # of which the bound has given way a little
    assert clock.offset_ns == pytest.approx(AHEAD_NS - 5 * MS, abs=0.2 * MS)


class Ends:
    """Two ends that send once a frame, over ways with jitter; the far clock goes wrong by `ppm`."""

    def __init__(self, ppm: float, way_ms: float, jitter_ms: float, seed: int) -> None:
        self.near, self.far = Clock(), Clock()
        self.loss = self.twice = 0.0
        self.errors_ns: list[float] = []
        self._now_ns, self._ppm = 0, ppm
        self._way_ns, self._jitter_ns = way_ms * MS, jitter_ms * MS
        self._random, self._number = Random(seed), count()
        self._flight: list[tuple[int, int, bool, Stamp]] = []

    def far_ns(self, now_ns: int) -> int:
        return now_ns + AHEAD_NS + int(now_ns * self._ppm * 1e-6)

    def run(self, seconds: float) -> None:
        draw, end_ns = self._random.random, self._now_ns + int(seconds * S)
        while self._now_ns < end_ns:
            for up, stamp in (
                (True, self.near.stamp(self._now_ns)),
                (False, self.far.stamp(self.far_ns(self._now_ns))),
            ):
                for _ in range(2 if draw() < self.twice else 1):
                    if draw() >= self.loss:
                        late_ns = int(self._way_ns + self._random.expovariate(1.0) * self._jitter_ns)
                        heapq.heappush(self._flight, (self._now_ns + late_ns, next(self._number), up, stamp))
            self._now_ns += FRAME_NS
            while self._flight and self._flight[0][0] <= self._now_ns:
                came_ns, _, up, stamp = heapq.heappop(self._flight)
                if up:
                    self.far.read(stamp, self.far_ns(came_ns))
                elif self.near.read(stamp, came_ns) is not None:
                    self._check(came_ns)

    def _check(self, came_ns: int) -> None:
        assert self.near.offset_ns is not None
        assert self.near.uncertainty_ns is not None
        error_ns = self.near.offset_ns - (self.far_ns(came_ns) - came_ns)
        # the readings themselves are whole ns of a clock that drifts
        assert abs(error_ns) <= self.near.uncertainty_ns + 5_000
        self.errors_ns.append(error_ns)


@pytest.mark.parametrize("ppm", [-500, -100, 0, 100, 500])
def test_a_drift_is_followed(ppm: int) -> None:
    """10 s: a clock that is not followed would be 5 ms off at 500 ppm."""
    ends = Ends(ppm, 20.0, 2.0, 1)
    ends.run(10.0)
    late = ends.errors_ns[len(ends.errors_ns) // 2 :]
    assert max(abs(error) for error in late) < 0.6 * MS
    assert (ends.near.contradictions, ends.near.implausible) == (0, 0)
    assert ends.near.uncertainty_ns == pytest.approx(20.0 * MS, rel=0.05)


def test_a_drift_beyond_all_crystals_is_noticed_and_begun_anew() -> None:
    near = Clock()
    for now_ns in range(FRAME_NS, 20_000 * FRAME_NS, FRAME_NS):
        ahead_ns = (
            AHEAD_NS + now_ns // 1_000
        )  # 1000 ppm: the bounds meet after (1000 - 500) ppm have eaten 2 ms, in 4 s
        near.read(Stamp(now_ns - MS + ahead_ns, now_ns - 2 * MS, 0), now_ns)
    assert 20 < near.contradictions < 100
    assert near.offset_ns is not None
    assert abs(near.offset_ns - ahead_ns) <= 2 * MS


def test_an_outage_makes_it_less_certain_and_no_more() -> None:
    ends = Ends(300.0, 20.0, 1.0, 2)
    ends.run(2.0)
    before_ns = ends.near.uncertainty_ns
    ends.loss = 1.0
    ends.run(8.0)
    ends.loss = 0.0
    readings = len(ends.errors_ns)
    ends.run(0.2)
    assert len(ends.errors_ns) > readings  # each was held against what it says, there
    ends.run(3.0)
    assert before_ns is not None
    assert ends.near.uncertainty_ns == pytest.approx(before_ns, rel=0.1)


def test_loss_repetition_and_disorder_change_nothing_but_how_often_it_is_told() -> None:
    ends = Ends(100.0, 10.0, 15.0, 3)
    ends.loss, ends.twice = 0.5, 0.3
    ends.run(6.0)
    assert (ends.near.contradictions, ends.near.implausible) == (0, 0)
    assert max(abs(error) for error in ends.errors_ns[-200:]) < 3.0 * MS


def test_an_echo_tells_the_way_there_once() -> None:
    near = Clock()
    told = []
    for sent_ns, echo_ns, held_ns in ((100, 10, 0), (105, 10, 5), (110, 10, 10), (115, 20, 0), (112, 10, 12)):
        near.read(Stamp(sent_ns * MS, echo_ns * MS, held_ns * MS), (sent_ns + 50) * MS)
        told.append(near.fresh)
    assert told == [True, False, False, True, False]


def test_the_rate_of_readings_is_the_others_affair_and_the_bounds_give_way_by_the_clock() -> None:
    near = exchanged([(MS, MS)])
    for wait_ns in (1, 10, S, 10 * S):
        before_ns = near.uncertainty_ns
        now_ns = wait_ns - near.stamp(0).held_ns
        near.read(
            Stamp(now_ns + AHEAD_NS - 500 * MS, now_ns - 1_000 * MS, 0), now_ns
        )  # a slow one, which bounds nothing
        assert before_ns is not None
        assert near.uncertainty_ns == pytest.approx(before_ns + wait_ns * DRIFT_PPM * 1e-6, abs=2)


nanoseconds = st.integers(0, 2**63 - 1)


@settings(max_examples=100)
@given(
    st.lists(st.tuples(st.builds(Stamp, nanoseconds, nanoseconds, nanoseconds), st.integers(0, 10 * S)), max_size=20)
)
def test_whatever_a_peer_says_is_a_number_or_nothing(said: list[tuple[Stamp, int]]) -> None:
    """A implausible stamp is no reading: nothing of it is kept but that it was implausible."""
    clock, now_ns, implausible = Clock(), 10**12, 0
    for stamp, wait_ns in said:
        now_ns += wait_ns
        rtt_ns = clock.read(stamp, now_ns)
        assert rtt_ns is None or 0 <= rtt_ns < MOST_RTT_NS
        implausible += rtt_ns is None and stamp.echo_ns != 0
        assert clock.implausible == implausible
        if clock.offset_ns is not None:
            assert clock.uncertainty_ns is not None
            assert 0 <= clock.uncertainty_ns <= MOST_RTT_NS
            assert clock.return_ns is not None
            assert 0 <= clock.return_ns <= MOST_RTT_NS
        answer = clock.stamp(now_ns)
        assert 0 <= answer.held_ns < 2**63


@pytest.mark.parametrize("implausible", [Stamp(5, 2 * S, 0), Stamp(5, 1, 2 * S), Stamp(5, S - 1, 2**63 - 1)])
def test_an_implausible_stamp_moves_no_bound(implausible: Stamp) -> None:
    clock = exchanged([(MS, MS)] * 3)
    before = (clock.offset_ns, clock.uncertainty_ns, clock.forward_ns, clock.return_ns)
    assert clock.read(implausible, S) is None
    assert (clock.offset_ns, clock.uncertainty_ns, clock.forward_ns, clock.return_ns) == before
    assert clock.implausible == 1


def test_no_echo_is_no_round_trip_and_one_that_was_overtaken_does_not_set_it_back() -> None:
    clock = Clock()
    assert clock.stamp(5) == Stamp(5, 0, 0)
    for stamp in (Stamp(9), Stamp(8)):
        assert clock.read(stamp, 10) is None
        assert clock.stamp(15) == Stamp(15, 9, 5)
    assert clock.read(Stamp(9, 1, 0), 1 + MOST_RTT_NS) is None


def test_a_lie_that_could_be_true_is_forgotten_once_the_truth_is_told() -> None:
    clock = exchanged([(MS, MS)] * 3)
    now_ns = 2 * S
    clock.read(Stamp(now_ns + AHEAD_NS + 40 * S, now_ns - 2 * MS, 0), now_ns)  # "my clock was set by 40 s"
    assert clock.contradictions == 1
    now_ns += FRAME_NS
    clock.read(Stamp(now_ns - MS + AHEAD_NS, now_ns - 2 * MS, 0), now_ns)
    assert clock.contradictions == 2
    assert clock.offset_ns == AHEAD_NS


def test_a_clock_at_the_end_of_its_range_contradicts_nothing() -> None:
    """In 64 bits its offset has no room for the drift that is allowed for."""
    clock, now_ns = Clock(), 1_000 * MS
    clock.read(Stamp(2**63 - 1, 1, 0), now_ns)
    assert clock.read(Stamp(2**63 - 1, now_ns, 0), now_ns + MS) == MS
    assert clock.contradictions == 0
    assert (clock.forward_ns, clock.offset_ns) == (251, 2**63 - 1 - now_ns - MS + 999_749)
