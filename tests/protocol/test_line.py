"""A wave line over a network that loses, duplicates, delays and reorders: no frame plays twice, no energy is made."""

import gc
import tracemalloc
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import sin
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.protocol.line import receiver as line
from cogrip.protocol.line.concealment import COMPENSATION_LIMIT, CONCEALMENTS, FADE
from cogrip.protocol.line.jitter_buffer import REALIGN_WINDOW
from cogrip.protocol.line.receiver import LineReceiver
from cogrip.protocol.line.sender import Frame, LineSender
from cogrip.protocol.settings.delays import Frames
from cogrip.protocol.settings.types import Concealed

FRAME_S = 1.0 / 128.0
TOLERANCE = 1e-12


class HoldLast(LineReceiver):
    """A receiver that holds the last wave in a gap, as most implementations do."""

    def _fill(self, late: Frame | None, silent: bool, part: float) -> Frame:
        return self._last


@dataclass
class CheckedLine:
    """A sender and a receiver with the true energy of every frame. delay: playout delay, or "auto"."""

    axes: int = 1
    delay: Frames = 2
    redundancy: int = 4
    credit_j: float = 0.0
    kind: type[LineReceiver] = LineReceiver
    concealment: Concealed = "elastic"
    sent: list[Frame] = field(default_factory=list)
    played: list[Frame] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.sender = LineSender(self.axes, self.redundancy)
        self.receiver = self.kind(self.axes, self.delay, FRAME_S, self.credit_j, self.concealment)
        self._sent_squares: list[Frame] = [(0.0,) * self.axes]
        self.played_squares = [0.0] * self.axes
        self.worst = 0.0  # the largest excess of played over sent squares, the credit apart

    def send(self, wave: Frame) -> tuple[int, Frame, Frame, Frame]:
        self.sender.push(wave)
        self.sent.append(wave)
        before = self._sent_squares[-1]
        self._sent_squares.append(tuple(a + b * b for a, b in zip(before, wave, strict=True)))
        return self.sender.contents()

    def pop(self, frames: int = 1) -> Frame:
        wave = self.receiver.pop(frames)
        self.played.append(wave)
        allowed = self._sent_squares[min(self.receiver.acknowledged, len(self.sent))]
        for axis, value in enumerate(wave):
            self.played_squares[axis] += value * value
            excess = self.played_squares[axis] - allowed[axis]
            self.worst = max(self.worst, excess / max(1.0, allowed[axis]))
        return wave

    def step(self, wave: Frame, arrives: object = True) -> Frame:
        """Send a wave, take it in where it arrives, and pop."""
        contents = self.send(wave)
        if arrives:
            assert self.receiver.receive(*contents)
        return self.pop()

    @property
    def credit(self) -> float:
        """Energy credit of one axis [W]."""
        return self.credit_j / (0.5 * FRAME_S) / self.axes

    def check(self) -> None:
        assert self.worst <= self.credit + TOLERANCE
        count = self.receiver.count()
        assert count.sent == count.applied + count.late + count.lost
        assert count.sent <= min(self.receiver.acknowledged, len(self.sent)), "what was never made is never counted"
        if count.pending:
            assert count.sent == self.receiver.acknowledged
        assert min(count.applied, count.late, count.lost, count.pending, count.duplicate) >= 0
        assert count.applied + count.late <= count.received <= count.sent + count.pending
        if self.receiver.acknowledged:
            assert count.sent + count.pending <= len(self.sent)
        joules = 0.5 * FRAME_S * sum(self.played_squares)
        assert self.receiver.played_j == pytest.approx(joules, rel=1e-9, abs=1e-15)

    def deficit(self, axis: int = 0) -> float:
        return sum(frame[axis] for frame in self.sent) - sum(frame[axis] for frame in self.played)


@dataclass(frozen=True)
class Conditions:
    """A link in ticks of a tenth of a frame, and two loops that may miss frames or drift."""

    loss: float = 0.0
    burst: float = 1.0
    duplicate: float = 0.0
    delay: int = 5
    jitter: int = 0
    first_extra: int = 0
    skip: float = 0.0  # of the receiver's pops
    sender_period: float = 10.0
    receiver_period: float = 10.0


