"""The sending end of a line: numbered frames, the last R of them again, and the running totals of all before (SPEC 5.2)."""

from collections import deque

Frame = tuple[float, ...]


class LineSender:
    """Numbers frames and keeps what a datagram has to carry. Waves are tuples of shape (axes,) [sqrt(W)]."""

    __slots__ = ("_most", "_square", "_total", "_values", "next_number")

    def __init__(self, axes: int, redundancy: int) -> None:
        self._most = redundancy * axes
        self._values: deque[float] = deque()  # of the newest frames, frame by frame, axis by axis
        self._total = (0.0,) * axes
        self._square = (0.0,) * axes
        self.next_number = 0

    def push(self, wave: Frame) -> None:
        values = self._values
        values.extend(wave)
        self.next_number += 1
        if len(values) > self._most:
            oldest = [values.popleft() for _ in wave]
            self._total = tuple([total + value for total, value in zip(self._total, oldest, strict=True)])
            self._square = tuple([square + value * value for square, value in zip(self._square, oldest, strict=True)])

    def contents(self) -> tuple[int, Frame, Frame, Frame]:
        """(number of the oldest frame, waves frame by frame, totals before it, squares before it)."""
        waves = tuple(self._values)
        return self.next_number - len(waves) // len(self._total), waves, self._total, self._square
