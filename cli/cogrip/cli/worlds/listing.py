"""`cogrip worlds list`: the kinds of object that settings may name here."""

from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.tables import columns_table
from cogrip.protocol.settings.object_kinds import KINDS
from cogrip.server.worlds.registry import WORLDS, WorldKindError, entry_point_kinds, world_class_of

SCENE = "Rigid bodies with contact and friction, of an MJCF or URDF file."


def world_list() -> None:
    """List the kinds of object, and where each comes from.

    Classes in Python files are not among them: `object.kind = "python:FILE.py:CLASS"` (docs/worlds.md).
    """
    rows = [
        {"kind": kind, "from": "cogrip", "world": _summary(kind) if kind in WORLDS else SCENE} for kind in KINDS
    ] + [
        {"kind": kind, "from": target.partition(":")[0], "world": _summary(kind)}
        for kind, target in sorted(entry_point_kinds().items())
    ]
    make_console().print(columns_table(("kind", "from", "world"), rows))


def _summary(kind: str) -> str:
    """Return the first line of what a class says of itself, or what is wrong with it."""
    try:
        found = world_class_of(kind).make
    except WorldKindError as error:
        return str(error).removeprefix("object.kind: ")
    return (found.__doc__ or "").strip().partition("\n")[0]
