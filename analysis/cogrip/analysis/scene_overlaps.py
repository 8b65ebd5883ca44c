"""Bodies of a scene that are inside of each other as it begins: the springs of their contact are pressed already."""

from typing import NamedTuple

import mujoco  # type: ignore[import-untyped]

from cogrip.server.worlds.scene_file import Scene

OVERLAP_M = 1e-3  # least depth that is told: what rests on something is less deep


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
