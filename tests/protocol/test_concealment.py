"""Concealment: no strategy makes energy, whatever comes; the best one neither jumps nor forgets its deficit."""

from collections.abc import Iterator
from itertools import pairwise
from math import inf, sqrt

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, invariant, precondition, rule

from cogrip.protocol.line import concealment
from cogrip.protocol.line.concealment import CHARGE_FRACTION, CONCEALMENTS, ELASTIC_FADE, ELASTIC_LIMIT, Concealed
from cogrip.protocol.line.receiver import LineReceiver
from cogrip.protocol.line.sender import Frame

from tests.protocol.test_line import FRAME_S, CheckedLine

BEST: Concealed = "elastic"


class AnyOrder(RuleBasedStateMachine):
    """Any datagram, any number of times, in any order, between any pops, missed frames, and ends that write off."""

    datagrams = Bundle("datagrams")
    concealment: Concealed = BEST
    tank_j = 0.0

    def __init__(self) -> None:
        super().__init__()
        self.checked = CheckedLine(axes=2, delay=1, redundancy=2, concealment=self.concealment, tank_j=self.tank_j)

    @rule(target=datagrams, value=st.sampled_from([0.0, 1.0, -1.0, 0.25, 3.0]))
    def send(self, value: float) -> tuple[int, Frame, Frame, Frame]:
        return self.checked.send((value, -0.5 * value))

    @rule(datagram=datagrams)
    def arrive(self, datagram: tuple[int, Frame, Frame, Frame]) -> None:
        assert self.checked.receiver.receive(*datagram)

    @rule(frames=st.integers(1, 3))
    def pop(self, frames: int) -> None:
        self.checked.pop(frames)

    @rule(value=st.floats(-2.0, 2.0))
    def write_off(self, value: float) -> None:
        self.checked.receiver.write_off((value, -value))

    @precondition(lambda self: self.checked.sent)
    @rule(silent=st.integers(1, 40))
    def wait(self, silent: int) -> None:
        for _ in range(silent):
            self.checked.pop()

    @invariant()
    def nothing_is_created(self) -> None:
        self.checked.check()
        assert 0.0 <= self.checked.receiver.gain <= 1.0


class AnyOrderTank(AnyOrder):
    concealment: Concealed = "tank"
    tank_j = FRAME_S  # 2 W


for machine in (AnyOrder, AnyOrderTank):
    machine.TestCase.settings = settings(max_examples=100, stateful_step_count=60, deadline=None)
TestAnyOrder = AnyOrder.TestCase
TestAnyOrderTank = AnyOrderTank.TestCase


def outage(name: Concealed, silent: int, rest: int = 600) -> tuple[list[float], CheckedLine]:
    """Return the waves played to a hand that moves on through `silent` lost frames, after an earlier gap, and then rests."""
    checked = CheckedLine(delay=2, redundancy=4, concealment=name)
    waves = stroke()
    for number in range(260 + silent + rest):
        lost = 40 <= number < 60 or 200 <= number < 200 + silent
        checked.step((next(waves) if number < 260 + silent else 0.0,), not lost)
    checked.check()
    return [wave[0] for wave in checked.played], checked


def stroke() -> Iterator[float]:
    """Yield 0.3 sqrt(W), 0.1 m/s at b = 20, for ever."""
    while True:
        yield 0.3


def largest_step(played: list[float], end: int) -> float:
    """Return the largest step before the hand stops, which is a step of its own."""
    return max(abs(after - before) for before, after in pairwise(played[150 : end + 1]))


@pytest.mark.parametrize("silent", [8, 64])
def test_a_gap_is_entered_and_left_without_a_jump(silent: int) -> None:
    """The other strategies drop to 0 or come back at once: the test can fail."""
    steps = {name: largest_step(outage(name, silent)[0], 260 + silent) for name in CONCEALMENTS}
    assert steps["elastic"] < 0.25 * 0.3
    assert min(steps["zero"], steps["repaid"]) > 0.29
    assert steps["tank"] > 1.5 * steps["elastic"]


def test_the_deficit_is_compensated_within_seconds() -> None:
    assert abs(outage("zero", 64, rest=640)[1].deficit()) > 18.0
    played, checked = outage(BEST, 64, rest=640)
    assert abs(checked.deficit()) < 0.1
    assert max(played[400:]) <= 0.3 + ELASTIC_LIMIT + 1e-12, "and no faster than it may cost energy"


