"""Settings that come with cogrip, by name: in every command, listed, shown, copied; and files of the same name."""

import json
import zipfile
from pathlib import Path

import pytest

from cogrip.analysis.advice.advice import advise, ample
from cogrip.analysis.advice.advice_change import ranked_changes
from cogrip.analysis.linear.linear_session import ModelError
from cogrip.cli.main import main
from cogrip.cli.settings.settings_file import load
from cogrip.cli.settings.shipped_settings import shipped, shipped_names, summary_of
from cogrip.cli.study.study_source import shipped_studies

from tests.cli.command import Cogrip

ROOT = Path(__file__).parents[2]
CONFIGS = ROOT / "configs"


pytestmark = pytest.mark.usefixtures("empty_folder")


def test_every_file_has_a_name_and_a_line_that_ends() -> None:
    assert shipped_names() == sorted(path.stem for path in CONFIGS.glob("*.toml"))
    for name in shipped_names():
        assert load(Path(name)) == load(CONFIGS / f"{name}.toml")
        summary = summary_of(name)
        assert summary.endswith("."), summary
        assert len(summary) <= 100, summary


BASELINES = {
    "compare": "every method is held to it",
    "paper": "the paper's own settings",
    "storm": "a network that fails",
}
NAMES = sorted(path.stem for path in CONFIGS.glob("*.toml"))


@pytest.mark.parametrize("name", NAMES)
def test_its_second_line_says_whether_it_is_the_best_known(name: str) -> None:
    second = (CONFIGS / f"{name}.toml").read_text().splitlines()[1]
    assert second.startswith("# Kept as it is: " if name in BASELINES else "# The best known for it: ")
    assert second.endswith(".")


@pytest.mark.parametrize("name", [name for name in NAMES if name not in BASELINES])
def test_advice_finds_no_more_than_a_tenth_for_what_comes_with_cogrip(name: str) -> None:
    """Advice has no warning, and no change that brings the hand nearer to the asked stiffness by more than a tenth of it."""
    settings = load(Path(name))
    try:
        now = advise(settings, ample)
    except ModelError:
        assert settings.object.kind == "scene"
        return
    assert now.warnings == ()
    if found := next(ranked_changes(settings, now), None):
        assert found.before.missed - found.after.missed <= 0.1, found.setting


@pytest.mark.parametrize("columns", ["80", "120"])
def test_list(columns: str, monkeypatch: pytest.MonkeyPatch, cogrip: Cogrip) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    out = cogrip.out("configs")
    assert out == cogrip.out("configs list")
    assert [line.split()[0] for line in out.splitlines() if not line.startswith(" ")] == shipped_names()
    assert "lan            Two people on one local network" in out
    assert all(len(line) <= int(columns) for line in out.splitlines())


def test_show_and_copy(cogrip: Cogrip) -> None:
    text = (CONFIGS / "wan.toml").read_text()
    assert cogrip.out("configs show wan") == text
    Path("folder").mkdir()
    for command, copy in (("configs copy wan", "wan.toml"), ("configs copy wan folder", "folder/wan.toml")):
        cogrip.out(command)
        assert Path(copy).read_text() == text
    cogrip.refuses("wan.toml: exists, and nothing is overwritten", "configs copy wan")
    cogrip.refuses("cannot be written", "configs copy wan nowhere/x.toml", code=1)
    cogrip.refuses("did you mean wan? There are: compare, demo", "configs show wam")


NAMED = [
    "lab lan --set seconds=0.1",
    "advise wan --no-laboratory",
    "feel demo",
    "stability radius demo",
    "sweep demo --vary seed=1:2:2 --set seconds=0.1 --measure passive --workers 1",
]


@pytest.mark.parametrize("command", NAMED)
@pytest.mark.usefixtures("no_pictures", "no_workers")
def test_a_bare_name_stands_for_the_file(command: str, cogrip: Cogrip) -> None:
    cogrip.out(command)


def test_a_file_of_that_name_comes_first_and_a_folder_does_not_count(cogrip: Cogrip) -> None:
    """`demo` is always the same, whatever stands in the folder; but whoever edited a copy learns how to name it."""
    demo = "lab demo --set seconds=0.1 --json -"
    Path("demo").mkdir()
    out, problem = cogrip.texts(demo)
    assert (json.loads(out)["name"], problem.strip()) == ("demo", "")
    Path("demo.toml").write_text('name = "mine"\nseconds = 0.1')
    out, problem = cogrip.texts(demo)
    assert json.loads(out)["name"] == "demo"
    assert "note: demo is the one that comes with cogrip; write demo.toml for the file in this folder" in problem
    assert cogrip.answer("lab", "demo.toml")["name"] == "mine"
    Path("demo").rmdir()
    Path("demo").write_text('name = "mine"')
    assert load(Path("demo")).name == "mine"


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("dmo", "dmo: there is no such file; no settings of that name come with cogrip; did you mean demo? There are:"),
        ("qqq", "no settings of that name come with cogrip. There are: compare, demo, effects, five-users,"),
        ("demo.toml", "demo.toml: there is no such file; did you mean demo, which comes with cogrip?"),
        ("configs/demo.toml", "configs/demo.toml: there is no such file; did you mean demo, which comes with cogrip?"),
        ("mien.toml", "did you mean mine.toml?"),
        ("a/b/qqq", "give the path of a settings file, or a name of `cogrip configs`"),
    ],
)
def test_a_missing_name_is_answered_with_the_nearest(given: str, words: str, cogrip: Cogrip) -> None:
    Path("mine.toml").write_text('name = "mine"')
    assert words in cogrip.err("lab", given)


def test_a_wheel_holds_them_once_and_no_second_copy_is_in_the_tree(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hatchling.builders.wheel import WheelBuilder

    if not (ROOT / "pyproject.toml").exists():
        pytest.skip("needs a checkout")
    (wheel,) = WheelBuilder(str(ROOT)).build(directory=str(tmp_path / "dist"), versions=["standard"])
    held = {name for name in zipfile.ZipFile(wheel).namelist() if name.endswith(".toml")}
    studies = {f"studies/{name}" for name in shipped_studies()}
    assert held == {f"cogrip/cli/configs/{name}.toml" for name in {*shipped_names(), *studies}}
    assert not (ROOT / "cli/cogrip/cli/configs").exists()
    zipfile.ZipFile(wheel).extractall(tmp_path / "installed")
    monkeypatch.setattr("cogrip.cli.settings.shipped_settings.files", lambda package: tmp_path / "installed/cogrip/cli")
    assert shipped("demo").is_relative_to(tmp_path)
    assert load(Path("demo")) == load(CONFIGS / "demo.toml")
    assert main(["configs", "show", "lan"]) == 0
