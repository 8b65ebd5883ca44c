"""Points that flexible bodies and tendons of a scene are drawn through: they move as bodies do, and have no orientation."""

from collections.abc import Iterator

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from cogrip.machine.addition import add_integers
from cogrip.protocol.drawing import MOST_POINTS, MOST_SHAPES, Shape, pack_points
from cogrip.server.worlds.scenes.scene_textures import texture_of

_PULLEY = int(mujoco.mjtWrap.mjWRAP_PULLEY)
_AT_ONE = (
    int(mujoco.mjtWrap.mjWRAP_SITE),
)  # kinds that a tendon passes at one point; a geom that it goes round it passes at two
_ROUND = (int(mujoco.mjtWrap.mjWRAP_SPHERE), int(mujoco.mjtWrap.mjWRAP_CYLINDER))
_LINE_DIM, _SOLID_DIM = 1, 3
NO_COLOUR = (0.5, 0.5, 0.5, 1.0)  # colour of what sets none
_BROKEN = -2  # number that wrap_obj has for a pulley, between two branches


class ScenePoints:
    """first: number of the first point among the bodies; left_out: names of what has more points than there is room for."""

    def __init__(self, model: mujoco.MjModel, first: int, groups: int) -> None:
        self._model, self._first = model, first
        self.shapes: list[Shape] = []
        self.left_out: list[str] = []
        self._corners: list[int] = []  # flexes' vertices, in the order of their points
        self._branches: list[tuple[int, int, int]] = []  # of tendons: tendon, number of the branch, its points
        self._count = first
        for flex in range(model.nflex):
            if model.flex_group[flex] < groups:
                self._add_flex(flex)
        for tendon in range(model.ntendon):
            if model.tendon_group[tendon] < groups:
                self._add_tendon(tendon)

    def places(self, data: mujoco.MjData) -> NDArray[np.float64]:
        """Return where the points are in the world [m], shape (points, 3)."""
        found = [data.flexvert_xpos[self._corners]] if self._corners else []
        paths: dict[int, list[list[list[float]]]] = {}
        for tendon, branch, count in self._branches:
            if tendon not in paths:
                paths[tendon] = _path(data, tendon)
            path = paths[tendon][branch] if branch < len(paths[tendon]) else []
            path = path[:count] or [[0.0, 0.0, 0.0]]
            found.append(np.array(path + path[-1:] * (count - len(path))))
        return np.concatenate(found) if found else np.zeros((0, 3))

    def _has_room(self, count: int, name: str) -> bool:
        if self._count + count > MOST_SHAPES:
            self.left_out.append(f"{name} ({count} points)")
            return False
        return True

    def _add_flex(self, flex: int) -> None:
        model = self._model
        count, vertex = int(model.flex_vertnum[flex]), int(model.flex_vertadr[flex])
        dim, element = int(model.flex_dim[flex]), int(model.flex_elemdataadr[flex])
        material = int(model.flex_matid[flex])
        rgba = with_mean(model, colour_of(model, model.flex_rgba[flex], material), material)
        if (rgba is not None and rgba[3] == 0.0) or not self._has_room(
            count, f"flex {_name(model, mujoco.mjtObj.mjOBJ_FLEX, flex)}"
        ):
            return
        if dim == _SOLID_DIM:
            shell = int(model.flex_shelldataadr[flex])
            numbers = model.flex_shell[shell : shell + 3 * model.flex_shellnum[flex]]
        else:
            numbers = model.flex_elem[element : element + (dim + 1) * model.flex_elemnum[flex]]
        points = (numbers + self._count).tolist()
        if dim == _LINE_DIM:
            radius = float(model.flex_radius[flex])
            for chain in _chains(points):
                self._add_paths(chain, radius, rgba)
        else:
            size = MOST_POINTS // 3 * 3
            for at in range(0, len(points), size):
                self._add("flex", points[at : at + size], 0.0, rgba)
        self._corners += range(vertex, vertex + count)
        self._count += count

    def _add_tendon(self, tendon: int) -> None:
        model = self._model
        adr, size = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
        counts = [0]
        for kind in model.wrap_type[adr : adr + size].tolist():
            if kind == _PULLEY:
                counts.append(0)
            counts[-1] += 1 if kind in _AT_ONE else 2 if kind in _ROUND else 0
        material = int(model.tendon_matid[tendon])
        rgba = with_mean(model, colour_of(model, model.tendon_rgba[tendon], material), material)
        if (rgba is not None and rgba[3] == 0.0) or max(counts) < 2:  # the sum of joints has no path
            return
        if not self._has_room(add_integers(counts), f"tendon {_name(model, mujoco.mjtObj.mjOBJ_TENDON, tendon)}"):
            return
        radius = float(model.tendon_width[tendon])
        branches = [count for count in counts if count]
        for branch, count in enumerate(branches):
            self._branches.append((tendon, branch, count))
            self._add_paths(list(range(self._count, self._count + count)), radius, rgba)
            self._count += count

    def _add_paths(self, points: list[int], radius: float, rgba: tuple[float, ...] | None) -> None:
        """Add a path, in as many shapes as it needs: each begins where the one before ends."""
        for at in range(0, max(1, len(points) - 1), MOST_POINTS - 1):
            if len(part := points[at : at + MOST_POINTS]) > 1:
                self._add("tendon", part, radius, rgba)

    def _add(self, kind: str, points: list[int], radius: float, rgba: tuple[float, ...] | None) -> None:
        size = (min(radius, 1e3), 0.0, 0.0)
        self.shapes.append(Shape(kind, size, rgba=rgba, points=pack_points(points)))  # type: ignore[arg-type]


def colour_of(model: mujoco.MjModel, rgba: NDArray[np.float32], material: int) -> tuple[float, ...] | None:
    """Return the colour of a thing or, where it has MuJoCo's default, of its material; None where neither gives one."""
    own = tuple(rgba.tolist())
    if own == NO_COLOUR and material >= 0:
        own = tuple(model.mat_rgba[material].tolist())
    return None if own == NO_COLOUR else tuple([min(max(round(each, 4), 0.0), 1.0) for each in own])


def with_mean(model: mujoco.MjModel, rgba: tuple[float, ...] | None, material: int) -> tuple[float, ...] | None:
    """Return a colour times the mean of its material's texture, where there is one."""
    texture = texture_of(model, material)
    if texture is None:
        return rgba
    own = np.array(rgba or NO_COLOUR)
    return tuple(np.round(own * [*texture.mean, 1.0], 4).tolist())


def _name(model: mujoco.MjModel, kind: mujoco.mjtObj, number: int) -> str:
    return mujoco.mj_id2name(model, kind, number) or str(number)


def _path(data: mujoco.MjData, tendon: int) -> list[list[list[float]]]:
    """Return the points of each branch of a tendon."""
    adr, size = int(data.ten_wrapadr[tendon]), int(data.ten_wrapnum[tendon])
    places, things = data.wrap_xpos.reshape(-1, 3), data.wrap_obj.reshape(-1)
    branches: list[list[list[float]]] = [[]]
    for at in range(adr, adr + size):
        if things[at] == _BROKEN:
            branches.append([])
        else:
            branches[-1].append(places[at].tolist())
    return [branch for branch in branches if branch]


def _chains(edges: list[int]) -> Iterator[list[int]]:
    """Yield edges, two points each, as paths: each as long as the next edge begins where it ends."""
    chain: list[int] = []
    for at in range(0, len(edges), 2):
        if chain and edges[at] == chain[-1]:
            chain.append(edges[at + 1])
            continue
        if chain:
            yield chain
        chain = edges[at : at + 2]
    if chain:
        yield chain
