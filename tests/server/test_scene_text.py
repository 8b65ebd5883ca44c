"""Files of a scene: found where MuJoCo finds them, in the scene's folder alone, and all of them part of its digest."""

import struct
import zlib
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cogrip.protocol.recording.reader import RecordingError, open_recording
from cogrip.protocol.settings.room import resolve
from cogrip.results.reading.folder import SERVER_RECORDING
from cogrip.results.replay.verify import verify
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.server.worlds.scenes import scene_text
from cogrip.server.worlds.scenes.scene_file import Held, load_scene
from cogrip.server.worlds.scenes.scene_text import OutsideError, SceneError, read_scene
from cogrip.sim.input_files import files_read

from tests.server.test_scene_meshes import obj

STEP = 1 / 512
SEAT = [Held("", "left", "")]
BOX = '<mujoco><worldbody><body name="box" pos="0 0 .03"><freejoint/>{geom}</body></worldbody></mujoco>'
GEOM = '<geom type="box" size=".03 .03 .03" mass=".2"/>'


def png(pixels: int = 4) -> bytes:
    """Return a picture of one colour."""
    rows = zlib.compress((b"\0" + b"\x80\x40\x20" * pixels) * pixels)
    parts = [(b"IHDR", struct.pack(">2I5B", pixels, pixels, 8, 2, 0, 0, 0)), (b"IDAT", rows), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + tag + data + struct.pack(">I", zlib.crc32(tag + data)) for tag, data in parts
    )


def heights(rows: int = 4) -> bytes:
    """Return a height field as MuJoCo has it."""
    return struct.pack("<2i", rows, rows) + np.linspace(0.0, 1.0, rows * rows, dtype="<f4").tobytes()


FILES: dict[str, str | bytes] = {
    "scene.xml": """<mujoco>
      <compiler meshdir="meshes" texturedir="pictures"/>
      <include file="parts/robot.xml"/>
      <asset>
        <mesh name="shown" file="visual/part.obj"/><mesh name="felt" file="collision/part.obj"/>
        <texture name="wood" type="cube" file="wood.png"/><material name="wood" texture="wood"/>
        <hfield name="ground" file="ground.bin" size=".3 .3 .02 .01"/>
      </asset>
      <worldbody>
        <geom type="hfield" hfield="ground" pos="0 0 -.1"/>
        <body name="part" pos="0 0 .1"><freejoint/>
          <geom type="mesh" mesh="shown" contype="0" conaffinity="0" mass="0" material="wood"/>
          <geom type="mesh" mesh="felt" mass=".2"/>
        </body>
      </worldbody>
    </mujoco>""",
    "parts/robot.xml": '<mujoco><include file="arm.xml"/><asset><mesh name="claw" file="claw.obj"/></asset></mujoco>',
    "parts/arm.xml": BOX.format(geom=GEOM),
    "parts/claw.obj": obj(),
    "meshes/visual/part.obj": obj(),
    "meshes/collision/part.obj": obj((0.01, 0.0, 0.0)),
    "meshes/ground.bin": heights(),
    "pictures/wood.png": png(),
}
"""A scene of every kind of file. What robot.xml names lies beside that."""


def write(folder: Path, files: dict[str, str | bytes] = FILES) -> Path:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return folder / next(iter(files))


def test_every_kind_of_file_is_found_where_mujoco_finds_it(tmp_path: Path) -> None:
    path = write(tmp_path)
    alone, ours = mujoco.MjModel.from_xml_path(str(path)), load_scene(path, SEAT, STEP).model
    assert {ours.body(name).id > 0 for name in ("box", "part")} == {True}
    for key in ("mesh_vert", "hfield_data", "tex_data", "mesh_pos"):
        assert np.array_equal(getattr(ours, key), getattr(alone, key)), key
    assert not np.array_equal(*(ours.mesh_pos[ours.mesh(name).id] for name in ("shown", "felt"))), (
        "two files of one name"
    )


def test_nothing_beside_the_scene_is_read_whatever_lies_in_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path / "elsewhere")
    path = write(tmp_path / "here", {"scene.xml": '<mujoco><include file="parts/arm.xml"/></mujoco>'})
    monkeypatch.chdir(tmp_path / "elsewhere")
    with pytest.raises(
        SceneError, match=r"^scene\.xml: include 'parts/arm\.xml': there is no such file; put it beside"
    ):
        load_scene(path, SEAT, STEP)


