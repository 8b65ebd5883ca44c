"""Kinds of object, by `object.kind` of the settings: a row for each, with all that others need to know of it.

A kind is one that comes with cogrip, the name of an entry point of another package, or `python:FILE.py:CLASS`. Only the
server loads the world of a kind: to a client the name of another one is a text.
"""

import re
from pathlib import PurePath
from typing import Annotated, NamedTuple

import msgspec

PYTHON = "python:"
MOST_TEXT = 64
KIND_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9 ._:-]*\Z"
KindText = Annotated[str, msgspec.Meta(min_length=1, max_length=MOST_TEXT, pattern=KIND_PATTERN)]
LocalKindText = Annotated[str, msgspec.Meta(min_length=1, max_length=4096)]


class ObjectKind(NamedTuple):
    """Properties of a kind. None has a default: whoever adds a kind decides each.

    plain      one body, of which these traits tell all: the worlds of every coupling scheme step it by them, and the spring of
               `coupling` stands between a person and it. Else its own world alone says how it moves and feels, and schemes that
               have no such world are refused
    one_sided  contact only pushes (theory section 3.4)
    fixed      nobody moves it
    local      clients can render contact with it themselves
    scene      rigid bodies from a file, with tools, tasks and sensors
    """

    plain: bool
    one_sided: bool
    fixed: bool
    local: bool
    scene: bool

    @property
    def held(self) -> bool:
        """True where people hold it from all sides, wherever their hands are."""
        return self.plain and not self.one_sided


KINDS = {
    "cube": ObjectKind(plain=True, one_sided=False, fixed=False, local=False, scene=False),
    "faces": ObjectKind(plain=True, one_sided=True, fixed=False, local=True, scene=False),
    "wall": ObjectKind(plain=True, one_sided=True, fixed=True, local=True, scene=False),
    "scene": ObjectKind(plain=False, one_sided=False, fixed=False, local=True, scene=True),
}
"""Kinds that come with cogrip."""

_FOREIGN = ObjectKind(plain=False, one_sided=False, fixed=False, local=False, scene=False)


def kind_of(name: str) -> ObjectKind:
    """Return the properties of a kind."""
    return KINDS.get(name, _FOREIGN)


def split_python(name: str) -> tuple[str, str]:
    """Return file and class of a kind that begins with PYTHON; "" where it lacks one."""
    file, _, class_name = name.removeprefix(PYTHON).rpartition(":")
    return file, class_name


def shared_kind(name: str) -> str:
    """Return a kind as both ends know it: a file without its folder, which differs from machine to machine."""
    if not name.startswith(PYTHON):
        return name
    file, class_name = split_python(name)
    return f"{PYTHON}{PurePath(file).name}:{class_name}"


def unfit_kind(name: str) -> str:
    """Return why no welcome can carry a kind, with the cure; "" where one can."""
    file, class_name = split_python(name)
    if name.startswith(PYTHON) and not (file.endswith(".py") and class_name.isidentifier()):
        return f'write "{PYTHON}FILE.py:CLASS", such as "{PYTHON}my_world.py:TwoMasses"'
    shared = shared_kind(name)
    if len(shared) > MOST_TEXT or not re.match(KIND_PATTERN, shared):
        return (
            f'"{shared}" is shown to everyone who joins: let it be letters, digits, blanks and . _ : - , at most {MOST_TEXT} '
            "of them; rename file or class"
        )
    return ""
