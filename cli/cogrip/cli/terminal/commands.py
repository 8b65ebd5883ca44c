"""Tables of commands: each names a function, which is imported when its command is called, and a line for the list."""

import inspect
import re
from collections.abc import Mapping, Sequence

from cyclopts import App, Group
from cyclopts.help import format_usage

Table = Mapping[str, tuple[str, str]]
"""Commands by name: target "module:function" below cogrip.cli, and one line of help."""


def add_commands(app: App, table: Table, group: Group | None = None) -> None:
    """Register the commands of `table` in its order; none of their modules is imported."""
    for number, (name, (target, line)) in enumerate(table.items()):
        app.command(f"cogrip.cli.{target}", name=name, help=line, group=group, sort_key=number)


def shown_default(value: object) -> str | None:
    """Return how a help page shows a default; None for one that says nothing: an option that is not given."""
    return None if value is None or value is False or value in ("", ()) else str(value)


def show_docstrings(app: App, words: Sequence[str]) -> None:
    """Let the help page of the command that `words` name show its docstring below its one line of help, and its arguments."""
    root, path = app, list[str]()
    for word in words:
        if word.startswith("-") or word not in app:
            break
        app = app[word]
        app.help_format = "markdown"  # as docstrings are
        path.append(word)
        line, docstring = (
            inspect.cleandoc(text or "") for text in (app.help, getattr(app.default_command, "__doc__", ""))
        )
        if docstring not in line:
            app.help = docstring if docstring.startswith(line) else f"{line}\n\n{docstring}"
    if path and app.default_command and not {*root.help_flags}.isdisjoint(words):
        app.usage = f"Usage: {re.sub(r'.ARGS[.]*]', _optional(app), format_usage(root, path).plain.strip())}"


def _optional(app: App) -> str:
    """Return the positional arguments of a command that may be left out, or whose absence it answers itself."""
    names = []
    for each in app.assemble_argument_collection():
        many = each.field_info.kind is each.field_info.VAR_POSITIONAL
        if each.show and (many or each.index is not None) and not each.required:
            name = f"{each.name.lstrip('-').upper()}{'...' if many else ''}"
            names.append(name if many and each.parameter.required is None else f"[{name}]")
    return " ".join(names)
