"""Drawing of a scene: its shapes as MuJoCo draws them, where its bodies are now, and words for what is not as in its file."""

from collections.abc import Sequence

import mujoco  # type: ignore[import-untyped]
import numpy as np

from cogrip.protocol.drawing import UNTURNED, Shape
from cogrip.protocol.scene_words import changed_words, unused_words
from cogrip.server.worlds.drawing import Drawing
from cogrip.server.worlds.scenes.scene_file import Scene
from cogrip.server.worlds.scenes.scene_shapes import shapes_of
from cogrip.server.worlds.world import Array


class SceneDrawing(Drawing):
    """A scene with these data. start: place of its object in the world at the start [m], about which it is drawn."""

    def __init__(self, scene: Scene, data: mujoco.MjData, start: Array) -> None:
        self._scene, self._data, self._start = scene, data, start
        drawn = shapes_of(scene, start)
        self._shapes, self._bodies, self._points, self._left_out = (
            drawn.shapes,
            drawn.bodies,
            drawn.points,
            drawn.left_out,
        )

    def shapes(self) -> Sequence[Shape]:
        return self._shapes

    def left_out(self) -> Sequence[str]:
        return self._left_out

    def notes(self) -> Sequence[str]:
        scene = self._scene
        told = ((scene.changed, changed_words), (scene.unused, unused_words))
        return (*super().notes(), *(say(words) for words, say in told if words))

    def poses(self) -> Array:
        places = np.concatenate((self._data.xpos[self._bodies], self._points.places(self._data)))
        turns = np.tile(UNTURNED, (len(places), 1))
        turns[: len(self._bodies)] = self._data.xquat[self._bodies]
        return np.concatenate((places - self._start, turns), axis=1)
