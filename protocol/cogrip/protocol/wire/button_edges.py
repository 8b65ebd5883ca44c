"""Edges of buttons, reliable and in order over a lossy line (`SPEC.md` section 5.9).

The sender repeats an edge in every datagram until the receiver has acknowledged it; the receiver takes each once, by its
number. An edge is a button's number from 1: above 0 it went down, below 0 up.
"""

from collections import Counter
from collections.abc import Iterator

from cogrip.protocol.wire.handle import MOST_AGE, MOST_BUTTONS, MOST_EDGES, Handle, Quaternion
from cogrip.protocol.wire.reliable import Unanswered

LEFT_OUT = "button edges"


class EdgeSender:
    """Edges that are not acknowledged yet, at most MOST_EDGES.

    While there are so many, further ones wait: what a button has come to is sent when there is room. Where it was pressed and
    released (or released and pressed) meanwhile, both edges are left out, and counted in `dropped`.
    """

    def __init__(self, dropped: Counter[str]) -> None:
        self._dropped = dropped
        self._edges: Unanswered[tuple[int, int]] = Unanswered(MOST_EDGES)  # each with its tick
        self._buttons = 0  # as read last
        self._sent = 0  # after the newest edge

    def update(self, buttons: int, tick: int) -> bool:
        """Set the buttons that are down at a tick, one bit each. Return whether that made an edge."""
        if buttons == self._buttons == self._sent:
            return False
        before = self._edges.number
        changed, self._buttons = buttons ^ self._buttons, buttons
        differs = buttons ^ self._sent
        if left_out := changed & ~differs:
            self._dropped[LEFT_OUT] += 2 * left_out.bit_count()
        for bit in bits_of(differs):
            if self._edges.full:
                break
            self._edges.add((bit + 1 if buttons >> bit & 1 else -bit - 1, tick))
            self._sent ^= 1 << bit
        return self._edges.number > before

    def acknowledge(self, count: int) -> None:
        """Forget the first `count` edges; a count that cannot be, or is an old one, changes nothing."""
        self._edges.answered(count)

    def begin(self) -> None:
        """Begin a seat session, in which no button is down. What was not acknowledged counts as left out."""
        if lost := self._edges.begin():
            self._dropped[LEFT_OUT] += lost
        self._buttons = self._sent = 0

    def message(self, tick: int, orientation: Quaternion | None, grip_m: float | None) -> Handle | None:
        """Return what is sent at a tick; None where there is nothing to say."""
        waiting = self._edges.waiting
        first = self._edges.number - len(waiting)
        if not waiting:
            return None if orientation is None and grip_m is None else Handle(first, (), (), orientation, grip_m)
        ages = tuple([min(MOST_AGE, tick - then) for _, (_, then) in waiting])
        return Handle(first, tuple([edge for _, (edge, _) in waiting]), ages, orientation, grip_m)


class EdgeReceiver:
    """Edges of a seat session, each once and in order; newest orientation and grip.

    taken        number of edges that `pop` has given: what is acknowledged
    buttons      those that are down after them, one bit each
    popped       edges that the last `pop` gave, and their ages as they were sent [ticks]
    orientation  newest, None where it is not told; likewise grip_m
    """

    def __init__(self) -> None:
        self.taken = self.buttons = 0
        self.popped: tuple[tuple[int, ...], tuple[int, ...]] = (), ()
        self.orientation: Quaternion | None = None
        self.grip_m: float | None = None
        self._waiting: Handle | None = None  # which has edges that are not taken yet
        self._newest_ns = -1

    def receive(self, handle: Handle, sent_ns: int) -> bool:
        """Receive edges that were sent at `sent_ns` of the sender's clock. Return False for those of another session."""
        if handle.first > self.taken:
            return False
        waiting = self._waiting
        if handle.first + len(handle.edges) > (self.taken if waiting is None else waiting.first + len(waiting.edges)):
            self._waiting = handle
        if sent_ns > self._newest_ns:
            self._newest_ns = sent_ns
            self.orientation, self.grip_m = handle.orientation, handle.grip_m
        return True

    def pop(self) -> tuple[int, ...]:
        """Return the edges that have come since the last call."""
        if self._waiting is None:
            if self.popped[0]:
                self.popped = (), ()
            return ()
        handle, self._waiting = self._waiting, None
        start = self.taken - handle.first
        self.taken = handle.first + len(handle.edges)
        edges, ages = [], []
        for edge, age in zip(handle.edges[start:], handle.ages[start:], strict=True):
            bit = 1 << abs(edge) - 1
            if (self.buttons & bit == 0) is (edge > 0):  # else it changes nothing
                self.buttons ^= bit
                edges.append(edge)
                ages.append(age)
        self.popped = tuple(edges), tuple(ages)
        return self.popped[0]


def edge_words(edge: int) -> str:
    """Return what is told of an edge, such as `presses button 1`."""
    return f"{'presses' if edge > 0 else 'releases'} button {abs(edge)}"


def bits_of(buttons: int) -> Iterator[int]:
    """Return the numbers of the bits that are set, from 0."""
    return (bit for bit in range(MOST_BUTTONS) if buttons >> bit & 1)