def test_each_file_is_part_of_the_digest_and_a_recording_replays_with_all_of_them_alone(tmp_path: Path) -> None:
    path = write(tmp_path)
    users = [{"name": "anna", "device": "sim:ideal", "hand": "reach&amplitude_m=0.04"}]
    settings = resolve({"seconds": 0.3, "object": {"kind": "scene", "file": str(path), "axes": 3}, "users": users})
    (tmp_path / "run").mkdir()
    run_laboratory(settings, tmp_path / "run")
    recording, read = open_recording(tmp_path / "run" / SERVER_RECORDING), files_read(settings)
    assert verify(recording).exact
    for changed, other in FILES.items():
        as_it_was = (tmp_path / changed).read_bytes()
        more = b"\n" if isinstance(other, bytes) else b"<!-- more -->"
        if changed.endswith(".bin"):
            (tmp_path / changed).write_bytes(heights()[:-4] + b"\0\0\0\0")
        else:
            (tmp_path / changed).write_bytes((other.encode() if isinstance(other, str) else other) + more)
        assert files_read(settings) != read, "a sweep that goes on knows it as well"
        with pytest.raises(RecordingError, match=r"is another scene \(\w{16}\) than the recorded one \(\w{16}\); put"):
            verify(recording)
        (tmp_path / changed).write_bytes(as_it_was)
    assert files_read(settings) == read
    assert verify(recording).exact


OUTSIDE = "is outside of the scene's folder; put it beside the scene, or below, or set object.folder = "
ABSOLUTE = "is an absolute path; put it beside the scene, or below, and name it from there"


