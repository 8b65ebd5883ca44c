"""Hostile peers: no datagrams make a pop do more work. Work is counted in lines of code that run, not in time."""

import random
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

import pytest

from cogrip.protocol.line import jitter_buffer
from cogrip.protocol.line import receiver as line
from cogrip.protocol.line.jitter_buffer import AdaptiveJitterBuffer
from cogrip.protocol.line.receiver import LineReceiver
from cogrip.protocol.line.sender import LineSender

FRAME_S = 1.0 / 128.0
A_SECOND = 512  # datagrams of one peer that a server takes in
HONEST_LINES = 300  # more than a take runs on any network that the tests have


def lines_of(act: Callable[[], Any]) -> int:
    """Return how many lines of Python run in `act`."""
    count = 0

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal count
        count += event == "line"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        act()
    finally:
        sys.settrace(before)
    return count


def begun(frames: int | str = 2) -> LineReceiver:
    receiver = LineReceiver(1, frames, FRAME_S)  # type: ignore[arg-type]
    assert receiver.receive(0, (0.1,), (0.0,), (0.0,))
    receiver.pop()
    return receiver


@pytest.mark.parametrize(
    ("least", "most"), [(line.HISTORY // 2, line.FURTHEST_JUMP), (4, line.HISTORY)], ids=["far ahead", "just ahead"]
)
def test_a_pop_costs_the_same_whatever_totals_wait(least: int, most: int) -> None:
    receiver, chance, worst = begun(), random.Random(1), 0
    for _ in range(1000):
        for _ in range(4):
            receiver.receive(receiver.acknowledged + chance.randint(least, most), (0.1,), (0.0,), (0.0,))
        worst = max(worst, lines_of(receiver.pop))
    assert worst < HONEST_LINES


def test_the_first_pop_of_a_line_costs_no_more_than_its_window() -> None:
    chance, receiver = random.Random(2), LineReceiver(1, "auto", FRAME_S)
    for number in [8000, *(chance.randint(0, line.FURTHEST_JUMP) for _ in range(A_SECOND))]:
        receiver.receive(number, (0.1,) * line.MOST_FRAMES, (0.0,), (0.0,))
    assert lines_of(receiver.pop) < 12 * (2 * line.HISTORY + line.MOST_FRAMES)


def test_a_sender_that_is_everywhere_leaves_no_more_latenesses_than_are_bounded() -> None:
    depth, chance = AdaptiveJitterBuffer(line.LATE, FRAME_S, 1), random.Random(3)
    depth.begin(0)
    for _ in range(8000):  # the playout follows wherever it is led
        for _ in range(4):
            depth.arrived(chance.randint(-2 * jitter_buffer.DEEPEST, 2 * jitter_buffer.DEEPEST))
        depth.decide(chance.randint(1, jitter_buffer.DEEPEST), chance.random() < 0.5, True)
    assert depth.repeated > 0
    assert len(depth._recent) == len(depth._sorted) == jitter_buffer.WINDOW
    assert depth._sorted == sorted(depth._recent)


def test_no_pop_in_a_gap_costs_more_than_another() -> None:
    receiver, chance, worst = begun("auto"), random.Random(4), 0
    newest = 1
    for _ in range(1000):
        newest = max(newest + 2, receiver.acknowledged + 239) | 1  # every other frame is missing when its time comes
        receiver.receive(newest, (0.1,), (0.0,), (0.0,))
        receiver.receive(max(0, receiver.acknowledged - chance.randint(1, 256)), (0.1,), (0.0,), (0.0,))
        worst = max(worst, lines_of(receiver.pop))
    assert worst < HONEST_LINES


@pytest.mark.long
def test_totals_are_used_as_when_all_were_gone_over() -> None:
    """The newest totals up to the frame that is due, found in one look, are those that a search of all would find."""
    for seed in range(40):
        chance = random.Random(seed)
        sender, receiver = LineSender(1, chance.choice((1, 2, 8))), LineReceiver(1, chance.choice((0, 2, 6)), FRAME_S)
        known: dict[int, tuple[tuple[float, ...], tuple[float, ...]]] = {}
        on_way: list[tuple[int, Any]] = []
        settled = 0
        for now in range(300):
            sender.push((chance.uniform(-1.0, 1.0),))
            if chance.random() < 0.7:
                on_way.append((now + chance.randint(0, 12), sender.contents()))
            for due, contents in on_way:
                if due == now and receiver.receive(*contents) and contents[0] > settled:
                    known[contents[0]] = contents[2:]
            before = receiver.acknowledged
            receiver.pop(chance.choice((1, 1, 1, 1, 3)))
            cursor = receiver.acknowledged
            if cursor == before:  # a repeat
                continue
            usable = [number for number in known if settled < number <= cursor and number > cursor - line.HISTORY]
            if usable:
                settled = max(usable)
            known = {number: totals for number, totals in known.items() if number > cursor}
            assert receiver.ledger.settled == settled
