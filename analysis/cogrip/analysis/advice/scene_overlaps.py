"""Springs of a scene that are pressed already as it begins: of bodies in each other, and of joints outside of their range."""

from math import degrees
from typing import NamedTuple

import mujoco  # type: ignore[import-untyped]

from cogrip.server.worlds.scenes.scene_file import Scene

OVERLAP_M = 1e-3  # least depth that is told: what rests on something is less deep


_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)
_OF_ONE = {_SLIDE: 1e-3, int(mujoco.mjtJoint.mjJNT_HINGE): 0.02}
"""Kinds of joints of one coordinate, with how far outside of its range is told [m, rad]."""


DEEP_M = 5e-3  # least depth at which what is pushed apart may hit a hand


class Overlap(NamedTuple):
    """Two bodies by their names, and how deep they are in each other at first."""

    one: str
    other: str
    depth_m: float

    @property
    def text(self) -> str:
        """Return it in words, with the cure."""
        return (
            f"bodies {self.one} and {self.other} are {1e3 * self.depth_m:.3g} mm inside of each other as the scene begins, and "
            f'pushed apart: move them, or leave their contact out by <exclude body1="{self.one}" body2="{self.other}"/>'
        )


def overlaps(scene: Scene) -> list[Overlap]:
    """Return the pairs of bodies that overlap at the start, the deepest first."""
    model, found = scene.model, dict[tuple[str, str], float]()
    data = scene.start.data(model)
    mujoco.mj_step1(model, data)
    for contact in data.contact:
        if contact.dist < -OVERLAP_M and min(contact.geom) >= 0:
            one, other = sorted(int(model.geom_bodyid[geom]) for geom in contact.geom)
            pair = model.body(one).name or f"body {one}", model.body(other).name or f"body {other}"
            found[pair] = max(found.get(pair, 0.0), -float(contact.dist))
    return sorted((Overlap(*pair, depth) for pair, depth in found.items()), key=lambda each: -each.depth_m)


def outside_ranges(scene: Scene) -> list[str]:
    """Return in words which joints begin outside of their range, into which they are pushed."""
    model, found = scene.model, []
    places = scene.start.data(model).qpos
    for joint in range(model.njnt):
        kind = int(model.jnt_type[joint])
        if not model.jnt_limited[joint] or kind not in _OF_ONE:
            continue
        (low, high), at = model.jnt_range[joint], float(places[model.jnt_qposadr[joint]])
        beyond = max(low - at, at - high)
        if beyond > _OF_ONE[kind]:
            how = f"{1e3 * beyond:.3g} mm" if kind == _SLIDE else f"{degrees(beyond):.3g} degrees"
            name = (
                model.joint(joint).name
                or f"of body {model.body(model.jnt_bodyid[joint]).name or model.jnt_bodyid[joint]}"
            )
            found.append(
                f"joint {name} begins {how} outside of its range, and is pushed into it: begin in a keyframe, or widen it"
            )
    return found
