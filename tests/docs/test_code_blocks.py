"""Every block of Python on a page or in a docstring runs as a program of its own; every block of TOML is read; every command
line of `cogrip` is one that the program takes.
"""

import ast
import inspect
import itertools
import re
import shlex
import shutil
import textwrap
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from cyclopts import CycloptsError

import cogrip.api as cogrip
from cogrip.cli.main import app
from cogrip.cli.study.study_source import load_study
from cogrip.devices.family.simulated import GROUP
from cogrip.experiments.study.study_file import read_study
from cogrip.server.worlds.registry import ALLOWED

from tests import forked
from tests.docs.pages import ROOT, fenced_lines, page, prose_lines
from tests.docs.tutorials import NAMES as TUTORIAL_PAGES
from tests.docs.tutorials import Saved, steps
from tests.source_tree import FOLDERS

FENCED = re.compile(r"^( *)```(\w+)\n(.*?)^ *```$", re.DOTALL | re.MULTILINE)
INDENTED = re.compile(r"^(?: {4}.*\n(?:\n(?= {4}))?)+", re.MULTILINE)
QUOTED = re.compile(r'"""(.*?)"""', re.DOTALL)
LIMIT_S = 120.0


def pages() -> Iterator[str]:
    yield from (path.relative_to(ROOT).as_posix() for path in sorted(ROOT.glob("*.md")))
    for folder in ("docs", "protocol", "clients", "view"):
        yield from (path.relative_to(ROOT).as_posix() for path in sorted((ROOT / folder).rglob("*.md")))


def on_pages(language: str) -> Iterator[tuple[str, str]]:
    """Yield (page, text) of every fenced block in a language."""
    for name in pages():
        yield from ((name, textwrap.dedent(text)) for _, kind, text in FENCED.findall(page(name)) if kind == language)


def is_program(text: str) -> bool:
    """Return True for Python that calls something. Equations of docstrings are indented, too, and most do not parse."""
    try:
        tree = ast.parse(text)
    except SyntaxError:
        return False
    statements = ast.Import | ast.ImportFrom | ast.With | ast.For
    return any(isinstance(each, statements) or isinstance(getattr(each, "value", None), ast.Call) for each in tree.body)


def programs(docstring: str) -> list[str]:
    blocks = INDENTED.findall(f"{inspect.cleandoc(docstring)}\n")
    return [text for text in map(textwrap.dedent, blocks) if is_program(text)]


def in_docstrings() -> Iterator[tuple[str, str]]:
    for package in FOLDERS:
        for path in sorted((ROOT / package).rglob("*.py")):
            source = path.read_text(encoding="utf-8")
            if not any(map(programs, QUOTED.findall(source))):
                continue  # so that few modules are parsed
            for node in ast.walk(ast.parse(source)):
                if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                    for text in programs(ast.get_docstring(node) or ""):
                        yield path.relative_to(ROOT).as_posix(), text


def commands(text: str) -> Iterator[str]:
    """Yield every command line of cogrip in a block of a page, fenced or indented, without what a shell does with it."""
    blocks = (line for _, line in fenced_lines(text))
    indented = (line for _, line in prose_lines(text) if line.startswith("    "))
    whole = "\n".join((*blocks, *indented)).replace("\\\n", " ")
    for found in re.finditer(r"^ *(?:\$ )?cogrip ([^\n]*)", whole, re.MULTILINE):
        words = list(itertools.takewhile(lambda word: word not in SHELL, shlex.split(found[1], comments=True)))
        yield shlex.join(words)


TUTORIALS = "docs/tutorials/"
SHELL = ("|", "||", "&", "&&", ">", ";")
BLOCKS = [each for each in (*on_pages("python"), *in_docstrings()) if not each[0].startswith(TUTORIALS)]
"""Those of tutorials are run by test_tutorials.py."""
COMMANDS = sorted({(name, line) for name in pages() for line in commands(page(name))})
TABLES = [each for each in on_pages("toml") if each[0] != "docs/worlds.md" and not each[0].startswith(TUTORIALS)]
"""Those of docs/worlds.md are run by test_worlds_page.py."""
EXPECTED = {
    "docs/administration.md": "",
    "docs/api.md": "", "docs/effects.md": "", "docs/measures.md": "completion_s", "docs/worlds.md": "",
    "api/cogrip/api/__init__.py": "True", "results/cogrip/results/reading/records.py": "0.0",
}  # fmt: skip
"""Where there is a block -> what it prints."""


