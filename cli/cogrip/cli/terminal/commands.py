"""Tables of commands: each names a function, which is imported when its command is called, and a line for the list."""

import inspect
from collections.abc import Mapping, Sequence

from cyclopts import App, Group

Table = Mapping[str, tuple[str, str]]
"""Name -> (target "module:function" below cogrip.cli, one line of help)."""


def add_commands(app: App, table: Table, group: Group | None = None) -> None:
    """Register the commands of `table` in its order; none of their modules is imported."""
    for number, (name, (target, line)) in enumerate(table.items()):
        app.command(f"cogrip.cli.{target}", name=name, help=line, group=group, sort_key=number)


def show_docstrings(app: App, words: Sequence[str]) -> None:
    """Let the help page of the command that `words` name show its docstring below its one line of help."""
    for word in words:
        if word.startswith("-") or word not in app:
            return
        app = app[word]
        line, docstring = (
            inspect.cleandoc(app.help),
            inspect.cleandoc(getattr(app.default_command, "__doc__", None) or ""),
        )
        if docstring not in line:
            app.help = docstring if docstring.startswith(line) else f"{line}\n\n{docstring}"