def drive(checked: CheckedLine, conditions: Conditions, waves: Iterator[Frame], frames: int, seed: int) -> None:
    """Run the line for `frames` receiver frames."""
    random = Random(seed)
    flight: list[tuple[float, int, tuple[int, Frame, Frame, Frame]]] = []
    number, lost, missed = 0, False, 0
    for k in range(frames):
        now = k * conditions.receiver_period + 0.5
        while number * conditions.sender_period <= now:
            contents = checked.send(next(waves))
            in_burst = lost and conditions.burst > 1.0
            lost = random.random() < (1.0 - 1.0 / conditions.burst if in_burst else conditions.loss)
            copies = 0 if lost else 1 + (random.random() < conditions.duplicate)
            for _ in range(copies):
                extra = random.randint(0, conditions.jitter) + (conditions.first_extra if not number else 0)
                flight.append((number * conditions.sender_period + conditions.delay + extra, number, contents))
            number += 1
        for arrival in sorted(one for one in flight if one[0] <= now):
            flight.remove(arrival)
            assert checked.receiver.receive(*arrival[2])
        if random.random() < conditions.skip:
            missed += 1
        else:
            checked.pop(1 + missed)
            missed = 0


def noise(axes: int, seed: int) -> Iterator[Frame]:
    """Yield waves that are hard on the ledger: jumps of all sizes, pauses, changes of sign."""
    random = Random(seed)
    while True:
        size = random.choice((0.0, 1e-3, 0.3, 5.0))
        for _ in range(random.randint(1, 12)):
            yield tuple(random.gauss(size * random.choice((-1, 1)), 0.2 * size) for _ in range(axes))


def hand(axes: int, seed: int) -> Iterator[Frame]:
    """Yield smooth waves, as a hand makes them."""
    number = 0
    while True:
        yield tuple(0.5 * sin(0.05 * number + axis + seed) for axis in range(axes))
        number += 1


networks = st.builds(
    Conditions,
    loss=st.sampled_from([0.0, 0.05, 0.3, 0.6]),
    burst=st.sampled_from([1.0, 4.0, 20.0]),
    duplicate=st.sampled_from([0.0, 0.3]),
    delay=st.integers(0, 60),
    jitter=st.sampled_from([0, 5, 40, 120]),
    first_extra=st.sampled_from([0, 50]),
    skip=st.sampled_from([0.0, 0.1, 0.5]),
    sender_period=st.sampled_from([9.7, 10.0, 10.3]),
)
lines = st.builds(
    CheckedLine,
    axes=st.integers(1, 3),
    delay=st.integers(0, 12) | st.just("auto"),
    redundancy=st.integers(1, 8),
    credit_j=st.sampled_from([0.0, 1e-3]),
    concealment=st.sampled_from(sorted(CONCEALMENTS)),
)


@settings(max_examples=200, deadline=None)
@given(lines, networks, st.sampled_from([noise, hand]), st.integers(0, 2**32))
def test_no_link_creates_energy_or_loses_count(
    checked: CheckedLine, conditions: Conditions, signal: type, seed: int
) -> None:
    drive(checked, conditions, signal(checked.axes, seed), frames=300, seed=seed)
    checked.check()


@pytest.mark.parametrize("seed", range(8))
def test_every_frame_plays_at_most_once_and_in_order(seed: int) -> None:
    checked = CheckedLine(delay=3, redundancy=3, concealment="zero")  # what it plays is a frame or 0
    conditions = Conditions(loss=0.3, burst=3.0, duplicate=0.5, jitter=60, skip=0.1, sender_period=9.9)
    drive(checked, conditions, ((float(number),) for number in range(1, 10**6)), frames=600, seed=seed)
    played = [wave[0] for wave in checked.played if wave[0]]
    assert played == sorted(set(played))
    assert len(played) == checked.receiver.count().applied
    assert checked.receiver.count().late > 0
    assert checked.receiver.count().lost > 0


@pytest.mark.parametrize(("delay", "name"), [(0, "zero"), (1, "repaid"), (4, "tank"), (2, "elastic")])
def test_a_clean_link_is_a_pure_delay(delay: int, name: Concealed) -> None:
    checked = CheckedLine(axes=2, delay=delay, redundancy=8, concealment=name)
    drive(checked, Conditions(delay=0), hand(2, 0), frames=200, seed=0)
    assert checked.played == [(0.0, 0.0)] * delay + checked.sent[: 200 - delay]
    count = checked.receiver.count()
    assert (count.applied, count.late, count.lost, count.duplicate) == (200 - delay, 0, 0, 0)
    assert count.pending == delay
    assert checked.receiver.gain == 1.0


