"""Kinds of object and coupling schemes that go together, by the product's own rule: a new row of either is tested at once."""

from typing import get_args

from cogrip.protocol.settings.coupling_kinds import COUPLING_KINDS, Kind
from cogrip.protocol.settings.object_kinds import KINDS as OBJECT_KINDS
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.table import SettingsError

SCHEMES: tuple[Kind, ...] = get_args(Kind)
OBJECTS = tuple(name for name, traits in OBJECT_KINDS.items() if not traits.scene)
"""Kinds of object that need no file."""
FREE_OBJECTS = tuple(name for name in OBJECTS if not OBJECT_KINDS[name].fixed)
"""Kinds of object, among them, that people move."""


def _fits(scheme: Kind, thing: str) -> bool:
    try:
        resolve({"object": {"kind": thing}, "coupling": {"kind": scheme}})
    except SettingsError:
        return False
    return True


def objects_of(scheme: Kind) -> tuple[str, ...]:
    """Return the kinds of object without a file that a coupling scheme has."""
    return tuple(thing for thing in OBJECTS if _fits(scheme, thing))


def object_of(scheme: Kind) -> str:
    """Return a cube, or what else a coupling scheme has: two faces that people push for local contact."""
    return objects_of(scheme)[0]


def schemes_of(thing: str) -> tuple[Kind, ...]:
    """Return the coupling schemes that a kind of object without a file has."""
    return tuple(scheme for scheme in COUPLING_KINDS if _fits(scheme, thing))
