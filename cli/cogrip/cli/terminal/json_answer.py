"""The answer of a command as JSON."""

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
    """To standard output for "-", else to a file. Raises Problem where that cannot be written."""
    text = json.dumps(answer, indent=2, allow_nan=False) + "\n"
    if where == "-":
        sys.stdout.write(text)
        return
    try:
        Path(where).write_text(text)
    except OSError as error:
        raise Problem(f"--json {where}: cannot be written: {error}") from None
