"""Settings files of scenes: where the scene is looked for, and how one that cannot be used is said."""

from pathlib import Path

import pytest

from cogrip.cli.serving.served_rooms import warn_of
from cogrip.cli.session import joined_device
from cogrip.cli.session.joined_device import judge_seat
from cogrip.cli.settings.settings_file import load
from cogrip.cli.settings.shipped_settings import shipped_scene
from cogrip.cli.terminal.problem import BadInput
from cogrip.devices.registry import make
from cogrip.protocol.settings.room import seat_settings

from tests.cli.command import Cogrip

SETTINGS = '[object]\nkind = "scene"\naxes = 3\nfile = "{file}"\n'
SCENE = "<mujoco><worldbody><geom type='plane' size='1 1 1'/></worldbody></mujoco>"


@pytest.fixture
def room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the path of settings with mine.xml in a folder below the present one."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "room"
    folder.mkdir()
    (folder / "mine.xml").write_text(SCENE)
    (folder / "room.toml").write_text(SETTINGS.format(file="mine.xml"))
    return folder / "room.toml"


def test_a_scene_is_beside_its_settings_on_the_command_line_in_this_folder_or_comes_with_cogrip(room: Path) -> None:
    assert load(Path("room/room.toml")).object.file == str(room.with_name("mine.xml"))
    Path("other.xml").write_text(SCENE)
    assert load(room, ["object.file=other.xml"]).object.file == str(Path("other.xml").absolute())
    assert load(room, ["object.file=pile.xml"]).object.file == str(shipped_scene("pile.xml"))
    room.write_text(SETTINGS.format(file="lift.xml"))
    assert load(room).object.file == str(shipped_scene("lift.xml"))
    room.with_name("lift.xml").write_text(SCENE)
    assert load(room).object.file == str(room.with_name("lift.xml"))


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("object.file=none.xml", r"^--set object\.file: .*/none\.xml: there is no such file; give MJCF or URDF$"),
        ("users.0.tool=hand", r"room\.toml: object\.file: mine\.xml: there is no body 'hand' to be a tool"),
        ("object.axes=2", r"^--set object\.axes=2: .* object\.axes = 2, but a scene has 3 \(places\) or 6"),
    ],
)
def test_a_scene_that_cannot_be_used_is_said_before_anything_starts(room: Path, override: str, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        load(room, [override])


LIT = f"<mujoco><option timestep='0.01'/><worldbody><light pos='0 0 1'/>{SCENE.partition('<worldbody>')[2]}"


def test_who_runs_or_serves_a_scene_is_told_once_what_is_not_drawn_and_what_was_changed(
    room: Path, cogrip: Cogrip, tmp_path: Path
) -> None:
    told = [
        "not drawn of the scene: lights (a view has its own)",
        "the scene sets timestep (0.01 > 0.00195312), which does not",
    ]
    room.with_name("mine.xml").write_text(LIT)
    _, _, errors = cogrip("lab room/room.toml --set seconds=0.1 --json -")
    said: list[str] = []
    settings = load(room)
    kept = warn_of([settings], ("127.0.0.1", 1), False, lambda text: said.append(str(text)))
    for words in told:
        assert " ".join(errors.split()).count(f"note: {words}") == 1
        assert sum(f"note: room {settings.name}: {words}" in text for text in said) == 1
    assert kept == {settings.name: []}, "a note is no warning"
    room.with_name("mine.xml").write_text(SCENE)
    assert "note" not in cogrip("lab room/room.toml --set seconds=0.1 --json -")[2]


def test_a_device_in_a_scene_is_refused_what_it_does_not_carry_and_warned_of_nothing_else() -> None:
    def judged(allowed: bool, *overrides: str) -> tuple[str, list[str]]:
        said: list[str] = []
        seat, record = seat_settings(load(Path("lift"), overrides), 0), make("sim:phantom", axes=3).capability
        return judge_seat("sim:phantom", allowed, said.append, seat, record), said

    assert judged(False) == ("", [])
    heavy = "coupling.impedance_nspm=500"
    assert "b = 500 N s/m is more than device sim:phantom carries" in judged(False, heavy)[0]
    refused, said = judged(True, heavy)
    assert (refused, len(said)) == ("", 1)


def test_a_seat_of_a_copied_scene_is_refused_where_there_is_no_mujoco(monkeypatch: pytest.MonkeyPatch) -> None:
    seat, record = (
        seat_settings(load(Path("lift"), ["coupling.kind=partner"]), 0),
        make("sim:phantom", axes=3).capability,
    )
    assert judge_seat("sim:phantom", False, print, seat, record) == ""
    monkeypatch.setattr(joined_device, "find_spec", lambda name: None)
    refused = judge_seat("sim:phantom", True, print, seat, record)
    assert refused.startswith("refused: each client steps a copy of this room's scene")
    assert "mujoco-core" in refused
    assert "\n" not in refused
