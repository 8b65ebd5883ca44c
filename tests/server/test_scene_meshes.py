"""Mesh files of scenes: read from the scene's folder alone, bounded, part of its digest, and drawn by their triangles."""

import struct
import warnings
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest
from scipy.spatial import ConvexHull, cKDTree
from scipy.spatial.transform import Rotation

from cogrip.analysis.advice.scene_advice import scene_findings
from cogrip.protocol.drawing import Shape
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.wire.messages import MAX_MESSAGE_BYTES, Geom, encode
from cogrip.server.worlds.scenes import scene_surfaces
from cogrip.server.worlds.scenes.local_geometry import local_geometry
from cogrip.server.worlds.scenes.scene_file import Held, load_scene
from cogrip.server.worlds.scenes.scene_shapes import shapes_of
from cogrip.server.worlds.scenes.scene_surfaces import MOST_SCENE_TRIANGLES
from cogrip.server.worlds.scenes.scene_text import MOST_FILE_BYTES, SceneError

from tests.server.scene_worlds import world_of

STEP = 1 / 128 / 4
SEAT = [Held("", "left", "")]
SCENE = """<mujoco>{compiler}<asset><mesh name="brick" file="{file}"/></asset><worldbody>
  <geom type="plane" size="1 1 .1"/>
  <body name="box" pos="0 0 .03"><freejoint/><geom type="mesh" mesh="brick" mass=".2"/></body>
</worldbody></mujoco>"""
HALF_M = (0.03, 0.02, 0.03)
CORNERS = [tuple(sign * half for sign, half in zip(signs, HALF_M, strict=True)) for signs in product((-1, 1), repeat=3)]
FACES = [
    (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7),
    (1, 7, 3),
]  # fmt: skip


