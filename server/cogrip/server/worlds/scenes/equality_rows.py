"""Rows of welds and connections, so that their springs do work over the path that a step really takes (theory 8.2).

p = x_1 - x_2, from one anchor to the other; J its Jacobian at the step's start, v+ the velocity after the step, h the step:

    p+ - p = h J v+ + h^2/2 J' v+ + O(h^3)        J' = dJ/dt

A body that turns at w takes an anchor at distance r round by a circle, and not along the tangent: h^2/2 w^2 r, against which a
spring that is solved with J does no work, so that it gains what the bodies do not lose. With J + h/2 J' it does.
"""

from typing import NamedTuple

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from cogrip.server.worlds.world import turn

Array = NDArray[np.float64]
_HELD = (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD))
_WELD = _HELD[1]
_SLIDE, _FREE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_FREE)


class _End(NamedTuple):
    """An anchor that goes round as its body turns.

    equality  its number
    anchor    in the body's frame [m]
    """

    equality: int
    body: int
    anchor: Array


class _Side:
    """Ends that are the same one of the two of their equalities, whose entries in J are therefore apart."""

    def __init__(self, model: mujoco.MjModel, ends: list[_End], sign: float) -> None:
        self._model, self._ends = model, ends
        self._bodies = [int(end.body) for end in ends]
        self._anchors = np.array([end.anchor for end in ends])
        self._rates = np.zeros((len(ends), 3, model.nv))  # J' of each end
        self._scale = 0.5 * sign * float(model.opt.timestep)

    def arrange(self, data: mujoco.MjData) -> None:
        """Find the entries of J. They stay where they are as long as the same equalities hold: their rows come first."""
        nv, numbers = self._model.nv, data.efc_id[: data.ne].tolist()
        entries, sources = [np.zeros(0, int)], [np.zeros(0, int)]
        for place, end in enumerate(self._ends):
            first = numbers.index(end.equality) if end.equality in numbers else -3
            for axis, row in enumerate(range(first, first + 3)):
                if row >= 0:
                    start, columns = row * nv, np.arange(nv)
                    if mujoco.mj_isSparse(self._model):
                        start, count = int(data.efc_J_rowadr[row]), int(data.efc_J_rownnz[row])
                        columns = data.efc_J_colind[start : start + count]
                    entries.append(start + np.arange(len(columns)))
                    sources.append((3 * place + axis) * nv + columns)
        self._entries, self._sources = np.concatenate(entries), np.concatenate(sources)

    def correct(self, data: mujoco.MjData) -> None:
        """Add h/2 J' of these ends."""
        turned = data.xmat.take(self._bodies, 0).reshape(-1, 3, 3)
        places = data.xpos.take(self._bodies, 0) + turn(turned, self._anchors)
        for rate, place, body in zip(self._rates, places, self._bodies, strict=True):
            mujoco.mj_jacDot(self._model, data, rate, None, place, body)
        data.efc_J.reshape(-1)[self._entries] += self._scale * self._rates.take(self._sources)


class EqualityRows:
    """The first three rows of each weld and connection."""

    def __init__(self, model: mujoco.MjModel) -> None:
        held = [number for number in range(model.neq) if model.eq_type[number] in _HELD]
        pairs = [_ends(model, number) for number in held]
        sides = [[end for end in side if not _straight(model, end)] for side in zip(*pairs, strict=True)]
        self._sides = [_Side(model, side, sign) for side, sign in zip(sides, (1.0, -1.0), strict=False) if side]

    def arrange(self, data: mujoco.MjData) -> None:
        """Follow a change of the state by hand, after `mj_step1`."""
        for side in self._sides:
            side.arrange(data)

    def correct(self, data: mujoco.MjData) -> None:
        """Replace J by J + h/2 J', once after each `mj_step1`."""
        for side in self._sides:
            side.correct(data)


def _ends(model: mujoco.MjModel, number: int) -> tuple[_End, _End]:
    first, second = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
    if model.eq_objtype[number] == mujoco.mjtObj.mjOBJ_SITE:
        bodies, places = model.site_bodyid, model.site_pos
        return _End(number, bodies[first], places[first].copy()), _End(number, bodies[second], places[second].copy())
    anchors = model.eq_data[number, :3].copy(), model.eq_data[number, 3:6].copy()
    if model.eq_type[number] == _WELD:  # which keeps its second body's first
        anchors = anchors[::-1]
    return _End(number, first, anchors[0]), _End(number, second, anchors[1])


def _straight(model: mujoco.MjModel, end: _End) -> bool:
    """Return whether J of an end is constant."""
    body = end.body
    if model.body_parentid[body] != 0:
        return False
    joints = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
    kinds = {int(model.jnt_type[joint]) for joint in joints}
    return kinds <= {_SLIDE} or (kinds == {_FREE} and not end.anchor.any())
