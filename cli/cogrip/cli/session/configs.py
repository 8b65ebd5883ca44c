"""`cogrip configs`: the settings files that come with cogrip, by name."""

from pathlib import Path

from cyclopts import App
from rich.table import Table

from cogrip.cli.settings.shipped_settings import SUFFIX, no_such_settings, shipped, shipped_names, summary_of
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput, Problem

configs = App(name="configs")


@configs.default
@configs.command(name="list")
def list_configs() -> None:
    """List the settings that come with cogrip, by the names that every command takes for a settings file."""
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(no_wrap=True)
    table.add_column()
    for name in shipped_names():
        table.add_row(name, summary_of(name))
    make_console().print(table)


@configs.command
def show(name: str, /) -> None:
    """Print the settings of one name.

    Parameters
    ----------
    name
        Its name, such as demo.
    """
    print(_text(name), end="")


@configs.command
def copy(name: str, file: Path | None = None, /) -> None:
    """Write a copy to edit.

    Parameters
    ----------
    name
        Its name, such as demo.
    file
        Where to; NAME.toml in this folder if not given. Nothing is overwritten.
    """
    text = _text(name)
    target = file or Path(f"{name}{SUFFIX}")
    if target.is_dir():
        target /= f"{name}{SUFFIX}"
    try:
        with target.open("x", encoding="utf-8") as out:
            out.write(text)
    except FileExistsError:
        raise BadInput(f"{target}: exists, and nothing is overwritten; name another file") from None
    except OSError as error:
        raise Problem(f"{target}: cannot be written: {error.strerror}") from None
    print(f"{target}: a copy of {name}; edit it, and give its path in place of the name")


def _text(name: str) -> str:
    """Return the text of the settings called `name`. Raises BadInput."""
    bare = name.removesuffix(SUFFIX)
    if bare not in shipped_names():
        raise BadInput(f"{name}: {no_such_settings(name)}")
    return shipped(bare).read_text(encoding="utf-8")
