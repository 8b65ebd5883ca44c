"""Settings that can be changed while a session runs, of a person and of a room, and why the rest cannot (`cogrip set`)."""

from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from math import isfinite
from typing import Any, Literal, NamedTuple

import msgspec
from msgspec.structs import replace

from cogrip.protocol.settings.line_tuning import LEAST_NSPM, MOST_NSPM
from cogrip.protocol.texts import MARK_BYTES

Parser = Callable[[str, str], Any]
"""Function of key and text that returns a value, or raises ValueError."""

LEAST_MASS_KG, MOST_MASS_KG = 0.01, 100.0
"""Bounds of a mass that is set in a session [kg]: an object of less is lighter than any device, of more nobody moves it."""
MOST_GRAVITY_MPS2 = 20.0  # a tool or a body of a scene then weighs twice what it weighs on earth
LEAST_FILTER_HZ, MOST_FILTER_HZ = 0.05, 1e3
LENT_J = 0.02  # energy that a spring whose stiffness is set may borrow, once a seat session (theory 3.7)
MOST_STIFFNESS_NPM, MOST_DAMPING_NSPM = 1e7, 1e4


class Settable(NamedTuple):
    """One key that can be set. law: why any sequence of values is passive, and how fast it comes."""

    key: str
    values: str
    law: str


_HAND = "at a border of frames, where the tool stays; the force ramps in anew"
_DEVICE = "force of the device alone; it ramps in anew"
_SLOW = "by a factor of e in 1 s"
PERSON = (
    Settable("position_scale", "0.1 to 10", _HAND),
    Settable("force_scale", "0.1 to 10", _HAND),
    Settable("rotation", '"y -x z", 0,0,1.571 [rad], none', _HAND),
    Settable("clutch", "on, off", "the tool stands still"),
    Settable("workspace_limit_m", "none, auto, box X0 X1 ..., sphere X Y Z R", _DEVICE),
    Settable("gravity_compensation", "on, off", _DEVICE),
    Settable("impedance_nspm", f"{LEAST_NSPM:g} to {MOST_NSPM:g}, auto", "any sequence is passive (7.3), 1.3 % a step"),
    Settable("wave_filter_hz", "0, 0.05 to 1000, auto", "what it holds never grows (7.2)"),
    Settable("prefer", "light, balanced, stiff", 'by which "auto" chooses'),
    Settable("stiffness_npm", f"0 to {MOST_STIFFNESS_NPM:.0e}", f"{_SLOW}; stiffer under load is paid for (3.7)"),
    Settable("damping_nspm", f"0 to {MOST_DAMPING_NSPM:g}", f"{_SLOW}; passive at any value (3.3)"),
)
ROOM = (
    Settable("object.mass_kg", f"{LEAST_MASS_KG:g} to {MOST_MASS_KG:g}", f"{_SLOW}; adds no energy (7.9)"),
    Settable("object.damping_nspm", f"0 to {MOST_DAMPING_NSPM:g}", f"{_SLOW}; passive at any value (3.3)"),
    Settable("scene.gravity_mps2", f"0 to {MOST_GRAVITY_MPS2:g}", f"{_SLOW}; what it gives is told (8.9)"),
    Settable("effects.NAME", "on, off, or for whom: anna,ben", "each pays from its tank (7.8)"),
)
NOT_SETTABLE: Mapping[str, str] = {
    "rates": "both ends count time by it: restart the room",
    "coupling.kind": "a scheme is a class at each end: restart the room",
    "coupling.compensate": "the server integrates another spring with it: restart the room",
    "coupling": "set it for each person by its own key, or restart the room",
    "object.kind": "another object is another world: restart the room",
    "object.axes": "both ends count axes: restart the room",
    "object": "a scene is compiled once: restart the room",
    "link": "the fates of an emulated network follow from its seed: restart, or put `cogrip relay` between",
    "playout": "it is agreed on as a line begins: leave and join again, after a restart",
    "admission": "who is here came in by it: restart, or kick",
    "task": "its measures are of the whole session: restart the room",
    "effects": "give one a `name` in its file: cogrip set effects.NAME=on; for one person: cogrip set effects.NAME=anna",
    "users": "name the person: cogrip set NAME KEY=VALUE",
    "seed": "what was drawn of it is past",
    "seconds": "a session is ended by its people or by Ctrl-C",
    "name": "recordings and tokens go by it",
}
"""Reasons, by key or section, why a setting cannot be changed in a session."""