def test_redundancy_repairs_every_gap_shorter_than_itself_within_the_playout_delay() -> None:
    checked = CheckedLine(delay=3, redundancy=4, concealment="tank")
    waves = hand(1, 0)
    for number in range(200):
        checked.step(next(waves), number % 4 == 3)  # three datagrams of four are lost
    count = checked.receiver.count()
    assert (count.late, count.lost) == (0, 0)
    assert [wave for wave in checked.played if any(wave)] == [wave for wave in checked.sent[:197] if any(wave)]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("credit_j", [0.0, 1e-3])
def test_the_deficit_is_compensated_when_the_waves_go_quiet(seed: int, credit_j: float) -> None:
    checked = CheckedLine(delay=2, redundancy=2, credit_j=credit_j)
    waves = hand(1, seed)
    drive(checked, Conditions(loss=0.3, burst=4.0, jitter=20), waves, frames=400, seed=seed)
    deficit = abs(checked.deficit())
    for _ in range(500):
        checked.step((0.0,))
    checked.check()
    assert checked.receiver.count().lost > 50
    assert abs(checked.deficit()) < 0.01 * max(1.0, deficit)


@pytest.mark.sample(1)
@pytest.mark.parametrize(("sender_period", "drift"), [(9.95, 20), (10.05, -20)], ids=["sender fast", "sender slow"])
def test_a_drifting_clock_is_followed_without_energy(sender_period: float, drift: int) -> None:
    """Half a percent of drift is 20 frames in 4000: the playout moves as many frames, and stays near D."""
    checked = CheckedLine(delay=2, redundancy=4)
    drive(checked, Conditions(sender_period=sender_period), noise(1, 7), frames=4000, seed=1)
    checked.check()
    assert len(checked.sent) - 4000 == pytest.approx(drift, abs=1)
    account = checked.receiver.playout_account()
    assert account.repeated + account.skipped == pytest.approx(20, abs=3)
    assert checked.delay - 1 <= len(checked.sent) - checked.receiver.acknowledged <= checked.delay + 2
    count = checked.receiver.count()
    assert count.applied >= 0.99 * count.sent


def test_steady_clocks_are_left_alone() -> None:
    checked = CheckedLine(delay=4, redundancy=4)
    drive(checked, Conditions(jitter=30), hand(1, 0), frames=3000, seed=3)
    account = checked.receiver.playout_account()
    assert (account.repeated, account.skipped) == (0, 0)


def test_a_first_datagram_that_came_late_is_put_right() -> None:
    """A late first datagram sets the playout delay five frames too long; later windows bring it back to D, one frame each."""
    checked = CheckedLine(delay=2, redundancy=1)
    conditions = Conditions(delay=5, first_extra=50)
    drive(checked, conditions, hand(1, 0), frames=100, seed=0)
    late_start = len(checked.sent) - checked.receiver.acknowledged
    checked.check()
    for _ in range(8 * REALIGN_WINDOW):
        checked.step((0.25,))
    checked.check()
    assert len(checked.sent) - checked.receiver.acknowledged == checked.delay <= late_start
    assert checked.receiver.count().sent == checked.receiver.acknowledged


def test_the_playout_begins_with_the_newest_frame_of_the_first_border() -> None:
    """Frames sent before the receiver began are lost; their deficit is known and compensated as slowly as any."""
    checked = CheckedLine(delay=1, redundancy=2, concealment="repaid")
    for _ in range(40):
        contents = checked.send((0.5,))
    checked.receiver.receive(*contents)
    assert checked.pop() == (0.5 + COMPENSATION_LIMIT,)  # frame 38 of 0 to 39
    assert (checked.receiver.acknowledged, checked.receiver.count().lost) == (39, 38)
    for _ in range(2000):
        checked.step((0.0,))
    checked.check()
    assert checked.deficit() == pytest.approx(0.0, abs=1e-6)


def test_holding_the_last_wave_creates_energy_where_the_line_does_not() -> None:
    """Reason not to fill a gap with the last wave (theory 3.5)."""
    worst = {}
    for kind in (LineReceiver, HoldLast):
        checked = CheckedLine(delay=2, redundancy=2, kind=kind)
        waves = ((value,) for value in [1.0] * 20 + [0.0] * 10**6)
        for number in range(60):
            checked.step(next(waves), not 18 <= number < 40)  # the hand stops while nothing comes through
        worst[kind] = checked.worst
    assert worst[LineReceiver] <= TOLERANCE
    assert worst[HoldLast] > 0.5


