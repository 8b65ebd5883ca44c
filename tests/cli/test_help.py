"""Help pages: the list of commands by group, and the whole docstring of each command, with nothing taken for markup."""

import io
import re
from collections.abc import Iterator

import pytest
from cyclopts import App
from rich.console import Console

from cogrip.cli.devices.commands import COMMANDS as DEVICE_COMMANDS
from cogrip.cli.main import COMMANDS, GROUPS, app
from cogrip.cli.terminal.commands import show_docstrings

from tests.extent import long


def commands(within: App, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], App]]:
    """Yield every command, with those below it."""
    yield path, within
    for name in within:
        if not name.startswith("-"):
            yield from commands(within[name], (*path, name))


LINES = {path: app.help for path, app in commands(app)}  # before any page was shown
ALL = dict(commands(app))


def bare(text: str) -> str:
    """Return `text` without the layout of a help page: blanks, boxes, the marks of code."""
    return re.sub(r"[\s`\u2500-\u257f]", "", text)


def page(path: tuple[str, ...], columns: int) -> str:
    """Return the help page of a command as `main` shows it."""
    out = io.StringIO()
    show_docstrings(app, (*path, "--help"))
    app.help_print(path, console=Console(file=out, width=columns, color_system=None))
    return out.getvalue()


@pytest.mark.parametrize("columns", [80, long(120)])
@pytest.mark.parametrize("path", [path for path in ALL if path], ids=" ".join)
def test_a_page_shows_the_line_of_the_list_and_the_whole_docstring(path: tuple[str, ...], columns: int) -> None:
    whole = page(path, columns)
    assert not re.search(r"\[default: *(\(\)|\"\"|False|None)\]", bare(whole)), "that an option is not given is no news"
    assert "ARGS" not in whole.partition("\n")[0], "arguments have names"
    shown = bare(whole)
    assert shown.count(bare(LINES[path].partition("\n\n")[0])) == 1
    command = ALL[path].default_command
    text, _, parameters = ((command.__doc__ or "") if command else "").partition("Parameters\n")
    described = [line for line in parameters.splitlines() if line.startswith(" " * 8)]
    words = " ".join([text, *described]).split()
    assert not [word for word in words if bare(word) not in shown]


@pytest.mark.parametrize("columns", [80, 120])
def test_the_list_has_every_command_in_its_group(columns: int) -> None:
    out = page((), columns)
    assert all(len(line) <= columns for line in out.splitlines())
    assert re.findall(r"^╭─ (\w+) ─", out, re.MULTILINE) == [*GROUPS, "Options"]
    assert tuple(re.findall(r"^│ ([a-z]+) ", out, re.MULTILINE)) == COMMANDS
    lines = [line for table in GROUPS.values() for _, line in table.values()]
    assert not [word for line in lines for word in line.split() if word not in out]
    devices = GROUPS["Devices"]["devices"][1].partition(": ")[2]
    assert devices.rstrip(".").split(", ") == [*DEVICE_COMMANDS], "the line of the devices names each of their commands"
