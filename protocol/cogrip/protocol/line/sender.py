"""The sending end of a line: numbered frames, the last R of them again, and the running totals of all before (SPEC 5.2)."""

from collections import deque

from cogrip.protocol.line.energy_sums import WaveSums

Frame = tuple[float, ...]


class LineSender:
    """Numbers frames and keeps what a datagram has to carry. Waves are tuples of shape (axes,) [sqrt(W)]."""

    __slots__ = ("_before", "_most", "_values", "next_number")

    def __init__(self, axes: int, redundancy: int) -> None:
        self._most = redundancy * axes
        self._values: deque[float] = deque()  # of the newest frames, frame by frame, axis by axis
        self._before = WaveSums(axes)  # of the frames that are in no datagram any more
        self.next_number = 0

    def push(self, wave: Frame) -> None:
        values = self._values
        values.extend(wave)
        self.next_number += 1
        if len(values) > self._most:
            self._before.add([values.popleft() for _ in wave])

    def contents(self) -> tuple[int, Frame, Frame, Frame]:
        """(number of the oldest frame, waves frame by frame, totals before it, squares before it)."""
        waves = tuple(self._values)
        before = self._before
        return self.next_number - len(waves) // len(before.total), waves, before.total, before.squares
