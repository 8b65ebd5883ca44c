"""The sending end of a line: numbers frames, repeats the newest R of them, sums all before (SPEC 5.2)."""

from cogrip.protocol.axes import POSE_AXES
from cogrip.protocol.line.energy_sums import WaveSums

NO_WAVES = (0.0,) * (32 * POSE_AXES)  # waves of 0 for a datagram of the largest redundancy
Frame = tuple[float, ...]  # one wave of all axes, shape (axes,) [sqrt(W)]


class LineSender:
    """Numbers frames and keeps what a datagram has to carry.

    axes        degrees of freedom, 1 to 6
    redundancy  R, frames in a datagram, 1 to 32
    """

    __slots__ = ("_at", "_axes", "_before", "_capacity", "_count", "_values", "next_number")

    def __init__(self, axes: int, redundancy: int) -> None:
        self._capacity = redundancy * axes
        self._axes = axes
        self._values = list(NO_WAVES)  # a ring of the newest frames, frame by frame, axis by axis
        self._at = self._count = 0  # place of the next frame, values so far
        self._before = WaveSums(axes)  # of the frames that no datagram carries any more
        self.next_number = 0

    def push(self, wave: Frame) -> None:
        """Append the next frame."""
        values, axes, at = self._values, self._axes, self._at
        if self._count == self._capacity:
            self._before.add_at(values, at)
        else:
            self._count += axes
        for axis in range(axes):
            values[at + axis] = wave[axis]
        self._at = at + axes if at + axes < self._capacity else 0
        self.next_number += 1

    def contents(self) -> tuple[int, Frame, Frame, Frame]:
        """Return number of the oldest frame, waves frame by frame, totals [sqrt(W)] and squares [W] of all frames before."""
        values, count, before = self._values, self._count, self._before
        oldest = self._at if count == self._capacity else 0
        waves = [values[place] for place in range(oldest, count)] + [values[place] for place in range(oldest)]
        return self.next_number - count // self._axes, tuple(waves), before.totals(), before.square_sums()
