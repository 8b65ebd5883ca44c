"""Reliable delivery over a line that loses, repeats and reorders: what is unanswered is sent again (SPEC.md 5.9).

A sender numbers its items from 1, keeps those that the other end has not answered, and sends them again. The receiver takes
each once, by its number, and answers with the newest that it has taken in order, or with each one's number.
"""

from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")


class Unanswered(Generic[T]):
    """Numbered items that the other end has not answered, oldest first; at most `most`, where it is given.

    number   of the newest item, 0 before the first
    waiting  items that are not answered, each with its number
    again    least time between two rounds of `due`, in the unit of its `now`
    """

    __slots__ = ("_again", "_most", "_next", "number", "waiting")

    def __init__(self, most: int | None = None, again: int = 0) -> None:
        self.number = 0
        self.waiting: deque[tuple[int, T]] = deque()
        self._most, self._again, self._next = most, again, 0

    @property
    def full(self) -> bool:
        """True where the other end has yet to answer as many items as may wait."""
        return len(self.waiting) == self._most

    def add(self, item: T) -> int:
        """Send an item from now on. Return its number. What is not `full` is the caller's to ask."""
        self.number += 1
        self.waiting.append((self.number, item))
        self._next = 0
        return self.number

    def answered(self, number: int) -> int:
        """Forget all items up to this number, and return how many those were. One that was never sent changes nothing."""
        if number > self.number:
            return 0
        before = len(self.waiting)
        while self.waiting and self.waiting[0][0] <= number:
            self.waiting.popleft()
        return before - len(self.waiting)

    def answered_one(self, number: int) -> None:
        """Forget the item of this number."""
        self.waiting = deque([each for each in self.waiting if each[0] != number])

    def due(self, now: int) -> list[tuple[int, T]]:
        """Return what is to be sent now: all that waits, where the time since the last round is over."""
        if not self.waiting or now < self._next:
            return []
        self._next = now + self._again
        return list(self.waiting)

    def begin(self) -> int:
        """Begin with another receiver, which knows of no item. Return how many it will never get."""
        lost = len(self.waiting)
        self.waiting.clear()
        self.number = self._next = 0
        return lost