def prepare(name: str, folder: Path) -> None:
    """Put into the folder what the page has its reader do before."""
    if name == "docs/measures.md":
        made = cogrip.run("demo", seconds=1.0, folder=folder)
        shutil.move(made.folder, folder / "studies" / "fitts" / "runs" / "01-001-practice-1")
    if name == "results/cogrip/results/reading/records.py":
        made = cogrip.run("demo", seconds=0.2, folder=folder)
        (folder / "runs").mkdir()
        shutil.move(made.folder, folder / "runs" / "20260101-120000-demo")
    if name == "docs/effects.md":
        (folder / "my_world.py").write_text(next(text for where, text in BLOCKS if where == "docs/worlds.md"))


def test_the_blocks_are_found() -> None:
    assert sorted({name for name, _ in BLOCKS}) == sorted(EXPECTED)
    assert {name for name, _ in TABLES} == {f"docs/{each}.md" for each in ("api", "devices", "effects", "studies")}


@pytest.mark.parametrize(("name", "text"), BLOCKS, ids=[name for name, _ in BLOCKS])
def test_a_block_of_python_runs(name: str, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    prepare(name, tmp_path)
    monkeypatch.chdir(tmp_path)
    with forked.start(code=f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n{text}") as process:
        said, _ = process.communicate(LIMIT_S)
    assert process.returncode == 0, said
    assert EXPECTED[name] in said


def test_the_knock_of_the_page_is_felt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    prepare("docs/effects.md", tmp_path)
    (tmp_path / "knocking.py").write_text(next(text for _, text in BLOCKS if "class Knocking" in text))
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv(ALLOWED, str(tmp_path))
    table = {
        "seconds": 3.0, "object": {"kind": "python:knocking.py:Knocking", "mass_kg": 0.2},
        "users": [{"name": "anna", "hand": "sine&amplitude_m=0.02&frequency_hz=1"}],
    }  # fmt: skip
    (anna,) = cogrip.run(table).summary["users"]
    assert anna["effects"]["drawn_j"] > 0.0  # what the vibration gave


@pytest.mark.parametrize(("name", "text"), TABLES, ids=[name for name, _ in TABLES])
def test_a_block_of_toml_is_read(name: str, text: str, tmp_path: Path) -> None:
    table = tomllib.loads(text)
    if name == "docs/api.md":
        assert list(table["project"]["entry-points"]) == [GROUP]
    elif name == "docs/studies.md" and "name" in table:
        (tmp_path / "study.toml").write_text(text)
        load_study(tmp_path / "study.toml", live=False, allow_unstable=False)
    elif name == "docs/studies.md":
        assert read_study({"name": "part", "participants": ["P01"], "blocks": [{"name": "one"}], **table})
    else:
        assert cogrip.settings({"name": "part", **table}).users


@pytest.mark.parametrize("name", sorted({name for name, _ in on_pages("python")}))
def test_a_block_of_python_compiles(name: str) -> None:
    for where, text in on_pages("python"):
        if where == name:
            compile(text, name, "exec")


def test_files_of_tutorials_are_read(tmp_path: Path) -> None:
    saved = [each for name in TUTORIAL_PAGES for each in steps(name) if isinstance(each, Saved)]
    for each in saved:
        (tmp_path / each.name).write_text(each.text)
    tables = [each for each in saved if each.name.endswith(".toml")]
    assert len(tables) == sum(name.startswith(TUTORIALS) for name, _ in on_pages("toml"))
    for each in tables:
        if "participants" in tomllib.loads(each.text):
            load_study(tmp_path / each.name, live=False, allow_unstable=False)
        else:
            assert cogrip.settings(tmp_path / each.name).users


@pytest.mark.parametrize("name", sorted({name for name, _ in COMMANDS}))
def test_a_command_line_of_a_page_is_taken(name: str) -> None:
    """Words that stand for something, such as RUN or LINK, are taken as any other; nothing is run."""
    for where, line in COMMANDS:
        if where == name:
            try:
                app.parse_args(shlex.split(line), exit_on_error=False, print_error=False)
            except CycloptsError as error:
                pytest.fail(f"{name}: cogrip {line}: {error}")


def test_a_command_line_that_is_wrong_is_not_taken() -> None:
    assert len(COMMANDS) > 150
    for line in ("lab demo --nope", "lob demo", "lab demo extra", "join HOST --name", "serve lan --port here"):
        with pytest.raises(CycloptsError):
            app.parse_args(shlex.split(line), exit_on_error=False, print_error=False)