def test_after_the_first_gap_a_reserve_is_charged_for_the_next_one_and_then_the_line_is_clear() -> None:
    """A part of the waves is withheld until the reserve covers a fade."""
    checked, waves = CheckedLine(delay=2, redundancy=4), stroke()
    for number in range(1200):
        checked.step((next(waves),), not 10 <= number < 16)
    played = [wave[0] for wave in checked.played]
    assert checked.receiver.count().lost == 3
    assert played[2:12] == [0.3] * 10
    assert min(played[40:]) >= 0.3 * (1.0 - CHARGE_FRACTION) - 1e-12
    assert played[-1] == pytest.approx(0.3, rel=1e-3)
    saved = sum(0.3**2 - value * value for value in played[2:])
    assert saved == pytest.approx(concealment.TARGET_FRAMES * 0.3**2, rel=0.3)
    checked.check()


@pytest.mark.parametrize("name", CONCEALMENTS)
@pytest.mark.parametrize("tank_j", [0.0, 1e-3])
def test_a_repeat_is_mended_like_a_gap(name: Concealed, tank_j: float) -> None:
    """A late datagram, as some were before: the end yields for a pop and comes back; what was played besides is compensated."""
    checked = CheckedLine(delay="auto", redundancy=8, tank_j=tank_j, concealment=name)
    for number in range(800):
        if number == 100:
            checked.receiver._jitter_buffer.arrived(-1)
            checked.receiver._jitter_buffer.arrived(-1)
        checked.step((0.3 if number < 160 else 0.0,), number != 100)
        if number == 160:
            assert checked.receiver.playout_account().repeated == 1
            assert checked.receiver.playout_account().concealed == checked.receiver.lost == 0
            assert checked.receiver.gain == 1.0
    checked.check()
    assert abs(checked.receiver.deficit[0]) < 0.01


@pytest.mark.parametrize("frame_s", [1 / 32, 1 / 128, 1 / 1024])
def test_the_times_do_not_depend_on_the_frame_rate(frame_s: float) -> None:
    """A fade takes the same time at every rate."""
    per_second = round(1.0 / frame_s)
    concealment = CONCEALMENTS[BEST](1, frame_s)
    value = 1.0
    for _ in range(per_second // 16):
        (value,) = concealment.fill([value], [inf])
    assert value == pytest.approx(ELASTIC_FADE**8, rel=1e-9)
    assert concealment.quality == pytest.approx(ELASTIC_FADE**8, rel=1e-9)


def test_what_the_end_has_written_off_is_withheld_as_it_comes() -> None:
    """A hand moved on 12 sqrt(W) frames through an outage without a force; the waves that answer it afterwards are not felt."""
    checked = CheckedLine(delay=0, redundancy=4)
    for number in range(300):
        if number == 100:
            for _ in range(40):
                checked.receiver.write_off((0.3,))
        wave = 0.3 if 150 <= number < 190 else 0.0
        checked.step((wave,))
    played = [wave[0] for wave in checked.played]
    felt = sum(abs(value) for value in played[150:190])
    assert felt < 0.75 * 40 * 0.3, "less than has come"
    assert abs(sum(played[100:])) < 1.5, "12 have come and 12 were written off before"
    checked.check()


rows = st.integers(1, 3).flatmap(lambda n: st.tuples(*[st.lists(st.floats(-1e6, 1e6), min_size=n, max_size=n)] * 3))


@given(rows, st.booleans())
@settings(max_examples=200, deadline=None)
def test_no_answer_is_beyond_its_room_or_not_finite(numbers: tuple[list[float], ...], gap: bool) -> None:
    row, deficit, reserve = numbers
    axes = len(row)
    for name, make in CONCEALMENTS.items():
        strategy = make(axes, FRAME_S)
        room = [abs(value) for value in reserve]
        filled = strategy.fill(row, room)
        if name == BEST:
            assert all(abs(value) <= most for value, most in zip(filled, room, strict=True))
            paid = strategy.compensate(row, deficit, room, row, gap)
            for value, pay, most in zip(row, paid, room, strict=True):
                assert abs(value + pay) <= sqrt(value * value + most) * (1.0 + 1e-9) + 1e-9
        assert 0.0 <= strategy.quality <= 1.0


@pytest.mark.parametrize("name", CONCEALMENTS)
@pytest.mark.parametrize("size", [1e6, -1e6])
def test_forged_totals_bring_no_more_than_honest_waves_could(name: Concealed, size: float) -> None:
    """A peer lies about its totals: nothing is played beyond the largest wave that came, and what compensation may add."""
    receiver = LineReceiver(1, 0, FRAME_S, 0.0, name)
    largest = 0.0
    for number in range(400):
        if number % 3 != 2:
            receiver.receive(number, (0.2,), (number * size,), (number * size * size,))
        largest = max(largest, abs(receiver.pop()[0]))
    assert largest <= 0.2 + ELASTIC_LIMIT + 1e-9