def test_a_tank_lets_the_last_wave_fade_and_no_more() -> None:
    checked = CheckedLine(delay=0, redundancy=1, credit_j=0.5 * FRAME_S, concealment="tank")  # 1 W
    for _ in range(10):
        checked.step((1.0,))
    gap = []
    for _ in range(30):
        checked.send((0.0,))
        gap.append(checked.pop()[0])
    assert gap[0] == FADE
    assert sum(value * value for value in gap) == pytest.approx(1.0)
    assert gap == sorted(gap, reverse=True)
    checked.check()


def test_passed_over_frames_are_late_or_lost_and_their_deficit_is_known() -> None:
    checked = CheckedLine(delay=4, redundancy=8)
    for _ in range(5):
        checked.receiver.receive(*checked.send((0.5,)))
    assert checked.pop() == (0.5,)
    assert checked.pop(frames=4) == (0.5,)
    count = checked.receiver.count()
    assert (count.sent, count.applied, count.late, count.lost) == (5, 2, 3, 0)
    for _ in range(600):
        checked.step((0.0,))
    assert checked.deficit() == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(
    ("first", "waves", "total", "square"),
    [
        (0, (0.1,), (0.0, 0.0), (0.0, 0.0)),  # half a frame
        (0, (), (0.0, 0.0), (0.0, 0.0)),
        (0, (0.1, 0.2), (0.0,), (0.0, 0.0)),
        (0, (0.1, 0.2), (0.0, 0.0), (0.0, 0.0, 0.0)),
        (line.FURTHEST_JUMP + 1, (0.1, 0.2), (0.0, 0.0), (0.0, 0.0)),
    ],
)
def test_contents_of_another_line_change_nothing(first: int, waves: Frame, total: Frame, square: Frame) -> None:
    receiver = LineReceiver(2, 0, FRAME_S)
    assert not receiver.receive(first, waves, total, square)
    assert receiver.pop() == (0.0, 0.0)
    assert receiver.count() == LineReceiver(2, 0, FRAME_S).count()


def test_jumps_are_measured_from_the_playout_so_that_they_cannot_add_up() -> None:
    receiver = LineReceiver(1, 0, FRAME_S)
    far, ahead = line.FURTHEST_JUMP, line.HISTORY
    assert not receiver.receive(far + 1, (0.1,), (0.0,), (0.0,))
    assert receiver.receive(far, (0.1,), (0.0,), (0.0,))
    assert receiver.receive(far + ahead, (0.1,), (0.0,), (0.0,))
    for outside in (far + ahead + 1, far - ahead - 1):
        assert not receiver.receive(outside, (0.1,), (0.0,), (0.0,))
    receiver.pop()  # frame `far + ahead`
    assert receiver.receive(far + 2 * ahead + 1, (0.1,), (0.0,), (0.0,))
    assert not receiver.receive(far + 2 * ahead + 2, (0.1,), (0.0,), (0.0,))


def test_a_datagram_has_no_more_frames_than_the_largest_redundancy() -> None:
    receiver = LineReceiver(1, 0, FRAME_S)
    assert not receiver.receive(0, (0.1,) * (line.MOST_FRAMES + 1), (0.0,), (0.0,))
    assert receiver.receive(0, (0.1,) * line.MOST_FRAMES, (0.0,), (0.0,))


def test_metadata_come_with_the_frame_they_belong_to() -> None:
    sender, receiver = LineSender(1, 2), LineReceiver(1, 1, FRAME_S)
    metadata = []
    for number in range(6):
        sender.push((0.1,))
        if number != 3:
            receiver.receive(*sender.contents(), (float(number), 2.0 * number, number))
        receiver.pop()
        popped = receiver.metadata
        metadata.append(popped and (popped.made_j, popped.port_j, popped.acknowledged))
    assert metadata == [None, (0.0, 0.0, 0), (1.0, 2.0, 1), (2.0, 4.0, 2), None, (4.0, 8.0, 4)]


@pytest.mark.long
@pytest.mark.parametrize("loss", [0.0, 0.1])
def test_a_line_takes_no_more_memory_as_it_grows_old(loss: float) -> None:
    """Totals that were settled are needed no more; of frames whose totals have not come HISTORY are kept."""
    random, sender, receiver = Random(1), LineSender(3, 1), LineReceiver(3, 2, 1.0 / 128, 1e-3)

    def held_after(frames: int) -> int:
        for wave, _ in zip(noise(3, 1), range(frames), strict=False):
            sender.push(wave)
            if random.random() >= loss:
                receiver.receive(*sender.contents())
            receiver.pop()
        gc.collect()
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        young = held_after(300)
        assert held_after(3000) - young < 20_000
    finally:
        tracemalloc.stop()
