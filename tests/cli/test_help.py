"""Every help text says all that its docstring says: nothing in it is taken for markup."""

import io
import re
from collections.abc import Iterator

import pytest
from cyclopts import App
from rich.console import Console

from cogrip.cli.main import app


def commands(within: App, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], App]]:
    """Every command, with those that stand below others."""
    yield path, within
    for name in within:
        if not name.startswith("-"):
            yield from commands(within[name], (*path, name))


ALL = dict(commands(app))


def bare(text: str) -> str:
    """`text` without what a help page lays out: blanks, boxes, the marks of code."""
    return re.sub(r"[\s`\u2500-\u257f]", "", text)


def said_in(docstring: str) -> list[str]:
    """The words about the parameters in a docstring. What stands before them, the list of commands says in its own words."""
    _, _, told = docstring.partition("----------\n")
    return [word for line in told.splitlines() if line.startswith(" " * 8) for word in line.split()]


@pytest.mark.parametrize("columns", [80, 120])
@pytest.mark.parametrize("path", ALL, ids=" ".join)
def test_no_word_of_a_docstring_is_eaten(path: tuple[str, ...], columns: int) -> None:
    out = io.StringIO()
    app.help_print(path, console=Console(file=out, width=columns, color_system=None))
    shown = bare(out.getvalue())
    command = ALL[path].default_command
    words = said_in(command.__doc__ or "") if command else []
    missing = [word for word in words if bare(word) not in shown]
    assert not missing


def test_the_sweeps_folder_is_named_whole() -> None:
    out = io.StringIO()
    app.help_print(("sweep",), console=Console(file=out, width=120, color_system=None))
    assert "sweeps/<name>-<digest>" in out.getvalue()
