"""Check of what `dev.py compile` has left beside the sources of this checkout: is it of these sources?"""

import importlib.machinery
from collections.abc import Iterable
from pathlib import Path

import cogrip

SUFFIX = importlib.machinery.EXTENSION_SUFFIXES[0]
SOURCES = (".py", ".pyx", ".pxd")


def outdated(folders: Iterable[str] = ()) -> list[str]:
    """Return the names of compiled modules with a source that was changed later: Python would run the older one.

    folders: to look below; those of all packages of cogrip if none is given
    """
    found = []
    for folder in folders or cogrip.__path__:
        for made in sorted(Path(folder).rglob(f"*{SUFFIX}")):
            name, since_ns = made.name.removesuffix(SUFFIX), made.stat().st_mtime_ns
            sources = [source for suffix in SOURCES if (source := made.with_name(name + suffix)).exists()]
            if any(source.stat().st_mtime_ns > since_ns for source in sources):
                found.append(name)
    return found
