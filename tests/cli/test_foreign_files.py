"""Files of others that cannot be used: one line and an exit code, whatever they raise, wherever they come in."""

from pathlib import Path

import pytest

from cogrip.cli.main import main
from cogrip.experiments.study.study_file import StudyError
from cogrip.protocol.foreign_file import ForeignFileError
from cogrip.protocol.recording.reader import RecordingError
from cogrip.protocol.settings.table import SettingsError
from cogrip.server.checkpoint import CheckpointError
from cogrip.server.worlds.registry import WorldKindError
from cogrip.server.worlds.scenes.scene_text import SceneError
from cogrip.server.worlds.world import WorldError
from cogrip.sim.delay_trace import TraceError

from tests.cli.command import Cogrip

WORLDS = Path(__file__).resolve().parents[2] / "docs" / "examples" / "worlds"
HEAD = "from cogrip.server.worlds.tool_world import ToolWorld\n"
BROKEN = {  # Each entry is what stands in a world's file, and what is said of it.
    "raises": ("raise RuntimeError('two\\nlines')", "RuntimeError: two lines"),
    "exits": ("raise SystemExit(0)", "SystemExit"),
    "no Python": ("def", "SyntaxError"),
    "nothing in it": ("", "has no class World"),
    "no class": ("World = 7", "is no class of worlds"),
    "refuses to be looked at": ("def __getattr__(name):\n    raise KeyError(name)", "KeyError: 'World'"),
    "counts that fail": (
        f"""{HEAD}
class Bad(tuple):
    def __iter__(self):
        raise OSError('no')
class World(ToolWorld):
    axes_allowed = Bad((1,))""", "OSError: no",
    ),
    "fails as it is made": (f"{HEAD}class World(ToolWorld):\n    pass", "abstract class World"),
}  # fmt: skip
ROOM = 'name = "w"\nseconds = 0.1\n[object]\nkind = "python:world.py:World"\n[[users]]\nname = "anna"\nhand = "reach"\n'


@pytest.fixture
def cogrip(capsys, tmp_path, monkeypatch) -> Cogrip:
    monkeypatch.chdir(tmp_path)
    return Cogrip(main, capsys)


@pytest.mark.parametrize("name", BROKEN)
def test_a_world_that_cannot_be_used_is_a_line(cogrip, tmp_path, name):
    text, words = BROKEN[name]
    (tmp_path / "world.py").write_text(text)
    (tmp_path / "w.toml").write_text(ROOM)
    error = cogrip.err("lab", "w.toml", "--python-worlds", ".")
    assert words in error
    assert error.count("\n") == 1


@pytest.mark.sample(5)
@pytest.mark.parametrize("way", [("--verify",), ("--what-if",), ("--what-if", "--set", "seed=2")])
@pytest.mark.parametrize("what", ["a world that is not allowed", "a world that has gone", "a scene that has gone"])
def test_a_recording_of_what_cannot_be_had_is_a_line_and_leaves_nothing(cogrip, tmp_path, monkeypatch, what, way):
    if "world" in what:
        for each in WORLDS.glob("two_masses.*"):
            (tmp_path / each.name).write_bytes(each.read_bytes())
        room, file = "two_masses.toml", tmp_path / "two_masses.py"
    else:
        configs = WORLDS.parents[2] / "configs"
        room, file = "lift.toml", tmp_path / "lift.xml"
        (tmp_path / room).write_bytes((configs / room).read_bytes())
        file.write_bytes((configs / "scenes" / "lift.xml").read_bytes())
    assert main(["lab", room, "--set", "seconds=0.1", "--python-worlds", "."]) == 0
    (run,) = (tmp_path / "runs").iterdir()
    monkeypatch.setenv("COGRIP_PYTHON_WORLDS", "" if "allowed" in what else str(tmp_path))
    if "gone" in what:
        file.unlink()
    error = cogrip.err("replay", run.name, *way)
    assert file.name in error
    assert error.count("\n") == 1
    assert list((tmp_path / "runs").iterdir()) == [run]


@pytest.mark.parametrize(
    "error",
    [CheckpointError, RecordingError, SceneError, SettingsError, StudyError, TraceError, WorldError, WorldKindError],
)
def test_what_a_command_does_not_catch_is_caught_at_the_end(cogrip, monkeypatch, error):
    def fail(*_: object, **__: object) -> None:
        raise error("notes.xml: cannot be used")

    assert issubclass(error, ForeignFileError)
    monkeypatch.setattr("cogrip.cli.main.show_docstrings", fail)
    assert cogrip.err("lab", "demo") == "cogrip: notes.xml: cannot be used\n"
