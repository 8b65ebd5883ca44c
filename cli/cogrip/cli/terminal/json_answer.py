"""Answers of commands as JSON."""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from cogrip.cli.terminal.problem import Problem

Json = Annotated[
    str | None,
    Parameter(allow_leading_hyphen=True, help="Write the answer as JSON to this file (- for standard output)."),
]


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
