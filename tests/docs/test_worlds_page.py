"""Every listing of docs/worlds.md, Write your own world: the class keeps all promises, and its commands do what they say."""

import re
import textwrap
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from cogrip.cli.main import main
from cogrip.server.worlds import conformance, registry

from tests.docs.pages import page, table

PAGE = page("docs/worlds.md")
BLOCK = re.compile(r"^( *)```(\w*)\n(.*?)^ *```$", re.DOTALL | re.MULTILINE)


def listings(kind: str) -> list[str]:
    return [textwrap.dedent(text) for _, name, text in BLOCK.findall(PAGE) if name == kind]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with the page's files, which is the present one."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(registry.ALLOWED, "")
    (code,), (settings,) = listings("python"), listings("toml")
    (tmp_path / "my_world.py").write_text(code)
    (tmp_path / "my_world.toml").write_text(settings)
    return tmp_path


def commands() -> list[list[str]]:
    return [line.split()[1:] for text in listings("") for line in text.splitlines() if line.startswith("cogrip ")]


@pytest.mark.long
@pytest.mark.usefixtures("here")
def test_its_world_is_checked_and_run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    check, lab, serve = (each for each in commands() if any("my_world" in word for word in each))
    others = tuple(each for each in conformance.CHECKS if each is not conformance.keeps_time)  # no clock decides here
    monkeypatch.setattr("cogrip.cli.worlds.check.CHECKS", others)
    assert main(check) == 0
    assert f"{len(others)} of {len(others)} promises kept" in capsys.readouterr().out
    assert main([*lab, "--set", "seconds=1", "--json", "-"]) == 0
    assert serve == ["serve", "my_world.toml", "--python-worlds", "."]
    assert main([*serve, "--port", "99999"]) == 2
    assert "--port 99999" in capsys.readouterr().err


@pytest.mark.usefixtures("here")
def test_without_the_flag_no_command_runs_it(capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("lab", "serve", "demo", "advise", "compare", "sweep --vary object.mass_kg=0.1,0.2"):
        name, *flags = command.split()
        assert main([name, "my_world.toml", *flags]) == 2
        assert "is a program, and settings may be anybody's" in capsys.readouterr().err


def test_its_entry_point_is_found(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(here)
    points = tomllib.loads(listings("")[-1])["project"]["entry-points"][registry.GROUP]
    installed = [EntryPoint(name, target, registry.GROUP) for name, target in points.items()]
    monkeypatch.setattr(registry, "entry_points", lambda group: installed)
    registry.entry_point_kinds.cache_clear()
    try:
        assert registry.world_class_of("on-a-spring").make.__name__ == "OnASpring"  # type: ignore[attr-defined]
    finally:
        registry.entry_point_kinds.cache_clear()


def test_its_table_has_all_checks() -> None:
    names = [row[0].strip("`") for row in table(PAGE, "promise")]
    assert names == [check.__name__ for check in conformance.CHECKS]
