"""Mark of tests that replace a method or a constant, and where the source of a module is that may be compiled."""

from importlib import import_module
from pathlib import Path

import pytest

from cogrip.machine.compiled_files import form

needs_interpreted = pytest.mark.skipif(
    form() != "interpreted",
    reason="a method or a constant of a compiled module cannot be replaced (`python3 dev.py compile --remove`)",
)


def source_of(name: str) -> Path:
    """Return the source of a module, compiled or not."""
    package, _, last = name.rpartition(".")
    return Path(import_module(package).__path__[0]) / f"{last}.py"
