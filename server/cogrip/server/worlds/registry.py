"""Worlds by kind: those that come with cogrip, those of other packages by entry point, and classes in Python files.

The module behind a kind is imported when it is asked for. A Python file is run only where the administrator allows its folder:
settings may be anybody's.
"""

import hashlib
import importlib.util
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, NamedTuple

from cogrip.protocol.foreign_file import ForeignFileError
from cogrip.protocol.settings.object_kinds import KINDS, PYTHON, shared_kind, split_python
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.texts import shown
from cogrip.server.worlds.guarded import GuardedWorld
from cogrip.server.worlds.world import World

WORLDS: dict[str, str] = {
    "cube": "cogrip.server.worlds.grip:GripWorld",
    "faces": "cogrip.server.worlds.push:PushWorld",
    "wall": "cogrip.server.worlds.push:PushWorld",
}
"""World for waves as "module:class", by kind. A scene needs more than its seats: `cogrip.server.schemes`.

A kind with another class than these is not `plain` (`cogrip.protocol.settings.object_kinds`): other schemes would step it as if
it were one of them.
"""

GROUP = "cogrip.worlds"
ALLOWED = "COGRIP_PYTHON_WORLDS"
"""Environment variable with the folders whose Python files may be run, as PATH has them."""


class WorldKindError(ForeignFileError, ValueError):
    """A kind of object without a world, or whose world cannot be loaded."""


class WorldClass(NamedTuple):
    """The class of a kind of object.

    make      the class
    identity  says which code it is ("module:class", of a file its digest): a checkpoint is restored only to the same code
    """

    make: Callable[[Sequence[SeatSettings]], World]
    identity: str


@cache
def entry_point_kinds() -> Mapping[str, str]:
    """Return kind -> "module:class" of the worlds that other installed packages name in the entry point group `cogrip.worlds`.

    A kind that comes with cogrip cannot be replaced.
    """
    return {point.name: point.value for point in entry_points(group=GROUP) if point.name not in KINDS}


def world_class_of(kind: str) -> WorldClass:
    """Return the class of a kind. Raises WorldKindError."""
    if kind.startswith(PYTHON):
        return _of_file(kind)
    target = WORLDS.get(kind) or entry_point_kinds().get(kind)
    if target is None:
        known = [*KINDS, *entry_point_kinds()]
        near = get_close_matches(kind, known, n=1)
        cure = f'did you mean "{near[0]}"?' if near else f"there are: {', '.join(known)}; or {PYTHON}FILE.py:CLASS"
        raise WorldKindError(f'object.kind: there is no world "{kind}"; {cure}')
    module, _, name = target.partition(":")
    if kind in WORLDS:
        return WorldClass(getattr(import_module(module), name), target)
    with _one_line(f"object.kind: {kind}", "mend or remove its package"):
        return WorldClass(_checked(getattr(import_module(module), name), kind), target)


def make_guarded(kind: str, seats: Sequence[SeatSettings]) -> World:
    """Return the guarded world of a kind that does not come with cogrip. Raises WorldKindError, WorldError."""
    found = world_class_of(kind)
    named = shared_kind(kind)
    for key, count, allowed in (
        ("object.axes", seats[0].object.axes, getattr(found.make, "axes_allowed", ())),
        ("users", len(seats), getattr(found.make, "seats_allowed", ())),
    ):
        if count not in allowed:
            raise WorldKindError(f"{key} = {count}, but {named} takes {_listed(allowed)}: change one of them")
    return GuardedWorld(seats, lambda: found.make(seats), named, found.identity)


def _listed(allowed: Sequence[int]) -> str:
    if isinstance(allowed, range) and len(allowed) > 2:
        return f"{allowed[0]} to {allowed[-1]}"
    return " or ".join(map(str, allowed))


def check_allowed(file: Path, key: str = "object.kind") -> None:
    """Raise WorldKindError for a file that the administrator has not allowed. key: of the settings that name it."""
    folders = [Path(each).resolve() for each in os.environ.get(ALLOWED, "").split(os.pathsep) if each]
    if not any(file.resolve().is_relative_to(folder) for folder in folders):
        raise WorldKindError(
            f"{key}: {file} is a program, and settings may be anybody's: it is run only where its folder is allowed; "
            f"read it, then give --python-worlds {file.parent}, or set {ALLOWED}"
        )


def _of_file(kind: str) -> WorldClass:
    name, class_name = split_python(kind)
    found, digest = class_in(Path(name), class_name, "object.kind")
    with _one_line(f"object.kind: {name}", "correct it"):
        return WorldClass(_checked(found, kind), f"{shared_kind(kind)} {digest}")


def class_in(file: Path, name: str, key: str) -> tuple[Any, str]:
    """Return a class in a Python file, which is run, and the file's digest. Raises WorldKindError."""
    check_allowed(file, key)
    try:
        source = file.read_bytes()
    except OSError as error:
        raise WorldKindError(f"{key}: {file}: cannot be read: {error.strerror}") from None
    digest = hashlib.sha256(source).hexdigest()[:16]
    with _one_line(f"{key}: {file}", "correct it"):
        module = _run(str(file.resolve()), digest)
        if not hasattr(module, name):
            raise WorldKindError(f"{key}: {file} has no class {name}; name one that is in it")
        return getattr(module, name), digest


@cache
def _run(file: str, digest: str) -> Any:
    """Return the module of a file, run once for each content."""
    name = f"cogrip_world_{digest}"
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look for it there
    spec.loader.exec_module(module)
    return module


def _checked(found: Any, kind: str) -> type[World]:
    if not (isinstance(found, type) and issubclass(found, World)):
        raise WorldKindError(
            f"object.kind: {kind} is no class of worlds; derive it from cogrip.server.worlds.tool_world.ToolWorld"
        )
    for name in ("axes_allowed", "seats_allowed"):
        allowed = getattr(found, name)
        if not (isinstance(allowed, Sequence) and allowed and all(isinstance(each, int) for each in allowed)):
            raise WorldKindError(f"object.kind: {kind}: {name} = {allowed!r}: give the counts as (1,) or range(1, 5)")
    return found


@contextmanager
def _one_line(what: str, cure: str) -> Iterator[None]:
    """Make a WorldKindError of whatever another author's program raises as it is loaded."""
    try:
        yield
    except WorldKindError:
        raise
    except (Exception, SystemExit) as error:
        said = shown(" ".join(f"{type(error).__name__}: {error}".split()))
        raise WorldKindError(f"{what} fails as it is loaded: {said}; {cure}") from error
