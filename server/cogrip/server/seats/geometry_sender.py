"""Messages to a player about the shapes with which its client renders contact: all of them at first, then in turn for ever."""

from collections.abc import Sequence

from cogrip.protocol.drawing import Shape
from cogrip.protocol.wire.messages import Geom

TOLD_S = 0.5  # time in which all shapes have been told once
MOST_A_FRAME = 2
AGAIN_HZ = 16  # messages a second once all shapes have been told


class GeometrySender:
    """One for a seat session. A shape that was lost comes again, and a client that begins anew gets all of them."""

    def __init__(self, shapes: Sequence[Shape], network_hz: int) -> None:
        self._shapes = shapes
        self._first = min(MOST_A_FRAME, -(-len(shapes) // max(1, int(TOLD_S * network_hz))))  # a frame, at first
        self._every = max(1, network_hz // AGAIN_HZ)
        self._frame = self._told = 0

    def next(self, session: int) -> list[Geom]:
        """Return what is told with this frame."""
        self._frame += 1
        count = len(self._shapes)
        if self._told < count:
            numbers = range(self._told, min(count, self._told + self._first))
        else:
            numbers = range(self._told, self._told + (self._frame % self._every == 0))
        self._told += len(numbers)
        return [Geom.of(self._shapes, number % count, session) for number in numbers]
