"""Scene whose clients render contact with what is fixed themselves: a line takes hold of a tool only where something moves.

A tool is *clear* (`kinematic`) as long as nothing that moves is near (`clearance`): it is put where its client's proxy is, at
rest, and touches nothing, so that it does no work on anything; no wave goes back, and one that comes counts for nothing. Near
something it is *engaged*: from there on, at rest, its wave port drives it as in `SceneWorld`. Where nothing has been near for
RELEASE_S the tool is clear again, and what it held as motion is lost.

A clear tool weighs nothing and has no velocity: wherever it is put the bodies' energy is the same. It comes to be engaged
outside of everything, so that no contact begins pressed. So neither change brings energy (theory 8.7).
"""

from collections.abc import Sequence
from math import dist, inf, nextafter
from typing import Any

import numpy as np

from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES
from cogrip.protocol.drawing import Shape
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.sections import REMOTE_SPEED_MPS
from cogrip.server.worlds.local_faces import pressed_n
from cogrip.server.worlds.scenes.clearance import Clearance
from cogrip.server.worlds.scenes.local_geometry import LocalGeometry, local_geometry, tree_of, unfit_tool
from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.server.worlds.scenes.scene_drawing import SceneDrawing
from cogrip.server.worlds.scenes.scene_file import Scene
from cogrip.server.worlds.scenes.scene_text import SceneError
from cogrip.server.worlds.world import Array, check_saved

RELEASE_S = 0.25
MOST_ADVANCES = 8  # most advances of a tool to its proxy in a frame, each as far as it is clear
CLOSE_M = 2e-4  # gap below which a tool is engaged; it goes on its way until half of it is left
OUT_M = 1e-6  # distance at which a tool is put outside of what is fixed
MOST_OUT_M = 1e-3
"""Largest depth from which a tool is put outside: what is deeper in touches nothing until it has left (`solid`)."""
MOST_OUTS = 8


