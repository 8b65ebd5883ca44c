"""Delay of a value by the age of samples."""

from collections import deque
from collections.abc import Sequence
from typing import Generic, TypeVar

from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Row

T = TypeVar("T")


class DelayLine(Generic[T]):
    """Delays a value by the age of samples, so that a displacement meets the force that acted while it was made.

    ticks  of the delay
    """

    def __init__(self) -> None:
        self.ticks = 0
        self._values: deque[T] = deque(maxlen=0)

    def set_ticks(self, ticks: int, before: T) -> None:
        """Delay by `ticks` ticks from now on. before: stands for ticks that are not known."""
        self.ticks = ticks
        self._values = deque([*[before] * ticks, *self._values], maxlen=ticks)

    def push(self, value: T) -> T:
        """Push the value of a tick, and return that of `ticks` ticks before."""
        values = self._values
        if not values:
            return value
        oldest = values[0]
        values.append(value)  # drops the oldest
        return oldest

    def push_many(self, value: T, ticks: int) -> list[T]:
        """Push a value for several ticks, and return the values of `ticks` ticks before each."""
        pushed = [*self._values, *[value] * ticks]
        self._values.extend([value] * ticks)
        return pushed[:ticks]


def mean_row(line: DelayLine[Row], row: Row, ticks: int) -> Sequence[float]:
    """Push a row for several ticks, and return the mean of the rows of `line.ticks` ticks before each."""
    if ticks == 1:
        return line.push(row)
    return [add_floats(parts) / ticks for parts in zip(*line.push_many(row, ticks), strict=True)]
