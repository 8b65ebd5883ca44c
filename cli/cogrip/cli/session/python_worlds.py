"""Flag that allows the Python files of a folder to be run as worlds: for this command and the processes that it starts."""

import os
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from cogrip.cli.terminal.problem import BadInput
from cogrip.server.worlds.registry import ALLOWED

PythonWorlds = Annotated[
    tuple[Path, ...],
    Parameter(
        name="--python-worlds",
        negative="",
        help='Folder whose Python files may be run for object.kind = "python:FILE.py:CLASS". Repeatable.',
    ),
]


def allow_python_worlds(folders: tuple[Path, ...]) -> None:
    """Add folders to those that are allowed. Raises BadInput for one that there is not."""
    for folder in folders:
        if not folder.is_dir():
            raise BadInput(f"--python-worlds {folder}: there is no such folder")
        before = os.environ.get(ALLOWED)
        os.environ[ALLOWED] = os.pathsep.join(filter(None, (before, str(folder.resolve()))))