class RoomChange(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Change of a room's settings; None: stays."""

    object_mass_kg: float | None = None
    object_damping_nspm: float | None = None
    scene_gravity_mps2: float | None = None
    effects: Mapping[str, str] = {}  # by name: "on", "off", or for whom, with commas between

    @property
    def text(self) -> str:
        """Return it as `key=value` for people."""
        numbers = [f"{key}={value:g}" for key, name in _NUMBERS.items() if (value := getattr(self, name)) is not None]
        return " ".join([*numbers, *(f"{EFFECTS}{name}={value}" for name, value in self.effects.items())])

    @property
    def is_ramped(self) -> bool:
        """Return whether any of it comes by a ramp; effects are switched at once."""
        return any(getattr(self, name) is not None for name in _NUMBERS.values())

    def after(self, before: "RoomChange") -> "RoomChange":
        """Return both as one: this one came later."""
        given = {name: value for name in _NUMBERS.values() if (value := getattr(self, name)) is not None}
        return replace(before, **given, effects={**before.effects, **self.effects})


def number_of(key: str, text: str, least: float, most: float, auto: bool = False) -> float | Literal["auto"]:
    """Return the number of a setting within bounds, or "auto" where that may be. Raises ValueError."""
    if auto and text == "auto":
        return "auto"
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not (isfinite(value) and least <= value <= most):
        cure = 'give a number between them, or "auto"' if auto else "give a number between them"
        raise ValueError(f"{key} = {text!r} is out of {least:g} to {most:g}; {cure}")
    return value


def filter_of(key: str, text: str) -> float | Literal["auto"]:
    """Return the corner of a wave filter [Hz], 0 for none. Raises ValueError."""
    return 0.0 if text in ("0", "none") else number_of(key, text, LEAST_FILTER_HZ, MOST_FILTER_HZ, auto=True)


def choice_of(key: str, text: str, choices: Sequence[str]) -> str:
    """Return one of these words. Raises ValueError."""
    if text not in choices:
        raise ValueError(f"{key} = {text!r} is none; there is: {', '.join(choices)}")
    return text


def why_not(key: str) -> str:
    """Return why this setting cannot be changed in a session; "" where nothing is called so."""
    words = key.split(".")
    return next(
        (NOT_SETTABLE[head] for end in range(len(words), 0, -1) if (head := ".".join(words[:end])) in NOT_SETTABLE), ""
    )


def read_pairs(pairs: Sequence[str], parsers: Mapping[str, Parser]) -> dict[str, Any]:
    """Return the values that `key=value` texts say. Raises ValueError, which names key, value, bound and cure.

    A key of `parsers` that ends with a dot stands for all keys that begin so.
    """
    found: dict[str, Any] = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        key, text = key.strip(), text.strip().strip("\"'")
        head = key[: key.find(".") + 1]
        parser = None if key.endswith(".") else parsers.get(key, parsers.get(head))
        if parser is None:
            near = get_close_matches(key, parsers, n=1, cutoff=0.5)
            hint = why_not(key) or (f"did you mean {near[0]}?" if near else f"there is: {', '.join(parsers)}")
            raise ValueError(f"{key!r} is nothing that can be set in a session; {hint}")
        if not equals or not text:
            raise ValueError(f"{pair!r} has no value; write {key}=VALUE")
        if key in found:
            raise ValueError(f"{key} stands twice; give it once")
        found[key] = parser(key, text)
    if not found:
        raise ValueError(f"nothing to set; write key=value with one of {', '.join(parsers)}")
    return found


def _switch_of(key: str, text: str) -> str:
    """Return for whom an effect is: "on" everybody, "off" nobody, or names with commas between. Raises ValueError."""
    names = [name.strip() for name in text.split(",")]
    if not all(names) or (len(names) > 1 and not {"on", "off"}.isdisjoint(names)) or len(text) > MARK_BYTES:
        raise ValueError(f"{key} = {text!r} is none; give on, off, or names such as anna,ben")
    return ",".join(names)


EFFECTS = "effects."  # start of a key that switches an effect
_NUMBERS: Mapping[str, str] = {
    "object.mass_kg": "object_mass_kg",
    "object.damping_nspm": "object_damping_nspm",
    "scene.gravity_mps2": "scene_gravity_mps2",
}
"""Names of the fields of a RoomChange that are numbers, by key."""
_ROOM_PARSERS: Mapping[str, Parser] = {
    "object.mass_kg": lambda key, text: number_of(key, text, LEAST_MASS_KG, MOST_MASS_KG),
    "object.damping_nspm": lambda key, text: number_of(key, text, 0.0, MOST_DAMPING_NSPM),
    "scene.gravity_mps2": lambda key, text: number_of(key, text, 0.0, MOST_GRAVITY_MPS2),
    EFFECTS: _switch_of,
}


def room_change(pairs: Sequence[str]) -> RoomChange:
    """Return the change of a room that `key=value` texts say. Raises ValueError."""
    values = read_pairs(pairs, _ROOM_PARSERS)
    numbers = {_NUMBERS[key]: values.pop(key) for key in list(values) if key in _NUMBERS}
    return RoomChange(**numbers, effects={key.removeprefix(EFFECTS): value for key, value in values.items()})
