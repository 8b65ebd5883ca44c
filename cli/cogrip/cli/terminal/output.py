"""Consoles that cogrip prints on, and answers as JSON."""

import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Annotated, Any

from cyclopts import Parameter
from rich.console import Console

from cogrip.cli.terminal.problem import Problem

Json = Annotated[
    str | None,
    Parameter(allow_leading_hyphen=True, help="Write the answer as JSON to this file (- for standard output)."),
]


def make_console(
    *,
    stderr: bool = False,
    soft_wrap: bool = False,
    width: int | None = None,
    file: IO[str] | None = None,
    force_terminal: bool | None = None,
    markup: bool = False,
    piped_width: int | None = None,
) -> Console:
    """Return a console that prints texts unchanged: `[fe80::a:b:1]` holds neither markup nor emoji, numbers have no colours.

    piped_width: columns of a pipe or a file, which have no width of their own.
    """
    console = Console(
        stderr=stderr, soft_wrap=soft_wrap, width=width, file=file, force_terminal=force_terminal, highlight=False,
        emoji=False, markup=markup,
    )  # fmt: skip
    if piped_width is not None and not has_width(console):
        console.width = piped_width
    return console


def has_width(console: Console) -> bool:
    """Return whether the output has a width: a pipe or a file has none."""
    return console.is_terminal or "COLUMNS" in os.environ


def write_json(answer: Mapping[str, Any], where: str) -> None:
    """Write to standard output for "-", else to a file. Raises Problem where that cannot be written."""
    write_text(json.dumps(answer, indent=2, allow_nan=False) + "\n", where)


def write_text(text: str, where: str) -> None:
    """Write what `--json` asks for. Raises Problem."""
    if where == "-":
        sys.stdout.write(text)
        return
    with Problem.of(OSError, where=f"--json {where}: cannot be written: "):
        Path(where).write_text(text, encoding="utf-8")