@pytest.mark.parametrize(
    ("element", "words"),
    [
        ('<include file="../out.xml"/>', f"include '../out.xml' {OUTSIDE}"),
        ('<include file="/etc/passwd"/>', f"include '/etc/passwd' {ABSOLUTE}"),
        ('<include file="link.xml"/>', f"include 'link.xml' {OUTSIDE}"),
        ('<Include file="../out.xml"/>', f"include '../out.xml' {OUTSIDE}"),
        ('<include file="file:///etc/passwd"/>', f"include 'file:///etc/passwd' {ABSOLUTE}"),
        ('<asset><texture type="2d" file="../wood.png"/></asset>', f"texture '../wood.png' {OUTSIDE}"),
        ('<asset><texture type="cube" fileright="/wood.png"/></asset>', f"texture '/wood.png' {ABSOLUTE}"),
        ('<asset><hfield file="../ground.bin" size="1 1 1 1"/></asset>', f"hfield '../ground.bin' {OUTSIDE}"),
        ('<asset><model name="m" file="../out.xml"/></asset>', f"model '../out.xml' {OUTSIDE}"),
        ('<compiler meshdir=".."/><asset><mesh file="sub/../brick.obj"/></asset>', f"mesh 'sub/../brick.obj' {OUTSIDE}"),
        ('<worldbody><flexcomp name="f" type="mesh" file="../f.obj"/></worldbody>', f"flexcomp '../f.obj' {OUTSIDE}"),
        ('<include file="none.xml"/>', "include 'none.xml': there is no such file"),
        ('<include file="self.xml"/>', "File .*self.xml' already included"),
        ('<include file="folder"/>', "include 'folder': is no regular file"),
        ('<include file=""/>', "include '': is no regular file"),
        ('<asset><texture type="2d" file="noise.png"/></asset>', "does not load: "),
        ('<asset><mesh file="deep.obj"/></asset>', "mesh 'deep.obj': has more than 32 MB; make it smaller"),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_used_has_its_line(tmp_path: Path, element: str, words: str) -> None:
    (tmp_path / "out.xml").write_text(BOX.format(geom=GEOM))
    path = write(
        tmp_path / "scene",
        {"scene.xml": f"<mujoco>{element}</mujoco>", "noise.png": bytes(range(200)), "folder/x": b""},
    )
    (path.parent / "link.xml").symlink_to(tmp_path / "out.xml")
    (path.parent / "self.xml").write_text('<mujoco><include file="self.xml"/></mujoco>')
    with (path.parent / "deep.obj").open("wb") as file:
        file.truncate(40_000_000)  # sparse
    with pytest.raises(SceneError, match=words) as caught:
        load_scene(path, SEAT, STEP)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("scene.xml: ")


def test_a_folder_that_the_settings_name_may_hold_what_several_scenes_share(tmp_path: Path) -> None:
    write(tmp_path / "shared", {"box.xml": BOX.format(geom=GEOM)})
    path = write(tmp_path / "one", {"scene.xml": '<mujoco><include file="../shared/box.xml"/></mujoco>'})
    with pytest.raises(OutsideError, match=rf'set object\.folder = "{tmp_path}"$') as caught:
        load_scene(path, SEAT, STEP)
    assert caught.value.folder == str(tmp_path)
    assert load_scene(path, SEAT, STEP, tmp_path).model.body("box").id > 0
    with pytest.raises(SceneError, match=r"is not in .*shared; name a folder above it as object.folder"):
        load_scene(path, SEAT, STEP, tmp_path / "shared")


MESH_UP = """<mujoco><compiler meshdir="../{up}meshes"/><include file="../arm.xml"/>
<asset><mesh file="brick.obj"/></asset></mujoco>"""


def test_the_folder_that_is_named_is_the_least_that_has_all_that_the_texts_name_and_none_of_them_is_read(
    tmp_path: Path,
) -> None:
    path = write(tmp_path / "a" / "robots" / "one", {"scene.xml": MESH_UP.format(up="")})
    with pytest.raises(
        OutsideError, match=r"^scene\.xml: include '\.\./arm\.xml' is outside .*, and 1 more; put it"
    ) as caught:
        load_scene(path, SEAT, STEP)
    assert caught.value.folder == str(tmp_path / "a" / "robots")
    write(tmp_path / "a" / "meshes", {"brick.obj": b""})
    path.write_text(MESH_UP.format(up="../"))
    with pytest.raises(OutsideError) as caught:
        load_scene(path, SEAT, STEP)
    assert caught.value.folder == str(tmp_path / "a")
    (tmp_path / "a" / "robots" / "arm.xml").write_text('<mujoco><include file="../../../base.xml"/></mujoco>')
    with pytest.raises(OutsideError) as caught:
        load_scene(path, SEAT, STEP)
    assert caught.value.folder == str(tmp_path / "a"), "what a file outside names is not known"
    with pytest.raises(OutsideError) as caught:
        load_scene(path, SEAT, STEP, tmp_path / "a")
    assert caught.value.folder == str(tmp_path), "nor before it may be read"
    path.write_text('<mujoco><include file="../one/part.xml"/></mujoco>')
    with pytest.raises(OutsideError) as caught:
        load_scene(path, SEAT, STEP)
    assert caught.value.folder == str(tmp_path / "a" / "robots"), "above every folder on the way"
    path.write_text(f'<mujoco><include file="{"../" * 40}etc/passwd"/></mujoco>')
    with pytest.raises(
        OutsideError, match=r"outside of the scene's folder; put it beside the scene, or below$"
    ) as caught:
        load_scene(path, SEAT, STEP)
    assert caught.value.folder == "", "the whole disk is no folder of a scene"


def test_files_are_bounded_together_and_texts_as_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path)
    whole = sum(len(content) for content in FILES.values()) - len(FILES["scene.xml"])
    monkeypatch.setattr(scene_text, "MOST_FILES_BYTES", whole)
    read_scene(path)
    monkeypatch.setattr(scene_text, "MOST_FILES_BYTES", whole - 1)
    with pytest.raises(SceneError, match=r"its files have more than .* MB together; make them coarser"):
        read_scene(path)
    monkeypatch.undo()
    monkeypatch.setattr(scene_text, "MOST_TEXTS", 3)
    read_scene(path)
    monkeypatch.setattr(scene_text, "MOST_TEXTS", 2)
    with pytest.raises(SceneError, match="includes more than 2 files; leave some out"):
        read_scene(path)


def test_a_model_within_a_scene_has_directories_of_its_own(tmp_path: Path) -> None:
    arm = BOX.format(geom='<geom type="mesh" mesh="m" mass=".1"/>').replace(
        "<worldbody>", '<compiler meshdir="hulls"/><asset><mesh name="m" file="m.obj"/></asset><worldbody>', 1
    )
    attached = '<worldbody><frame><attach model="arm" body="box" prefix="a/"/></frame></worldbody>'
    scene = f'<mujoco><asset><model name="arm" file="arm/arm.xml"/></asset>{attached}</mujoco>'
    path = write(tmp_path, {"scene.xml": scene, "arm/arm.xml": arm, "arm/hulls/m.obj": obj()})
    assert load_scene(path, SEAT, STEP).model.body("a/box").id > 0
