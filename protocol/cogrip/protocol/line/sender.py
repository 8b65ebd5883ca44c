"""The sending end of a line: numbers frames, repeats the newest R of them, sums all before (SPEC 5.2)."""

from cogrip.protocol.line.energy_sums import WaveSums

Frame = tuple[float, ...]  # one wave of all axes, shape (axes,) [sqrt(W)]


class LineSender:
    """Numbers frames and keeps what a datagram has to carry.

    axes        degrees of freedom, 1 to 6
    redundancy  R, frames in a datagram, 1 to 32
    """

    __slots__ = ("_axes", "_before", "_capacity", "_values", "next_number")

    def __init__(self, axes: int, redundancy: int) -> None:
        self._capacity = redundancy * axes
        self._axes = axes
        self._values: list[float] = []  # the newest frames, frame by frame, axis by axis
        self._before = WaveSums(axes)  # of the frames that no datagram carries any more
        self.next_number = 0

    def push(self, wave: Frame) -> None:
        """Append the next frame."""
        values = self._values
        values.extend(wave)
        self.next_number += 1
        if len(values) > self._capacity:
            self._before.add(tuple(values[: self._axes]))
            del values[: self._axes]

    def contents(self) -> tuple[int, Frame, Frame, Frame]:
        """Return number of the oldest frame, waves frame by frame, totals [sqrt(W)] and squares [W] of all frames before."""
        waves = tuple(self._values)
        before = self._before
        return self.next_number - len(waves) // self._axes, waves, before.total, before.squares
