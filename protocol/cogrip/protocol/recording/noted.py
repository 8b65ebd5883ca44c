"""A queue whose every entry is noted as it enters."""

from collections import deque
from collections.abc import Callable, Iterable
from typing import TypeVar

T = TypeVar("T")


class ObservedQueue(deque[T]):
    """`note` is called with each entry, in order, before it stands in the queue."""

    def __init__(self, note: Callable[[T], None]) -> None:
        super().__init__()
        self._note = note

    def append(self, entry: T) -> None:
        self._note(entry)
        super().append(entry)

    def extend(self, entries: Iterable[T]) -> None:
        for entry in entries:
            self.append(entry)
