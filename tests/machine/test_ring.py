"""The ring between a loop and its writer: what is put comes out whole and in order, or is counted lost."""

import os
import subprocess
import sys
from collections import deque
from collections.abc import Iterator
from itertools import islice

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule, run_state_machine_as_test

from cogrip.machine.byte_copy import copy_into
from cogrip.machine.ring import LOST, Ring, make_ring

CAPACITY = 4096  # of the smallest ring
HEAD = 16  # bytes of a message beside its payload
MOST = CAPACITY - HEAD
LOSS_BYTES = 512  # that messages on losses may take, one for each gap


@pytest.fixture
def ends() -> Iterator[tuple[Ring, Ring]]:
    """Both ends of the smallest ring: two maps of it, as two processes have them."""
    loop = make_ring(CAPACITY)
    writer = Ring(os.dup(loop.fd))
    yield loop, writer
    loop.close()
    writer.close()


def padded(size: int) -> int:
    """Bytes that a payload of `size` takes of the ring."""
    return (HEAD + size + 7) // 8 * 8


class Interleaving(RuleBasedStateMachine):
    """Any order of puts and takes against a queue."""

    def __init__(self) -> None:
        super().__init__()
        self.loop = make_ring(CAPACITY)
        self.writer = Ring(os.dup(self.loop.fd))
        self.queue: deque[tuple[int, int, bytes]] = deque()
        self.lost_before: deque[int] = deque()
        self.lost = 0
        self.taking: Iterator[tuple[int, int, bytes]] = iter(())
        self.count = 0

    def teardown(self) -> None:
        self.taking = iter(())
        self.loop.close()
        self.writer.close()

    def free(self) -> int:
        return CAPACITY - sum(padded(len(payload)) for _, _, payload in self.queue)

    @rule(
        topic=st.integers(0, LOST - 1),
        time_ns=st.integers(0, 2**64 - 1),
        size=st.integers(0, 40)
        | st.integers(0, CAPACITY + 8)
        | st.sampled_from((0, 1, 7, 8, 9, 2032, MOST - 1, MOST, MOST + 1)),
    )
    def put(self, topic: int, time_ns: int, size: int) -> None:
        self.count += 1
        payload = (self.count.to_bytes(4, "little") * (size // 4 + 1))[:size]
        before = self.loop.lost
        self.loop.put(topic, time_ns, payload)
        if self.loop.lost == before:
            assert padded(size) <= self.free(), "it took room that the taker had not given back"
            self.queue.append((topic, time_ns, payload))
            self.lost_before.append(before)
        else:
            self.lost += 1
            # what is in the ring and what should go in pass its end once at most, and the rest that is skipped there is shorter
            # than the message that skipped it; the word of what was lost before may be in the ring or have to go in first
            longest = max([size, *[len(payload) for _, _, payload in self.queue]])
            assert padded(size) + padded(longest) + LOSS_BYTES > self.free(), "there was room"

    @rule()
    def take_all(self) -> None:
        for message in self.writer.take():
            assert message == self.queue.popleft()
            assert self.writer.missed == self.lost_before.popleft(), "what was lost is known at its place"
        assert not self.queue

    @rule(count=st.integers(1, 5))
    def take_some(self, count: int) -> None:
        """A taker that stops halfway has the last one again: it was not done with it."""
        taken = list(islice(self.writer.take(), count))
        assert taken == list(islice(self.queue, count))
        for _ in range(len(taken) - 1 if len(taken) == count else len(taken)):
            self.queue.popleft()
            self.lost_before.popleft()

    @rule(data=st.data())
    def put_while_taking(self, data: st.DataObject) -> None:
        """Messages that come meanwhile are left for the next read."""
        there = len(self.queue)
        for number, message in enumerate(self.writer.take()):
            assert message == self.queue[0]
            if data.draw(st.booleans()):
                self.put(number, number, data.draw(st.integers(0, 100)))
            self.queue.popleft()
            self.lost_before.popleft()
            there -= 1
        assert there == 0

    @invariant()
    def losses_are_counted(self) -> None:
        assert self.loop.lost == self.writer.lost_there == self.lost


def test_in_any_interleaving_messages_come_out_whole_and_in_order_or_are_counted_lost():
    run_state_machine_as_test(Interleaving)


def test_the_largest_message_fits_exactly_and_one_byte_more_does_not(ends):
    loop, writer = ends
    for _ in range(3):  # it begins at the ring's start every time
        loop.put(3, 5, bytes(MOST))
        assert loop.lost == 0
        assert list(writer.take()) == [(3, 5, bytes(MOST))]
    loop.put(3, 5, bytes(MOST + 1))
    assert loop.lost == 1
    assert not list(writer.take())
    loop.put(3, 5, b"small")
    assert list(writer.take()) == [(3, 5, b"small")]


def test_a_full_ring_takes_nothing_until_something_is_taken(ends):
    loop, writer = ends
    for number in range(8):
        loop.put(number, number, bytes(512 - HEAD))
    assert loop.lost == 0
    loop.put(9, 9, b"")
    assert loop.lost == writer.lost_there == 1
    taking = writer.take()
    assert next(taking)[0] == 0
    loop.put(9, 9, b"")
    assert loop.lost == 2, "the first one is still being read"
    assert next(taking)[0] == 1
    loop.put(9, 9, b"")
    assert loop.lost == 2
    assert [topic for topic, _, _ in taking] == [2, 3, 4, 5, 6, 7]
    assert [topic for topic, _, _ in writer.take()] == [9]


@pytest.mark.parametrize("words", ["the disk is full: \N{CROSS MARK}", "\N{CROSS MARK}" * 4096])
def test_words_and_the_end_go_the_other_way(ends, words):
    """The first report stays, as much of it as there is room for: no word runs into the data."""
    loop, writer = ends
    assert not loop.said
    writer.say(words)
    writer.say("and again")
    assert loop.said[:1000] == words[:1000]
    loop.put(0, 1, b"data")
    assert list(writer.take()) == [(0, 1, b"data")]
    assert not writer.finished
    loop.finish()
    assert writer.finished


TAKER = """
import os, sys
from cogrip.machine.ring import LOST, Ring
parent = os.getppid()
ring, acknowledged = Ring(int(sys.argv[1])), Ring(int(sys.argv[2]))
taken = 0
while os.getppid() == parent and (not ring.finished or taken < int(sys.argv[3])):
    for topic, time_ns, payload in ring.take():
        assert (topic, time_ns, payload) == (taken % 7, taken, b"%d" % taken), (taken, topic, time_ns, payload)
        taken += 1
        if taken % 256 == 0:
            acknowledged.put(0, taken, b"")
assert taken == int(sys.argv[3]) and ring.lost_there == 0, (taken, ring.lost_there)
"""


def test_two_processes_at_full_speed_lose_nothing_while_there_is_room():
    """Neither may see a counter of the other's half written: the ring is never more than half full here."""
    messages, capacity = 100_000, 1 << 16
    loop, answers = make_ring(capacity), make_ring(CAPACITY)
    most_waiting = capacity // 2 // padded(len(b"%d" % messages))
    command = [sys.executable, "-c", TAKER, str(loop.fd), str(answers.fd), str(messages)]
    with subprocess.Popen(command, pass_fds=(loop.fd, answers.fd), stderr=subprocess.PIPE, text=True) as taker:
        taken = number = 0
        while number < messages and not loop.lost and taker.poll() is None:
            if number - taken < most_waiting:
                loop.put(number % 7, number, b"%d" % number)
                number += 1
            else:
                taken = max([taken, *(time_ns for _, time_ns, _ in answers.take())])
        if loop.lost:
            taker.kill()
        loop.finish()
        words = taker.communicate()[1]
    assert loop.lost == 0, f"message {number} was refused although half of the ring was free"
    assert taker.returncode == 0, words
    loop.close()
    answers.close()


@pytest.mark.parametrize(
    ("start", "size", "fits"), [(0, 8, True), (8, 0, True), (7, 1, True), (8, 1, False), (1, 8, False), (-2, 1, False)]
)
def test_bytes_are_copied_where_there_is_room(start: int, size: int, fits: bool) -> None:
    target = memoryview(bytearray(8))
    if fits:
        copy_into(target, start, b"x" * size)
        assert bytes(target) == bytes(start) + b"x" * size + bytes(8 - start - size)
    else:
        with pytest.raises(ValueError, match=r"."):
            copy_into(target, start, b"x" * size)
        assert bytes(target) == bytes(8)
