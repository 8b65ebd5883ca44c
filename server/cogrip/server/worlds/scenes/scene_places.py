"""Places where added tools begin: in the free, and near what they are to press.

A tool is tried where it stands, beside the object's bounding ball. If it is in something there, or further than NEAR_M from its
target, it is moved: along x from outside towards the target until CLEAR_M are left, at the first of several heights and offsets
at which nothing is in its way. The target is the object, or where there is none the first body that can move. Where the scene
has a site cogrip_NAME, NAME being the person's, the tool begins there.
"""

from collections.abc import Collection, Iterator, Sequence
from itertools import product
from math import dist, inf
from typing import NamedTuple

import mujoco  # type: ignore[import-untyped]
import numpy as np

from cogrip.protocol.settings.types import Side
from cogrip.server.worlds.scenes.scene_start import Start
from cogrip.server.worlds.scenes.scene_text import SceneError

CLEAR_M = 0.03  # distance between an added tool's start and what it is to press
NEAR_M = 0.1  # largest distance from its target of a tool that stays where it stands
FREE_M = 0.001  # least distance between a tool and anything
SITE = "cogrip_"  # beginning of the name of a site; a person's name follows, whose tool begins there
_CLOSE_M = 0.0005  # largest difference from CLEAR_M at which the search of a place ends
_FAR_M = 1e3  # largest distance that is measured
MOST_TARGETS = 16  # most bodies near which a free place is looked for, where there is no object
_MOST_STEPS = 60
_GRIPS_M = (0.0, 0.005, 0.01, 0.015, 0.02, 0.03, 0.04)
"""Heights above an object's centre of mass at which hands take it, in the order in which they are tried."""
_OFFSETS_M = (0.0, 0.02, -0.02, 0.05, -0.05, 0.1, -0.1, 0.2, 0.4, 0.8)
"""Heights of a place above the middle of its target, in the order in which they are tried."""
_ABOVE_M = (1.6, 3.2)  # further heights, where there is nothing to be near to
_ASIDE_M = (0.0, 0.05, -0.05, 0.1, -0.1, 0.2, -0.2)


class Placed(NamedTuple):
    """An added tool that is to begin in the free. site: where the scene wants it; -1: it does not say."""

    body: int
    side: Side
    site: int = -1


def place_tools(model: mujoco.MjModel, start: Start, tools: Sequence[Placed], target: int, name: str) -> None:
    """Move the added tools of a model to where they are free. Raises SceneError where there is no such place.

    target: body that they are to press; -1: the first that can move
    """
    if max(float(np.abs(model.body_pos).max()), float(model.geom_rbound.max(initial=0.0))) > _FAR_M:
        return  # a scene with a number that is none, or huge: its trial says so
    targets = [target] if target >= 0 else _moving(model, {tool.body for tool in tools}) or [-1]
    places = _Places(model, start)
    for tool in tools:
        if tool.site >= 0:
            places.place_at(tool.body, tool.site, name)
        else:
            sign = -1.0 if tool.side == "left" else 1.0
            near = any(places.place(tool.body, sign, each) for each in targets[:MOST_TARGETS])
            if not near and not places.place_far(tool.body):
                beside = f" near body {model.body(targets[0]).name!r}" if targets[0] >= 0 else ""
                raise SceneError(
                    f"{name}: there is no free place{beside} for an added tool; give the scene a body with a free joint, or "
                    f"with three slide joints, where it is free, and name it as the person's tool, or a site {SITE}NAME"
                )


class Approach(NamedTuple):
    """Way of a tool to its target [m]: first beside it, then along x until it touches."""

    first_m: tuple[float, float, float]
    gap_m: float


def approaches(
    model: mujoco.MjModel, start: Start, tools: Sequence[int], signs: Sequence[float], target: int
) -> tuple[Approach, ...] | None:
    """Return how added tools come to take a body between them, all at one height, touching nothing else; None: they cannot.

    signs: side of each tool along x. The model is as it was afterwards.
    """
    places = _Places(model, start)
    for up in _GRIPS_M:
        found = [places.approach(tool, sign, target, up) for tool, sign in zip(tools, signs, strict=True)]
        if None not in found:
            return tuple(each for each in found if each)
    return None


def _moving(model: mujoco.MjModel, tools: set[int]) -> list[int]:
    """Return the bodies that can move and be touched, of the scene's own."""
    own = dict.fromkeys(int(body) for body in model.jnt_bodyid if int(model.body_rootid[body]) not in tools)
    return [body for body in own if _solid(model, body)]


def _solid(model: mujoco.MjModel, body: int) -> list[int]:
    """Return the geoms of a body that touch anything; none of flexible bodies and height fields, which have no distance."""
    return [
        geom
        for geom in range(model.ngeom)
        if model.geom_bodyid[geom] == body
        and (model.geom_contype[geom] or model.geom_conaffinity[geom])
        and model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_HFIELD
    ]


