"""Drawing of a world, beside it: what observers, recordings and clients are told of its looks. No step depends on it."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cogrip.protocol.drawing import Shape
from cogrip.protocol.scene_words import left_out_words


class Drawing:
    """A world of which the object alone is drawn, as a box."""

    def shapes(self) -> Sequence[Shape]:
        """Return the shapes that the world is drawn of; none where the object alone is drawn."""
        return ()

    def poses(self) -> NDArray[np.float64]:
        """Return place [m] in the object's frame and quaternion of each body that moves and has shapes, shape (bodies, 7)."""
        return np.zeros((0, 7))

    def left_out(self) -> Sequence[str]:
        """Return what the world has that its shapes do not say, in words, for those who look at it; none where they say all."""
        return ()

    def notes(self) -> Sequence[str]:
        """Return sentences about the world for those who look at it: what is not drawn of it, or was changed of it."""
        return (left_out_words(words),) if (words := self.left_out()) else ()

    def local_shapes(self, user: int) -> Sequence[Shape]:
        """Return the shapes with which a person's client renders contact itself, in the hand's own frame."""
        return ()
