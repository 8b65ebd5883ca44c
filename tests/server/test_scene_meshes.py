"""Mesh files of scenes: read from the scene's folder alone, bounded, part of its digest, and drawn as boxes."""

import struct
import warnings
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from cogrip.server.worlds.local_geometry import local_geometry
from cogrip.server.worlds.scene_file import Held, Scene, load_scene
from cogrip.server.worlds.scene_shapes import shapes_of
from cogrip.server.worlds.scene_text import MOST_BYTES, SceneError

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


def drawn(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return middle and half edges of the drawn mesh."""
    (shape,) = [each for each in shapes_of(scene, np.zeros(3))[0] if each.object]
    assert shape.kind == "box"
    return np.array(shape.place_m), np.sort(shape.size_m)


def test_a_mesh_is_drawn_as_the_box_around_it(tmp_path: Path) -> None:
    """Also one that lies beside its own origin."""
    away = (0.1, 0.05, -0.02)
    (tmp_path / "brick.obj").write_bytes(obj(away))
    place, size = drawn(load_scene(scene_in(tmp_path), SEAT, STEP))
    assert place == pytest.approx(away, abs=1e-6)
    assert size == pytest.approx(sorted(HALF_M), abs=1e-6)


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


OUTSIDE = "is outside of the scene's folder; put it beside the scene, or below"


@pytest.mark.parametrize(
    ("file", "compiler", "words"),
    [
        ("../brick.obj", "", OUTSIDE),
        ("/etc/brick.obj", "", OUTSIDE),
        ("brick.obj", '<compiler meshdir=".."/>', OUTSIDE),
        ("brick.obj", '<compiler assetdir="/tmp"/>', OUTSIDE),
        ("link.obj", "", OUTSIDE),
        ("none.obj", "", r"scene.xml: mesh 'none.obj': there is no such file"),
        ("folder.obj", "", r"mesh 'folder.obj': is no regular file"),
        ("empty.obj", "", "scene.xml: does not load: "),
        ("noise.stl", "", "scene.xml: does not load: "),
        ("large.stl", "", "its meshes have more than 8 MB together; make them coarser"),
        ("far.obj", "", r"scene.xml: reaches 1.73e\+30 m, more than 10000 m; give lengths in metres"),
        ("brick.dae", "", r"refers to other files \(brick.dae\), which are not read"),
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
    for path in (tmp_path / "brick.obj", folder / "brick.obj"):
        path.write_bytes(obj())
    (folder / "link.obj").symlink_to(tmp_path / "brick.obj")
    (folder / "far.obj").write_bytes(obj().replace(b"0.03", b"1e30").replace(b"0.02", b"1e30"))
    (folder / "empty.obj").write_bytes(b"")
    (folder / "noise.stl").write_bytes(bytes(range(256)))
    (folder / "large.stl").write_bytes(bytes(MOST_BYTES + 1))
    return folder


def test_a_mesh_with_texture_coordinates_that_nobody_uses_is_read_without_a_word(tmp_path: Path) -> None:
    (tmp_path / "brick.obj").write_bytes(b"vt 0 0\n" + obj())
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        load_scene(scene_in(tmp_path), SEAT, STEP)
    assert not said


def test_two_files_of_one_name_are_refused(tmp_path: Path) -> None:
    """MuJoCo would take one for the other."""
    for part in ("a", "b"):
        (tmp_path / part).mkdir()
        (tmp_path / part / "brick.obj").write_bytes(obj())
    text = SCENE.format(file="a/brick.obj", compiler="").replace(
        "</asset>", '<mesh name="other" file="b/brick.obj"/></asset>'
    )
    (tmp_path / "scene.xml").write_text(text)
    with pytest.raises(SceneError, match=r"two mesh files are called 'brick\.obj'"):
        load_scene(tmp_path / "scene.xml", SEAT, STEP)