class _Places:
    """Tries places of tools in a model, and leaves each tool at the last one tried."""

    def __init__(self, model: mujoco.MjModel, start: Start) -> None:
        self._model, self._start, self._data = model, start, mujoco.MjData(model)
        self._others = {body: _solid(model, body) for body in range(model.nbody)}
        self._far: dict[int, np.ndarray] = {}  # of each tool the first free place that was too far from every target

    def place_at(self, body: int, site: int, name: str) -> None:
        """Move a tool to a site. Raises SceneError where it would be in something there."""
        self._move(body, self._model.body_pos[body].copy())
        self._move(body, self._data.site_xpos[site].copy())
        if not self._is_free(body):
            raise SceneError(
                f"{name}: site {self._model.site(site).name!r} is no place for a tool to begin: it would be in something "
                f"there; move the site {FREE_M * 1e3:g} mm or more away from everything"
            )

    def place_far(self, body: int) -> bool:
        """Move a tool to a free place that is near to nothing. Return whether there is one."""
        if body in self._far:
            self._move(body, self._far[body])
        return body in self._far

    def place(self, body: int, sign: float, target: int) -> bool:
        """Leave a tool where it stands, or move it. Return whether there is a free place near the target."""
        aims = self._others[target] if target >= 0 else []
        self._move(body, self._model.body_pos[body].copy())
        if self._is_free(body) and (not aims or self._distance(body, aims) <= NEAR_M):
            return True
        begun = self._model.body_pos[body].copy()
        near = []
        for place in self._candidates(body, sign, aims, begun):
            self._move(body, place)
            if not self._is_free(body):
                continue
            self._far.setdefault(body, place.copy())
            if not aims or self._distance(body, aims) <= NEAR_M:
                if not self._in_margin(body):
                    return True
                near.append(place.copy())
        self._move(body, near[0] if near else begun)
        return bool(near)

    def approach(self, body: int, sign: float, target: int, up: float) -> Approach | None:
        """Return how a tool comes to a body this far above its centre of mass, None where it does not."""
        model, data = self._model, self._data
        begun = model.body_pos[body].copy()
        self._move(body, begun.copy())
        middle = data.subtree_com[target].copy()
        aims = [geom for part in range(model.nbody) if model.body_rootid[part] == target for geom in self._others[part]]
        place = np.array([begun[0], middle[1], middle[2] + up])
        self._move(body, place)
        free, left_m = self._is_free(body), inf
        for _ in range(_MOST_STEPS):
            left_m = self._distance(body, aims)
            if left_m <= _CLOSE_M or sign * (place[0] - middle[0]) < 0.0:
                break
            place[0] -= sign * left_m
            self._move(body, place)
        there = free and left_m <= _CLOSE_M and self._is_free(body, aims)
        first = (0.0, float(place[1] - begun[1]), float(place[2] - begun[2]))
        gap_m = sign * float(begun[0] - place[0])
        self._move(body, begun)
        return Approach(first, gap_m) if there and gap_m >= 0.0 else None

    def _candidates(self, body: int, sign: float, aims: Sequence[int], begun: np.ndarray) -> Iterator[np.ndarray]:
        if not aims:
            for up, aside in product((*_OFFSETS_M, *_ABOVE_M), _ASIDE_M):
                yield begun + np.array([sign * abs(aside), aside, up])
            return
        middle = self._data.geom_xpos[aims].mean(axis=0)
        reach_m = max(dist(self._data.geom_xpos[aim], middle) + float(self._model.geom_rbound[aim]) for aim in aims)
        asides = sorted(_ASIDE_M, key=lambda aside: abs(middle[1] + aside - begun[1]))  # tools of one side stay apart
        for up, aside in product(_OFFSETS_M, asides):
            place = middle + np.array([sign * (reach_m + NEAR_M), aside, up])
            for _ in range(_MOST_STEPS):
                self._move(body, place)
                left_m = self._distance(body, aims) - CLEAR_M
                if abs(left_m) <= _CLOSE_M or sign * (place[0] - middle[0]) < -reach_m:
                    break
                place[0] -= sign * left_m
            yield place

    def _move(self, body: int, place: np.ndarray) -> None:
        """Let a tool begin at a place."""
        model = self._model
        model.body_pos[body] = place
        joint = int(model.body_jntadr[body])
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
            at = int(model.jnt_qposadr[joint])
            model.qpos0[at : at + 3] = place
        self._start.begin(model, self._data)
        mujoco.mj_kinematics(model, self._data)
        mujoco.mj_comPos(model, self._data)
        mujoco.mj_flex(model, self._data)

    def _of(self, body: int) -> list[int]:
        """Return the geoms of a tool, its finger's too."""
        model = self._model
        return [geom for part in range(model.nbody) if model.body_rootid[part] == body for geom in self._others[part]]

    def _distance(self, body: int, geoms: Sequence[int]) -> float:
        """Return the least distance of a tool from these geoms; negative inside of one [m]."""
        return min(
            (
                mujoco.mj_geomDistance(self._model, self._data, mine, other, _FAR_M, None)
                for mine in self._of(body)
                for other in geoms
            ),
            default=_FAR_M,
        )

    def _is_free(self, body: int, aims: Collection[int] = ()) -> bool:
        """Return whether a tool is in nothing but these geoms."""
        others = [(part, geoms) for part, geoms in self._others.items() if self._model.body_rootid[part] != body]
        rest = [geom for _, geoms in others for geom in geoms if geom not in aims]
        return self._distance(body, rest) >= FREE_M and self._contact(body, aims) >= FREE_M

    def _in_margin(self, body: int) -> bool:
        """Return whether a tool is within the margin of a contact, where MuJoCo has one already."""
        return self._contact(body) < _FAR_M

    def _contact(self, body: int, aims: Collection[int] = ()) -> float:
        """Return the least distance of the contacts that MuJoCo has of a tool, also with what has no other distance [m].

        aims: geoms whose contacts do not count
        """
        mujoco.mj_collision(self._model, self._data)
        contact, mine = self._data.contact, self._of(body)
        one = (np.isin(contact.geom, mine).sum(axis=1) == 1) & ~np.isin(contact.geom, list(aims)).any(axis=1)
        return float(contact.dist[one].min(initial=_FAR_M))