class LocalSceneWorld(SceneWorld):
    """See `SceneWorld`. `geometry` is that of each seat; a tool that has none is engaged from joining to leaving.

    Raises SceneError for one that its hand turns: the hand would feel the line alone, whatever it asks for.
    """

    def __init__(self, seats: Sequence[SeatSettings], scene: Scene, substeps: int) -> None:
        self.geometry = [local_geometry(scene, seat) for seat in range(len(seats))]
        for seat, geometry in enumerate(self.geometry):
            if geometry.why and scene.tools[seat].driven:
                raise SceneError(unfit_tool(seats[seat].user, geometry.why))
            if not geometry.why:
                scene.model.body_gravcomp[tree_of(scene, seat)] = 1.0  # else lifting it when clear would make energy
        self._began, self._goal = np.zeros((2, len(seats), PLACES))  # engagements, proxies; in the hand's own frame
        self._quiet = np.zeros(len(seats), dtype=int)  # frames since anything was near
        super().__init__(seats, scene, substeps)
        self._clearances = [None if each.why else Clearance(scene, each, self.frame_s) for each in self.geometry]
        self._most_m = REMOTE_SPEED_MPS * self.frame_s  # that a tool goes in a frame
        self._release = round(RELEASE_S / self.frame_s)
        self._of_places = np.arange(self.axes) < PLACES
        self._pressed = np.zeros((len(seats), self.axes))  # force on fixed shapes, by each client's report [N]
        self.drawing = LocalDrawing(scene, self.data, self.object.start, self.geometry)

    def set_reported_positions(self, user: int, hand_m: Row, proxy_m: Row) -> None:
        self._goal[user] = proxy_m
        stiffness_npm = float(self.target_stiffness[user, 0])
        self._pressed[user, :PLACES] = pressed_n(stiffness_npm, hand_m[:PLACES], proxy_m)

    def engaged_at(self, user: int) -> Row:
        return tuple(self._began[user].tolist()) if self.holding[user] and not self.kinematic[user] else ()

    def join(self, user: int, position_m: Array) -> None:
        self._goal[user] = position_m[:PLACES]
        self.kinematic[user] = True  # touches nothing yet
        super().join(user, position_m)
        if self._gap(user, 0.0) < CLOSE_M:
            self._engage(user)

    def _gap(self, user: int, most_m: float) -> float:
        clearance = self._clearances[user]
        return clearance.gap(self.data, most_m + CLOSE_M, self.holding) if clearance else 0.0

    def step(self, inputs: Array) -> Array:
        moved = False  # since data were brought up to the state
        for user in np.flatnonzero(self.holding).tolist():
            if self.kinematic[user]:
                moved = self._follow(user, moved)
            else:
                near = self._gap(user, 0.0) < CLOSE_M
                self._quiet[user] = 0 if near else self._quiet[user] + 1
        if moved:
            self._refresh()
        clear = (self.holding & self.kinematic)[:, None] & self._of_places
        back = super().step(np.where(clear, 0.0, inputs))
        back = np.where(clear, 0.0, back)
        for user in np.flatnonzero(self._quiet >= self._release).tolist():
            self._let_go(user)
        self.force = self.force + np.where(self.holding[:, None], self._pressed, 0.0)
        return back

    def _follow(self, user: int, moved: bool) -> bool:
        """Put a clear tool where its proxy is, or as far towards it as it stays clear. Near something it is engaged there.

        moved: data lack what clear tools have moved, but for the places of their balls. Returns whether they do now.
        """
        data, places, balls = self.data, self._places[user], list(self.geometry[user].balls)
        goal, start = self._zero[user] + self._goal[user], data.qpos[self._places[user]]
        length = dist(goal.tolist(), start.tolist())
        left, gone, gap = min(length, self._most_m), 0.0, inf
        for _ in range(MOST_ADVANCES):
            gap = self._gap(user, left)
            part = min(gap - 0.5 * CLOSE_M, left)
            if gap < CLOSE_M or part <= 0.0:
                break
            gone, left = gone + part, left - part
            data.geom_xpos[balls] += (goal - start) * (part / length)
            if left == 0.0:
                break
        if gone > 0.0:
            data.qpos[places] = goal if gone == length else start + (goal - start) * (gone / length)
        if gap < CLOSE_M:
            self._engage(user)
            return False
        return moved or gone > 0.0

    def _engage(self, user: int) -> None:
        """Let the line take hold of a tool where it is, or just outside of what is fixed, at rest."""
        self.kinematic[user], self._quiet[user] = False, 0
        if not self.geometry[user].why:
            self._put_outside(user)
        place = self.proxy(user)[:PLACES]
        if np.array_equal(place, self._began[user]):
            place[0] = nextafter(place[0], 1.0)  # another engagement has another place
        self._began[user] = place
        self._make_solid()

    def _put_outside(self, user: int) -> None:
        """Put a tool outside of what it is less than MOST_OUT_M inside of: a proxy on a surface is so by rounding."""
        geoms = self._grips[user].geoms
        self._touch(user, True)
        for _ in range(MOST_OUTS):
            self._refresh()
            contact = self.data.contact
            own = np.isin(contact.geom, geoms)
            inside = np.where(own.any(axis=1), contact.dist, 0.0)
            if not inside.size or not -MOST_OUT_M <= inside.min() < 0.0:
                break
            deepest = int(inside.argmin())
            away = OUT_M - inside[deepest]  # the frame's first axis points from the first geom to the second
            self.data.qpos[self._places[user]] += (-away if own[deepest, 0] else away) * contact.frame[deepest, :3]
        self._touch(user, False)

    def _let_go(self, user: int) -> None:
        """Let a tool be clear again: its motion is lost, but for its turning."""
        tool = self.scene.tools[user]
        self.kinematic[user], self._quiet[user] = True, 0
        self.data.qvel[tool.dof : tool.dof + PLACES] = 0.0
        self._touch(user, False)
        self._refresh()

    def _park(self, user: int) -> None:
        super()._park(user)
        self.kinematic[user], self._quiet[user] = False, 0

    def save(self) -> Row:
        seats = np.concatenate((self.kinematic, self._quiet, self._began.ravel(), self._goal.ravel()))
        return (*seats.tolist(), *super().save())

    def restore(self, saved: Row) -> None:
        check_saved(saved, len(self.save()))
        seats = len(self.holding)
        own = np.array(saved[: 8 * seats])
        super().restore(saved[8 * seats :])
        self.kinematic, self._quiet = own[:seats] != 0.0, own[seats : 2 * seats].astype(int)
        self._began, self._goal = own[2 * seats :].reshape(2, seats, PLACES)


class LocalDrawing(SceneDrawing):
    """Drawing of a scene, and the shapes with which each client renders contact itself."""

    def __init__(self, scene: Scene, data: Any, start: Array, geometry: Sequence[LocalGeometry]) -> None:
        super().__init__(scene, data, start)
        self._geometry = geometry

    def local_shapes(self, user: int) -> Sequence[Shape]:
        return self._geometry[user].shapes
