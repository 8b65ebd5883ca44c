"""`cogrip compile`: compile what costs time in a tick, of a cogrip that was installed from a wheel."""

import importlib.util
import os
import subprocess
import sys

from cogrip.cli.terminal.problem import BadInput
from cogrip.machine.compiled_files import CHOSEN

COMPILING = "cogrip.cli.compiling"  # module that is compiling.py of the checkout; only a wheel has it


def compile_(*, remove: bool = False) -> int:
    """Compile what a server does once a person and frame, and a client once a tick: half the time, and the same numbers.

    Needs a C compiler with Python's headers, and the extra `compile`; takes one to two minutes. Nothing needs it; `cogrip
    doctor` says which form runs. What runs already keeps its form.

    Parameters
    ----------
    remove
        Remove what was compiled instead.
    """
    if importlib.util.find_spec(COMPILING) is None:
        raise BadInput("compile: this is a checkout of cogrip; there it is `python3 dev.py compile`")
    # In a process of its own: this one runs what was compiled before.
    os.environ[CHOSEN] = "interpreted"  # what it imports are the sources
    command = [sys.executable, "-P", "-m", COMPILING, *(["--remove"] if remove else [])]
    return subprocess.run(command, check=False).returncode