def obj(away_m: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> bytes:
    lines = ["v " + " ".join(str(at + by) for at, by in zip(corner, away_m, strict=True)) for corner in CORNERS]
    lines += ["f " + " ".join(str(number + 1) for number in face) for face in FACES]
    return "\n".join(lines).encode()


def stl() -> bytes:
    triangles = [struct.pack("<12fH", 0, 0, 0, *CORNERS[a], *CORNERS[b], *CORNERS[c], 0) for a, b, c in FACES]
    return bytes(80) + struct.pack("<I", len(FACES)) + b"".join(triangles)


def scene_in(folder: Path, file: str = "brick.obj", compiler: str = "") -> Path:
    (folder / "scene.xml").write_text(SCENE.format(file=file, compiler=compiler))
    return folder / "scene.xml"


@pytest.mark.parametrize(
    ("place", "file", "compiler", "data"),
    [
        ("brick.obj", "brick.obj", "", obj()),
        ("brick.STL", "brick.STL", "", stl()),
        ("parts/brick.obj", "parts/brick.obj", "", obj()),
        ("parts/brick.obj", "brick.obj", '<compiler meshdir="parts"/>', obj()),
        ("parts/brick.obj", "brick.obj", '<compiler assetdir="parts"/>', obj()),
        ("parts/brick.obj", "far/brick.obj", '<compiler meshdir="parts" strippath="true"/>', obj()),
    ],
)
def test_meshes_are_read_beside_the_scene_and_below(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str, file: str, compiler: str, data: bytes
) -> None:
    (tmp_path / place).parent.mkdir(exist_ok=True)
    (tmp_path / place).write_bytes(data)
    monkeypatch.chdir(tmp_path.parent)
    scene = load_scene(scene_in(tmp_path, file, compiler), SEAT, STEP)
    assert sorted(scene.model.geom_aabb[1][3:]) == pytest.approx(sorted(HALF_M), abs=1e-6)


def surface(shapes: Sequence[Shape]) -> np.ndarray:
    """Return the triangles of a mesh in the frame of its body, shape (triangles, 3, 3)."""
    turn = Rotation.from_quat(shapes[0].orientation, scalar_first=True)
    corners = [corner for shape in shapes for corner in shape.corners_m()]
    placed: np.ndarray = turn.apply(corners) + np.array(shapes[0].place_m)
    return placed.reshape(-1, 3, 3)


def outside(triangles: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return how far a point is in front of each triangle [m]."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    heights: np.ndarray = ((point - triangles[:, 0]) * normals).sum(axis=1)
    return heights


def ball(corners: int, radius_m: float) -> bytes:
    """Return an OBJ file of an uneven ball, and no faces but one: MuJoCo finds the hull."""
    places = np.random.default_rng(1).normal(size=(corners, 3))
    places *= radius_m * np.array([1.0, 0.8, 0.6]) / np.linalg.norm(places, axis=1)[:, None]
    simplices = ConvexHull(places).simplices
    outwards = np.linalg.det(places[simplices]) > 0.0  # the origin is inside
    simplices[~outwards] = simplices[~outwards][:, ::-1]
    faces = [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in simplices]
    return "\n".join([*("v " + " ".join(map(repr, row)) for row in places.tolist()), *faces]).encode()


def test_a_mesh_is_drawn_by_its_own_triangles(tmp_path: Path) -> None:
    """Also one that lies beside its own origin. Twelve triangles of a brick, whose corners are its corners."""
    away = (0.1, 0.05, -0.02)
    (tmp_path / "brick.obj").write_bytes(obj(away))
    scene = load_scene(scene_in(tmp_path), SEAT, STEP)
    (shape,) = [each for each in shapes_of(scene, np.zeros(3)).shapes if each.object]
    assert shape.kind == "mesh"
    assert shape.place_m == pytest.approx(away, abs=1e-6)
    assert sorted(shape.size_m) == pytest.approx(sorted(HALF_M), abs=1e-6)
    triangles = surface([shape])
    assert triangles.shape == (12, 3, 3)
    found = {tuple(np.round(corner - away, 5).tolist()) for corner in triangles.reshape(-1, 3)}
    assert found == set(CORNERS)
    assert outside(triangles, np.array(away)).max() == pytest.approx(-min(HALF_M), abs=1e-6), "seen from outside"


def volume(triangles: np.ndarray) -> float:
    """Return the volume that triangles enclose [m3], above 0 where their corners go counter-clockwise from outside."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    return float((np.cross(a, b) * c).sum() / 6.0)


def test_a_mesh_of_too_many_triangles_is_drawn_by_its_share_of_them(tmp_path: Path) -> None:
    """Its form is kept: no corner leaves the mesh by more than a cell of the grid, and the volume stays."""
    (tmp_path / "brick.obj").write_bytes(ball(7000, 0.05))
    world = world_of(scene_in(tmp_path), ("",))
    shapes = [each for each in world.drawing.shapes() if each.object]
    triangles = surface(shapes)
    assert 0.4 * MOST_SCENE_TRIANGLES < len(triangles) <= MOST_SCENE_TRIANGLES
    model = world.scene.model
    whole = model.mesh_vert[model.mesh_face].astype(float)
    assert len(whole) > MOST_SCENE_TRIANGLES
    assert volume(triangles) == pytest.approx(volume(whole), rel=5e-3)
    corners = whole.reshape(-1, 3)
    geom = next(each for each in range(model.ngeom) if model.geom_type[each] == mujoco.mjtGeom.mjGEOM_MESH)
    turn = Rotation.from_quat(model.geom_quat[geom], scalar_first=True)
    nearest, _ = cKDTree(turn.apply(corners) + model.geom_pos[geom]).query(triangles.reshape(-1, 3))
    assert nearest.max() < 2e-3
    for number in range(len(world.drawing.shapes())):
        assert len(encode(Geom.of(world.drawing.shapes(), number, 2**63 - 1))) <= MAX_MESSAGE_BYTES
    assert shapes_of(world.scene, np.zeros(3)).coarser == ("brick",)


def test_small_meshes_are_whole_and_large_ones_share_what_is_left(tmp_path: Path) -> None:
    (tmp_path / "brick.obj").write_bytes(obj())
    (tmp_path / "ball.obj").write_bytes(ball(4000, 0.05))
    path = scene_in(tmp_path)
    body = '<body name="b{0}" pos="{0} 0 1"><freejoint/><geom name="g{0}" type="mesh" mesh="ball" mass=".2"/></body>'
    text = path.read_text().replace("<asset>", '<asset><mesh name="ball" file="ball.obj"/>')
    path.write_text(text.replace("</worldbody>", "".join(map(body.format, range(3))) + "</worldbody>"))
    drawn = shapes_of(load_scene(path, SEAT, STEP), np.zeros(3))
    counts: dict[int | None, int] = {}
    for shape in drawn.shapes:
        counts[shape.body] = counts.get(shape.body, 0) + len(shape.corners_m()) // 3
    assert counts[0] == len(FACES)
    assert all(0.4 * MOST_SCENE_TRIANGLES / 3 < counts[each] <= MOST_SCENE_TRIANGLES / 3 for each in (1, 2, 3))
    assert (drawn.boxed, drawn.coarser) == ((), ("g0", "g1", "g2"))
    settings = resolve({"object": {"kind": "scene", "file": str(path), "axes": 3}, "users": [{"tool": "ball"}]})
    (told,) = [each.text for each in scene_findings(settings) if each.topic == "drawn"]
    assert told.startswith("drawn by fewer triangles than they have, 3 in all: g0, g1, g2; a scene is drawn by 12000 ")


def test_where_a_share_has_no_form_left_a_mesh_is_a_box_and_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scene_surfaces, "MOST_SCENE_TRIANGLES", MOST_SCENE_TRIANGLES // 10)
    (tmp_path / "ball.obj").write_bytes(ball(40, 0.05))
    path, count = tmp_path / "scene.xml", 100
    body = '<geom name="g{0}" type="mesh" mesh="brick" pos="{0} 0 1"/>'
    path.write_text(
        SCENE.format(file="ball.obj", compiler="").replace(
            "</body>", "".join(map(body.format, range(count))) + "</body>"
        )
    )
    drawn = shapes_of(load_scene(path, SEAT, STEP), np.zeros(3))
    boxes = [shape for shape in drawn.shapes if shape.kind == "box"]
    assert 0 < len(boxes) == len(drawn.boxed) < count
    assert len(drawn.boxed) + len(drawn.coarser) == count + 1


def test_local_contact_leaves_meshes_to_the_server(tmp_path: Path) -> None:
    (tmp_path / "brick.obj").write_bytes(obj())
    path = scene_in(tmp_path)
    fixed = path.read_text().replace("<freejoint/>", "").replace('<geom type="mesh"', '<geom name="wall" type="mesh"')
    path.write_text(fixed)
    geometry = local_geometry(load_scene(path, [Held("ball", "left", "")], STEP), 0)
    assert geometry.why == ""
    assert geometry.left_out == ("wall",)
    assert {shape.kind for shape in geometry.shapes} == {"plane", "sphere"}


def test_another_mesh_is_another_scene(tmp_path: Path) -> None:
    """So no checkpoint and no recording takes it for the one that was."""
    path = scene_in(tmp_path)
    digests = []
    for away_m in (0.0, 0.0, 1e-6):
        (tmp_path / "brick.obj").write_bytes(obj((away_m, 0.0, 0.0)))
        digests.append(load_scene(path, SEAT, STEP).digest)
    assert digests[0] == digests[1] != digests[2]


def test_a_mesh_rests_on_the_floor_and_makes_no_energy(tmp_path: Path) -> None:
    (tmp_path / "brick.obj").write_bytes(obj())
    world = world_of(scene_in(tmp_path), ("",))
    held_j = world.energy_j
    for _ in range(256):
        world.step(np.zeros((1, 3)))
        assert world.energy_j <= held_j + 1e-9
    assert world.position[2] == pytest.approx(0.0, abs=1e-3)
    assert np.abs(world.velocity).max() < 1e-3


OUTSIDE = "is outside of the scene's folder; put it beside the scene, or below, or set object.folder = "
ABSOLUTE = "is an absolute path; put it beside the scene, or below, and name it from there"


@pytest.mark.parametrize(
    ("file", "compiler", "words"),
    [
        ("../brick.obj", "", OUTSIDE),
        ("/etc/brick.obj", "", ABSOLUTE),
        ("brick.obj", '<compiler meshdir=".."/>', OUTSIDE),
        ("brick.obj", '<compiler assetdir="/tmp"/>', ABSOLUTE),
        ("link.obj", "", OUTSIDE),
        ("none.obj", "", r"scene.xml: mesh 'none.obj': there is no such file"),
        ("folder.obj", "", r"mesh 'folder.obj': is no regular file"),
        ("empty.obj", "", "scene.xml: does not load: "),
        ("noise.stl", "", "scene.xml: does not load: "),
        ("large.stl", "", r"mesh 'large.stl': has more than 32 MB; make it smaller"),
        ("far.obj", "", r"scene.xml: reaches 1.73e\+30 m, more than 10000 m; give lengths in metres"),
        ("brick.dae", "", r"scene.xml: does not load: .*brick.dae"),
    ],
)
def test_a_mesh_that_cannot_be_used_is_named(scene_folder: Path, file: str, compiler: str, words: str) -> None:
    with pytest.raises(SceneError, match=words) as caught:
        load_scene(scene_in(scene_folder, file, compiler), SEAT, STEP)
    assert "\n" not in str(caught.value)


@pytest.fixture
def scene_folder(tmp_path: Path) -> Path:
    """A folder with good and bad files, and good ones outside of it."""
    folder = tmp_path / "scene"
    (folder / "folder.obj").mkdir(parents=True)
    for path in (tmp_path / "brick.obj", *(folder / part / "brick.obj" for part in (".", "a", "b"))):
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(obj())
    (folder / "link.obj").symlink_to(tmp_path / "brick.obj")
    (folder / "far.obj").write_bytes(obj().replace(b"0.03", b"1e30").replace(b"0.02", b"1e30"))
    (folder / "empty.obj").write_bytes(b"")
    (folder / "noise.stl").write_bytes(bytes(range(256)))
    (folder / "brick.dae").write_bytes(b"<COLLADA/>")
    with (folder / "large.stl").open("wb") as file:
        file.truncate(MOST_FILE_BYTES + 1)  # sparse
    return folder


def test_a_mesh_with_texture_coordinates_that_nobody_uses_is_read_without_a_word(tmp_path: Path) -> None:
    (tmp_path / "brick.obj").write_bytes(b"vt 0 0\n" + obj())
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        load_scene(scene_in(tmp_path), SEAT, STEP)
    assert not said
