"""`cogrip worlds`, and how a kind of object that cannot be had is said, before anything starts."""

import os
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from cogrip.cli.session.joined_device import judge_seat
from cogrip.cli.settings.settings_file import load
from cogrip.cli.terminal.problem import BadInput
from cogrip.cli.worlds import check as check_command
from cogrip.devices.registry import make
from cogrip.protocol.settings.room import seat_settings
from cogrip.server.worlds import registry

from tests.cli.command import Cogrip

SETTINGS = '[object]\nkind = "{kind}"\n'
BROKEN = Path(__file__).parents[1] / "server" / "broken_worlds.py"
MORE = """
class Pair(Springs):
    seats_allowed = (2,)
    axes_allowed = (2, 3)


class Odd(Springs):
    seats_allowed = 2
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an allowed folder with worlds in mine.py, which is the present one."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(registry.ALLOWED, str(tmp_path))
    (tmp_path / "mine.py").write_text(f'{BROKEN.read_text()}\n{MORE}\nNUMBER = 7\nprint("it runs")\n')
    (tmp_path / "room.toml").write_text(SETTINGS.format(kind="python:mine.py:Springs"))
    return tmp_path


def refused(kind: str) -> str:
    Path("room.toml").write_text(SETTINGS.format(kind=kind))
    with pytest.raises(BadInput) as caught:
        load(Path("room.toml"))
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_file_is_beside_its_settings_and_on_the_command_line_in_this_folder(folder: Path) -> None:
    assert load(Path("room.toml")).object.kind == f"python:{folder}/mine.py:Springs"
    (folder / "below").mkdir()
    (folder / "below" / "room.toml").write_text(SETTINGS.format(kind="cube"))
    override = ["object.kind=python:mine.py:Springs"]
    assert load(Path("below/room.toml"), override).object.kind == f"python:{folder}/mine.py:Springs"


FAILING = ("def", "import nothing_of_that_name", "1 / 0", "raise SystemExit(3)")
REFUSED = {
    "cubes": 'there is no world "cubes"; did you mean "cube"?',
    "zeppelin": 'there is no world "zeppelin"; there are: cube, faces, wall, scene; or python:FILE.py:CLASS',
    "python:mine.py": 'write "python:FILE.py:CLASS"',
    "python:mine.txt:Springs": 'write "python:FILE.py:CLASS"',
    "python:none.py:Springs": "none.py: cannot be read: No such file or directory",
    "python:mine.py:None1": "mine.py has no class None1; name one that is in it",
    "python:mine.py:NUMBER": "is no class of worlds; derive it from",
    "python:mine.py:HoldsMuch": "python:mine.py:HoldsMuch: holds 9.61 J at first, more than 1",
    "a\\u001bb": "letters, digits, blanks",
    "python:bad0.py:World": "SyntaxError",
    "python:bad1.py:World": "ModuleNotFoundError",
    "python:bad2.py:World": "ZeroDivisionError: division by zero; correct it",
    "python:bad3.py:World": "SystemExit: 3",
    "python:mine.py:Odd": "seats_allowed = 2: give the counts as (1,) or range(1, 5)",
    "python:mine.py:Pair": "object.axes = 1, but python:mine.py:Pair takes 2 or 3: change one",
}


@pytest.mark.parametrize("kind", REFUSED)
def test_a_kind_that_cannot_be_had_is_said_in_one_line(kind: str, folder: Path) -> None:
    for number, source in enumerate(FAILING):
        (folder / f"bad{number}.py").write_text(source)
    assert REFUSED[kind] in refused(kind)


@pytest.mark.parametrize("allowed", ["", "/somewhere/else", "allowed"])
@pytest.mark.parametrize("file", ["mine.py", "allowed/link.py", "allowed/../mine.py"])
def test_a_file_elsewhere_is_not_run_nor_by_a_link_out_of_an_allowed_folder(
    file: str, allowed: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "allowed").mkdir()
    (folder / "allowed" / "link.py").symlink_to(folder / "mine.py")
    monkeypatch.setenv(registry.ALLOWED, str(folder / allowed) if allowed else "")
    said = refused(f"python:{file}:Springs")
    assert "is a program, and settings may be anybody's" in said
    assert registry.ALLOWED in said
    assert "it runs" not in capsys.readouterr().out


def test_the_flag_allows_folders_for_this_process_and_its_children(
    folder: Path, monkeypatch: pytest.MonkeyPatch, cogrip: Cogrip
) -> None:
    monkeypatch.setenv(registry.ALLOWED, "/somewhere/else")
    assert cogrip("lab room.toml --python-worlds . --set seconds=0.1 --json -")[0] in (0, 1)
    assert os.environ[registry.ALLOWED] == f"/somewhere/else:{folder}"
    cogrip.refuses("--python-worlds nowhere: there is no such folder", "lab room.toml --python-worlds nowhere")


def test_a_client_needs_no_world(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv(registry.ALLOWED, "")
    settings = load(Path("room.toml"), world=False)
    seat = seat_settings(settings, 0)
    assert seat.object.kind == "python:mine.py:Springs"
    assert (seat.one_sided, seat.asked_npm, seat.predicted_stiffness(3.0)) == (False, None, None)
    assert judge_seat("sim:phantom", False, print, seat, make("sim:phantom").capability) == ""
    assert "it runs" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["coupling.kind=tdpa"], 'coupling.kind = "tdpa" does not fit it; set coupling.kind = "wave"'),
        (["coupling.server_step=paper"], 'coupling.server_step = "paper" does not fit it'),
        (["coupling.compensate=true"], "it has no spring to stiffen; set it to false"),
        (["users.0.tool=pad"], "users.0.tool = 'pad' is for object.kind"),
        (
            ["object.kind=python:mine.py:Pair", "object.axes=3"],
            "users = 1, but python:mine.py:Pair takes 2: change one",
        ),
    ],
)
def test_settings_that_fit_no_world_from_outside(overrides: list[str], words: str) -> None:
    with pytest.raises(BadInput) as caught:
        load(Path("room.toml"), overrides)
    assert words in str(caught.value).replace("\n", " ")


def test_worlds_are_listed_with_those_of_other_packages(
    monkeypatch: pytest.MonkeyPatch, cogrip: Cogrip, folder: Path
) -> None:
    monkeypatch.syspath_prepend(folder)
    given = {"springs": "mine:Springs", "torn": "torn:World", "cube": "mine:Springs"}
    monkeypatch.setattr(registry, "entry_points", lambda group: [EntryPoint(*each, group) for each in given.items()])
    monkeypatch.setenv("COLUMNS", "200")
    registry.entry_point_kinds.cache_clear()
    try:
        lines = {line.split()[0]: line for line in cogrip.out("worlds").splitlines() if line}
        torn = refused("torn")
    finally:
        registry.entry_point_kinds.cache_clear()
    assert "torn fails as it is loaded: ModuleNotFoundError: No module named 'torn'; mend or remove its package" in torn
    assert "Masses on springs" in lines["springs"]
    assert "No module named 'torn'" in lines["torn"]
    assert "A free object that people grip from all sides." in lines["cube"], "ours cannot be replaced"


def test_a_check_says_what_is_broken_and_fails(monkeypatch: pytest.MonkeyPatch, cogrip: Cogrip) -> None:
    monkeypatch.setattr(check_command, "CHECKS", (check_command.CHECKS[0], check_command.CHECKS[6]))
    assert "2 of 2 promises kept" in cogrip.out("worlds check python:mine.py:Springs")
    said = cogrip.out("worlds check python:mine.py:ForgetsSpeed", code=1)
    assert "✓ counts_its_energy" in said
    assert "✗ restores_bit_for_bit, 1 seat, 1 axis: a world that was elsewhere goes on with the same bits" in said
    assert "KeyError: 'bead 7' (line " in cogrip.out("worlds check python:mine.py:Raises", code=1)

    cogrip.refuses("which one? Give settings with it, such as lift", "worlds check scene")
    cogrip.refuses('there is no world "cubes"; did you mean "cube"?', "worlds check cubes")
    cogrip.refuses("mine.py has no class Absent", "worlds check python:mine.py:Absent")
    cogrip.refuses("there is no such file", "worlds check none.toml")


def test_a_world_of_ones_own_gets_advice_of_its_line_and_a_session(cogrip: Cogrip, folder: Path) -> None:
    people = '[link]\ndelay_ms = 40.0\n[[users]]\nname = "anna"\nhand = "reach&stroke_s=0.2"\n'
    (folder / "quiet.py").write_text(BROKEN.read_text())
    settings = 'seconds = 1.0\n[object]\nkind = "python:quiet.py:Springs"\n'
    (folder / "room.toml").write_text(f"{settings}{people}")
    found = cogrip.answer("advise room.toml")
    levels = {each["topic"]: each["level"] for each in found["findings"]}
    assert "a session of 1 s with these settings" in found["findings"][-1]["text"]
    assert levels.pop("laboratory") == "warning", "this world makes energy"
    assert levels == {"device": "ok", "felt": "ok", "free motion": "warning", "conditions": "note"}
    assert "no linear model" in found["findings"][3]["text"]
    assert found["laboratory"]["seconds"] == 1.0
    assert "laboratory" not in cogrip.out("advise room.toml --no-laboratory")


DRAWER = """<mujoco><option iterations="1"/><worldbody><body pos="0.1 0 0.05"><joint type="slide" axis="1 0 0"/>
<geom type="box" size="0.03 0.03 0.03" mass="0.3"/></body></worldbody>{more}</mujoco>"""


def test_check_tells_what_becomes_of_a_scene(cogrip: Cogrip, folder: Path) -> None:
    (folder / "drawer.xml").write_text(DRAWER.format(more=""))
    answer = cogrip.answer("worlds check drawer.xml --set object.substeps=8")
    rows = {(row["topic"], row["level"]): row["text"] for row in answer["rows"]}
    assert answer["usable"] is True
    assert "stepped 8 times a frame" in rows["loads", "ok"]
    assert rows["added", "ok"].startswith("pad for user2 at ")
    assert "iterations (1 > 100)" in rows["contact", "note"]
    assert rows["felt", "ok"].startswith("user1, user2: a fixed body is felt with ")
    assert rows["energy", "ok"].startswith("in 100 random pushes the scene made 0 mJ")
    assert "of a processor" in rows["cost", "ok"]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ('<asset><texture name="t" type="2d" file="wood.png"/></asset>', "✗ loads: drawer.xml: texture 'wood.png'"),
        ("</worldbody>", "✗ loads: drawer.xml: "),
    ],
)
def test_check_of_a_scene_that_cannot_be_used_says_why(cogrip: Cogrip, folder: Path, more: str, words: str) -> None:
    (folder / "drawer.xml").write_text(DRAWER.format(more=more))
    assert cogrip.out("worlds check drawer.xml", code=1).startswith(words)
    answer = cogrip.answer("worlds check drawer.xml", code=1)
    assert (answer["usable"], [row["topic"] for row in answer["rows"]]) == (False, ["loads"])


def test_check_names_the_command_that_reads_what_lies_outside_of_a_scenes_folder(cogrip: Cogrip, folder: Path) -> None:
    (folder / "scene").mkdir()
    (folder / "part.xml").write_text(DRAWER.format(more=""))
    (folder / "scene" / "scene.xml").write_text('<mujoco><include file="../part.xml"/></mujoco>')
    answer = cogrip.answer("worlds check scene/scene.xml", code=1)
    assert [(row["topic"], row["level"]) for row in answer["rows"]] == [("loads", "refused"), ("to load it", "note")]
    command = answer["rows"][1]["text"].split("`")[1]
    assert command == f"cogrip worlds check {folder}/scene/scene.xml --set object.folder={folder}"
    assert cogrip.answer(command.removeprefix("cogrip "))["usable"] is True


CLOTH = """<mujoco><worldbody>
<flexcomp name="cloth" type="grid" count="6 6 1" spacing=".02 .02 .02" pos="0 0 .1" dim="2" radius=".002" mass=".05">
<pin id="0 5 30 35"/><edge equality="true"/></flexcomp>
<body name="ball" pos="0 0 .14"><freejoint/><geom type="sphere" size=".015" mass=".02"/></body></worldbody></mujoco>"""


@pytest.mark.long
def test_check_of_a_scene_that_makes_energy_is_no_success_and_its_cure_is_one(cogrip: Cogrip, folder: Path) -> None:
    (folder / "cloth.xml").write_text(CLOTH)
    out = cogrip.out("worlds check cloth.xml", code=1)
    assert "✗ energy: " in out
    assert "raise object.substeps" in out
    assert "✗" not in cogrip.out("worlds check cloth.xml --set object.substeps=8")


def test_a_scene_that_is_not_there_is_a_line(cogrip: Cogrip) -> None:
    assert cogrip.err("worlds check none.xml").startswith("cogrip: none.xml: there is no such file; give MJCF or URDF")
    assert "--set and --json are of a scene's file" in cogrip.err("worlds check cube --json -")
