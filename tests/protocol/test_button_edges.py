"""Edges of buttons over a line that loses, repeats and swaps datagrams: each comes once, in order, or is counted."""

from collections import Counter
from itertools import pairwise
from random import Random

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.protocol.wire.button_edges import LEFT_OUT, EdgeReceiver, EdgeSender, bits_of
from cogrip.protocol.wire.handle import MOST_AGE, MOST_EDGES, Handle
from cogrip.protocol.wire.messages import MalformedError, State, decode

ENOUGH = 400  # frames, after which the line loses nothing


class Line:
    """A sender and a receiver, a frame at a time. Each way a datagram takes `delays[frame]` frames; None loses it."""

    def __init__(self, up: list[int | None], down: list[int | None]) -> None:
        self.dropped: Counter[str] = Counter()
        self.sender, self.receiver = EdgeSender(self.dropped), EdgeReceiver()
        self._up, self._down = up, down
        self._coming: list[tuple[int, int, Handle]] = []
        self._acknowledged: list[tuple[int, int]] = []
        self.frame = 0
        self.given: list[int] = []
        self.at: list[int] = []

    def run(self, buttons: int) -> None:
        now = self.frame
        for then, count in [each for each in self._acknowledged if each[0] <= now]:
            self.sender.acknowledge(count)
            self._acknowledged.remove((then, count))
        self.sender.update(buttons, now)
        handle = self.sender.message(now, None, None)
        delay = self._up[now] if now < len(self._up) else 1
        if handle is not None and delay is not None:
            self._coming.append((now + delay, now, handle))
        for each in [each for each in self._coming if each[0] <= now]:
            assert self.receiver.receive(each[2], each[1])
            self._coming.remove(each)
        edges = self.receiver.pop()
        self.given += edges
        self.at += [now] * len(edges)
        delay = self._down[now] if now < len(self._down) else 1
        if delay is not None:
            self._acknowledged.append((now + delay, self.receiver.taken))
        self.frame += 1


def edges_of(course: list[int]) -> list[int]:
    """Edges of a course of buttons, in the order of the buttons where they come together."""
    found = []
    for before, after in pairwise([0, *course]):
        found += [bit + 1 if after >> bit & 1 else -bit - 1 for bit in bits_of(before ^ after)]
    return found


delays = st.lists(st.one_of(st.none(), st.integers(0, 6)), max_size=120)
courses = st.lists(st.integers(0, 2**32 - 1) | st.sampled_from([0, 1, 2, 3, 2**31]), min_size=1, max_size=60)


