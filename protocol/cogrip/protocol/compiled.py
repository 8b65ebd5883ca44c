"""Report of the form in which cogrip runs: interpreted, or with the modules that `dev.py compile` has made."""

import sys
from collections.abc import Mapping
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import cogrip

LINUX_ONLY = ("datagram_batch",)


def compiled_modules() -> Mapping[str, bool]:
    """Return for each module that `dev.py compile` compiles, by name, whether its compiled form is there.

    Those are the modules with a `.pxd` or `.pyx` file beside them; one with a `.pyx` has no interpreted form. Python imports a
    compiled form wherever there is one. Nothing is imported here.
    """
    found: dict[str, bool] = {}
    for folder in map(Path, cogrip.__path__):
        for types in folder.rglob("*.p[xy][dx]"):
            if types.stem not in LINUX_ONLY or sys.platform == "linux":
                name = ".".join(("cogrip", *types.relative_to(folder).with_suffix("").parts))
                found[name] = any(types.with_name(types.stem + suffix).exists() for suffix in EXTENSION_SUFFIXES)
    return found


def form() -> str:
    """Return "compiled" or "interpreted" where all `compiled_modules` are, else "partly compiled" with the number."""
    here = compiled_modules().values()
    if all(here):
        return "compiled"
    return f"partly compiled: {sum(here)} of {len(here)} modules" if any(here) else "interpreted"
