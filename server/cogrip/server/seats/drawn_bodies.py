"""Messages to observers about a world with each view: poses of a scene's bodies, of those that moved first, shapes, all in
turn, and notes, one every NOTE_EVERY views.
"""

import math

import numpy as np

from cogrip.protocol.drawing import MOST_SHAPES, UNTURNED
from cogrip.protocol.texts import clipped, shown
from cogrip.protocol.wire.messages import MOST_NOTES, MOST_POSES, Bodies, Geom, Note, pack_poses
from cogrip.server.worlds.world import Array, World

MOVED_M = 1e-4
MOVED_DEG = 0.1
BODIES_AT_REST = 8  # number of poses of a view that are told though they did not change
SHAPES_A_VIEW = 8  # most shapes that are told with one view
NOTE_EVERY = 32  # number of views from one note to the next
VIEWS_A_TURN = 16  # views in which all shapes are told once, where they are few enough
_TURNED_COS = math.cos(math.radians(0.5 * MOVED_DEG))  # cosine of half the angle MOVED_DEG, as in a quaternion
_MOST_M = 1e3


class DrawnBodies:
    """One for a room: every observer is told the same. Nothing for a world without shapes."""

    def __init__(self) -> None:
        self._turn = self._view = self._noted = 0
        self._told = np.zeros((0, 7))  # poses as last told
        self._told_view = np.zeros(0, dtype=np.int64)  # when that was

    def messages(self, step: int, world: World) -> list[Bodies | Geom | Note]:
        """Return what is told with a view; the session is the observer's, to be put in."""
        return [*self._drawn(step, world), *self._notes(world)]

    def _notes(self, world: World) -> list[Note]:
        self._noted += 1
        if self._noted % NOTE_EVERY or not (notes := world.drawing.notes()[:MOST_NOTES]):
            return []
        number = self._noted // NOTE_EVERY % len(notes)
        return [Note(1, len(notes), number, clipped(shown(notes[number])))]

    def _drawn(self, step: int, world: World) -> list[Bodies | Geom]:
        shapes = world.drawing.shapes()
        if not shapes:
            return []
        chosen: list[int] = []
        for each in range(min(SHAPES_A_VIEW, -(-len(shapes) // VIEWS_A_TURN))):
            chosen.append((self._turn + each) % len(shapes))
            if shapes[chosen[-1]].kind == "mesh":  # of the size of seven others
                break
        self._turn = (self._turn + len(chosen)) % len(shapes)
        told: list[Bodies | Geom] = [Geom.of(shapes, number, 1) for number in chosen]
        poses = self._next_poses(_within(world.drawing.poses()[:MOST_SHAPES]))
        return [Bodies(1, step, poses), *told] if poses else told

    def _next_poses(self, poses: Array) -> bytes:
        """Return the poses to tell: those that moved, longest untold first, then BODIES_AT_REST of all others."""
        self._view += 1
        if len(self._told) != len(poses):
            self._told, self._told_view = poses.copy(), np.full(len(poses), -1)
        away = np.abs(poses[:, :3] - self._told[:, :3]).max(axis=1)
        cosines = np.abs(np.add.reduce(poses[:, 3:] * self._told[:, 3:], axis=1))
        moved = (away > MOVED_M) | (cosines < _TURNED_COS)
        by_age = np.argsort(self._told_view, kind="stable")
        first = by_age[moved[by_age]][: MOST_POSES - BODIES_AT_REST]
        rest = by_age[~np.isin(by_age, first)][:BODIES_AT_REST]
        chosen = np.concatenate((first, rest))
        self._told[chosen], self._told_view[chosen] = poses[chosen], self._view
        return pack_poses([(int(body), poses[body].tolist()) for body in chosen])


def _within(poses: Array) -> Array:
    """Return poses within the bounds of the message: one that is no pose takes the others from nobody."""
    poses = poses.copy()
    poses[:, :3] = np.clip(np.nan_to_num(poses[:, :3], nan=0.0), -_MOST_M, _MOST_M)
    odd = ~(np.abs(np.square(poses[:, 3:]).sum(axis=1) - 1.0) <= 1e-4)
    poses[odd, 3:] = UNTURNED
    return poses