few = st.lists(st.sampled_from([0, 1, 2, 3]), min_size=1, max_size=MOST_EDGES // 2)


@given(delays, delays, few | courses)
@settings(max_examples=600)
def test_each_comes_once_in_order_and_of_too_many_pairs_are_left_out_and_counted(
    up: list[int | None], down: list[int | None], course: list[int]
) -> None:
    """Any pattern of loss, delay and order. None is left out of as many edges as may be unacknowledged."""
    line = Line(up, down)
    for buttons in [*course, *[course[-1]] * ENOUGH]:
        line.run(buttons)
    happened = edges_of(course)
    if len(happened) <= MOST_EDGES:
        assert line.given == happened
        assert not line.dropped
    assert line.receiver.buttons == course[-1]
    assert len(line.given) + line.dropped[LEFT_OUT] == len(happened)
    for bit in range(32):
        mine = [edge > 0 for edge in line.given if abs(edge) == bit + 1]
        assert mine == [number % 2 == 0 for number in range(len(mine))], "a press, a release, a press"


@pytest.mark.parametrize("loss", [0.0, 0.3, 0.9])
def test_at_thirty_percent_loss_an_edge_waits_for_the_first_datagram_that_comes(loss: float) -> None:
    random = Random(1)
    frames = 4000
    up, down = [[None if random.random() < loss else 1 for _ in range(frames)] for _ in range(2)]
    line = Line(up, down)
    course = [(number // 200) % 2 for number in range(frames)]
    for buttons in course:
        line.run(buttons)
    happened = [number for number, (before, after) in enumerate(pairwise([0, *course])) if before != after]
    for then, at in zip(happened, line.at, strict=True):
        first = next(frame for frame in range(then, frames) if up[frame] is not None)
        assert at == first + 1
    assert not line.dropped


def test_both_sides_of_the_bound_on_unacknowledged_edges() -> None:
    dropped: Counter[str] = Counter()
    sender = EdgeSender(dropped)
    for number in range(MOST_EDGES):
        sender.update((number + 1) % 2, number)
    handle = sender.message(MOST_EDGES, None, None)
    assert handle is not None
    assert handle.edges == (1, -1) * (MOST_EDGES // 2)
    assert handle.ages == tuple(range(MOST_EDGES, 0, -1))
    sender.update(1, 20)
    assert sender.message(21, None, None) == Handle(0, handle.edges, tuple(range(21, 5, -1)))
    assert not dropped, "it may still be sent"
    sender.update(0, 21)
    assert dropped == {LEFT_OUT: 2}
    sender.update(2, 22)
    sender.acknowledge(1)
    sender.update(2, 23)
    handle = sender.message(23, None, None)
    assert handle is not None
    assert (handle.first, handle.edges[-1], handle.ages[-1]) == (1, 2, 0)


def test_an_old_edge_says_the_greatest_age() -> None:
    sender = EdgeSender(Counter())
    sender.update(1, 0)
    for tick, age in ((MOST_AGE, MOST_AGE), (MOST_AGE + 1, MOST_AGE)):
        handle = sender.message(tick, None, None)
        assert handle is not None
        assert handle.ages == (age,)


@pytest.mark.parametrize("count", [-1, 0, 3, 2**32 - 1])
def test_an_acknowledgement_that_cannot_be_changes_nothing(count: int) -> None:
    sender = EdgeSender(Counter())
    sender.update(3, 0)
    before = sender.message(0, None, None)
    sender.acknowledge(count)
    assert sender.message(0, None, None) == before


def test_a_new_session_begins_with_no_button_down_and_counts_what_was_not_acknowledged() -> None:
    dropped: Counter[str] = Counter()
    sender = EdgeSender(dropped)
    sender.update(3, 0)
    sender.acknowledge(1)
    sender.begin()
    assert dropped == {LEFT_OUT: 1}
    sender.update(2, 5)
    assert sender.message(5, None, None) == Handle(0, (2,), (0,))


def test_what_follows_a_gap_is_refused() -> None:
    receiver = EdgeReceiver()
    assert receiver.receive(Handle(0, (1,), (0,)), 1)
    assert not receiver.receive(Handle(1, (-1,), (0,)), 2), "nothing is acknowledged before it was taken"
    assert receiver.pop() == (1,)
    assert receiver.receive(Handle(1, (-1,), (0,)), 3)
    assert not receiver.receive(Handle(2, (1,), (0,)), 4)


def test_an_edge_that_changes_nothing_is_not_given() -> None:
    """A client of another make may send two presses in a row."""
    receiver = EdgeReceiver()
    assert receiver.receive(Handle(0, (1, 1, -2, -1), (4, 3, 2, 1)), 1)
    assert receiver.pop() == (1, -1)
    assert receiver.popped == ((1, -1), (4, 1))
    assert receiver.taken == 4


def test_the_newest_orientation_and_grip_count() -> None:
    receiver = EdgeReceiver()
    for sent_ns, grip_m in ((2, 0.02), (1, 0.01), (2, 0.03)):
        assert receiver.receive(Handle(0, (), (), (1.0, 0.0, 0.0, 0.0), grip_m), sent_ns)
    assert (receiver.orientation, receiver.grip_m) == ((1.0, 0.0, 0.0, 0.0), 0.02)
    assert receiver.receive(Handle(0, (), ()), 3)
    assert (receiver.orientation, receiver.grip_m) == (None, None)


@pytest.mark.parametrize(
    ("handle", "fine"),
    [
        ((0, (1, -32), (0, 65535)), True), ((0, (0,), (0,)), False), ((0, (33,), (0,)), False), ((0, (-33,), (0,)), False),
        ((0, (1,), ()), False), ((0, (), (0,)), False), ((0, (1,), (65536,)), False), ((0, (1,), (-1,)), False),
        ((0, (1,) * 16, (0,) * 16), True), ((0, (1,) * 17, (0,) * 17), False), ((0, (True,), (0,)), False),
        ((0, (), (), (0.5, -0.5, 0.5, 0.5)), True), ((0, (), (), (1.0, 0.1, 0.0, 0.0)), False),
        ((0, (), (), (1.0, 0.0, 0.0)), False), ((0, (), (), (float("nan"), 0.0, 0.0, 1.0)), False),
        ((0, (), (), None, float("nan")), False),
    ],
)  # fmt: skip
def test_both_sides_of_the_bounds_of_a_handle_beside_those_of_the_page(handle: tuple[object, ...], fine: bool) -> None:
    datagram = msgspec.msgpack.encode([5, 1, 0, [0.0], [0.0], 0.0, 0, [1], handle])
    if fine:
        message = decode(datagram)
        assert isinstance(message, State)
        assert message.handle == Handle(*handle)  # type: ignore[arg-type]
    else:
        with pytest.raises(MalformedError):
            decode(datagram)
