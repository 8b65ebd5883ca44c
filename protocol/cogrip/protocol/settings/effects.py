"""Haptic effects and fixtures that a client renders itself (docs/effects.md, theory 7.8): their parameters, bounds and shapes.

A world tells them, or `[[effects]]` of the settings. Places are in the object's frame where it starts; on the wire in the
hand's own.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from math import dist, hypot, isfinite
from typing import Annotated, Literal, NamedTuple

import msgspec
from msgspec.structs import replace

from cogrip.protocol.axes import PLACES
from cogrip.protocol.drawing import Shape
from cogrip.protocol.settings.types import NAME_PATTERN, Name
from cogrip.protocol.texts import MARK_BYTES

EffectKind = Literal[
    "viscous", "vibration", "texture", "magnet", "path", "zone", "curl", "constant", "perturbation", "channel", "spring",
]  # fmt: skip
"""Kinds of effect. A kind is a name here, its row in EFFECT_KINDS, and its law in `cogrip.client.effects.effect_force`."""
MOST_EFFECTS = 16  # most effects of one seat at once
MOST_POINTS = 8  # most points of a path
MOST_EFFECT_HZ = 256.0
TANK_MJ = 10.0
Coordinate = Annotated[float, msgspec.Meta(ge=-1e3, le=1e3)]
Triple = tuple[Coordinate, Coordinate, Coordinate]
HalfEdge = Annotated[float, msgspec.Meta(ge=0.0, le=1e3)]
EffectTank = Annotated[float, msgspec.Meta(ge=0.0, le=1e3)]  # energy that the tank holds at most [mJ]
NOWHERE: Triple = (0.0, 0.0, 0.0)
Rgba = tuple[float, float, float, float]
LEAST: Mapping[str, float] = {"period_m": 1e-4, "radius_m": 1e-4, "frequency_hz": 1e-3}
"""Least value of a parameter that is not 0."""
LEAST_STEP_M = 1e-4  # least distance from a point of a path to the next
LEAST_EVERY_S = 0.1
"""Least period of an effect that is switched and pushes as long as it is there: switched faster it is felt as a vibration,
and taken for an oscillation."""
LEAST_DIRECTION = 1e-6  # least length of a vector that still has a direction
LEAST_PULSE_S = (
    0.01  # least time that a perturbation lasts: a shorter one is a knock, which a vibration of 0.1 s is as well
)
_PATH_RADIUS_M, _POINT_RADIUS_M = 0.001, 0.003
_NO_END_M = 0.1  # half of the length that is drawn along an axis where a box has no end


class Effect(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One effect. A new one with the same values begins anew: it is known by itself, not by them.

    place_m    middle of its box, of a magnet or spring its point, of a zone with a direction a point of its plane
    size_m     half edges of the box that it fills; 0 along an axis: no end
    direction  of a vibration, texture; in which a constant force or a perturbation pushes the hand; of a zone: normal of its
               plane, towards where the hand may be; of a curl field: axis about which it turns, clockwise seen against it
    points_m   of a path, in order; of a channel two of its line
    force_n    of a constant force; most that a fixture pulls or pushes with, 0: no bound of its own
    seconds    after which it ends, a perturbation with a box so long after the hand has come into that; 0: until it is removed
    """

    kind: EffectKind
    place_m: Triple = NOWHERE
    size_m: tuple[HalfEdge, HalfEdge, HalfEdge] = NOWHERE
    direction: Triple = NOWHERE
    points_m: Annotated[tuple[Triple, ...], msgspec.Meta(max_length=MOST_POINTS)] = ()
    stiffness_npm: Annotated[float, msgspec.Meta(ge=0.0, le=1e5)] = 0.0
    damping_nspm: Annotated[float, msgspec.Meta(ge=0.0, le=1e3)] = 0.0
    amplitude_n: Annotated[float, msgspec.Meta(ge=0.0, le=40.0)] = 0.0
    frequency_hz: Annotated[float, msgspec.Meta(ge=0.0, le=MOST_EFFECT_HZ)] = 0.0
    period_m: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.0
    radius_m: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.0
    force_n: Annotated[float, msgspec.Meta(ge=0.0, le=40.0)] = 0.0
    seconds: Annotated[float, msgspec.Meta(ge=0.0, le=1e6)] = 0.0

    @property
    def waits(self) -> bool:
        """Return whether it begins as the hand comes into its box, and not as it is told."""
        return self.kind == "perturbation" and any(self.size_m)


class EffectSection(Effect, frozen=True, forbid_unknown_fields=True):
    """[[effects]]: one that a room has from `start_s` on, again each `every_s`. users: whom it is for; () everybody.

    marker: `start_s` counts from each marker with this text; "": from the room's beginning.
    name: by which `cogrip set effects.NAME=on` begins it, and `=off` ends it
    """

    name: Annotated[str, msgspec.Meta(max_length=40, pattern=f"^$|{NAME_PATTERN}")] = ""
    users: tuple[Name, ...] = ()
    marker: Annotated[str, msgspec.Meta(max_length=MARK_BYTES)] = ""
    start_s: Annotated[float, msgspec.Meta(ge=0.0, le=1e6)] = 0.0
    every_s: Annotated[float, msgspec.Meta(ge=0.0, le=1e6)] = 0.0

    def begun(self) -> Effect:
        """Return a new effect of this section."""
        return Effect(**{name: getattr(self, name) for name in Effect.__struct_fields__})


def unfit_effect(effect: Effect, axes: int) -> str:
    """Return why an effect does not fit a hand of so many axes, with the cure; "" where it does."""
    kind = EFFECT_KINDS[effect.kind]
    for name in kind.needs:
        if getattr(effect, name) == 0.0:
            return f'kind = "{effect.kind}" needs {name} above 0'
    places = min(axes, PLACES)
    if kind.course and not _directed(effect, places):
        return f'kind = "{effect.kind}" needs a direction in the first {places} axes, such as [1, 0, 0]'
    if reason := kind.unfit(effect, places):
        return f'kind = "{effect.kind}" {reason}'
    for name, least in LEAST.items():
        if 0.0 < (value := getattr(effect, name)) < least:
            return f"{name} = {value:g} is below {least:g}, which no sampled motion shows; give more"
    return ""


def unfit_section(section: EffectSection, axes: int) -> str:
    """Return why an effect of the settings does not fit a hand of so many axes, with the cure; "" where it does."""
    if 0.0 < section.every_s < LEAST_EVERY_S and not EFFECT_KINDS[section.kind].course:
        return (
            f'every_s = {section.every_s:g} of kind = "{section.kind}" is below {LEAST_EVERY_S:g}: switched so fast it is a '
            'vibration, and its force is released as one that oscillates; give more, or kind = "vibration"'
        )
    return unfit_effect(section, axes)


def checked_effect(effect: object) -> Effect | str:
    """Return an effect that a world made, its bounds checked; else why it is refused."""
    if not isinstance(effect, Effect):
        return f"{type(effect).__name__} is no Effect"
    try:
        msgspec.convert(msgspec.to_builtins(effect), Effect)
    except (msgspec.ValidationError, TypeError, ValueError) as error:
        return f"{effect.kind!r}: {error}"
    numbers = [value for name in Effect.__struct_fields__ if isinstance(value := getattr(effect, name), float)]
    rows = (effect.place_m, effect.size_m, effect.direction, *effect.points_m)
    if not all(map(isfinite, numbers)) or not all(isfinite(each) for row in rows for each in row):
        return f"{effect.kind!r}: a number of it is not finite"
    return effect


def moved(effect: Effect, offset_m: Sequence[float]) -> Effect:
    """Return the effect that far away: in the hand's own frame of the object's, or back."""
    if not any(offset_m):
        return effect
    away = (*offset_m, *NOWHERE)[:PLACES]

    def at(place: Sequence[float]) -> Triple:
        x, y, z = [each + by for each, by in zip(place, away, strict=True)]
        return x, y, z

    return replace(effect, place_m=at(effect.place_m), points_m=tuple(map(at, effect.points_m)))


def drawn_effect(effect: Effect) -> list[Shape]:
    """Return shapes to draw an effect with: its box, ball, plane or path; none for one that is everywhere."""
    kind = EFFECT_KINDS[effect.kind]
    return kind.drawn(effect, kind.rgba)


def _directed(effect: Effect, places: int) -> bool:
    return hypot(*effect.direction[:places]) >= LEAST_DIRECTION


def _fits(effect: Effect, places: int) -> str:
    return ""


def _unfit_path(effect: Effect, places: int) -> str:
    return _unfit_points(effect, places, MOST_POINTS)


def _unfit_channel(effect: Effect, places: int) -> str:
    return _unfit_points(effect, places, 2)


def _unfit_points(effect: Effect, places: int, most: int) -> str:
    points = [point[:places] for point in effect.points_m]
    if not 2 <= len(points) <= most or any(dist(before, after) < LEAST_STEP_M for before, after in pairwise(points)):
        count = f"2 to {most}" if most > 2 else "2"
        apart = f"each at least {LEAST_STEP_M:g} m from the one before in the first {places} axes"
        return f"needs points_m: {count}, {apart}"
    return "has nothing beside it in one axis; set object.axes to 2 or 3" if places == 1 else ""


def _unfit_curl(effect: Effect, places: int) -> str:
    if places == 1:
        return "turns no motion of one axis; set object.axes to 2 or 3"
    if places == 2 and abs(effect.direction[2]) < LEAST_DIRECTION:
        return "needs a direction: its axis, of two axes [0, 0, 1], or [0, 0, -1] the other way round"
    return "" if _directed(effect, PLACES) else "needs a direction: its axis, such as [0, 0, 1]"


def _unfit_perturbation(effect: Effect, places: int) -> str:
    if effect.seconds >= LEAST_PULSE_S:
        return ""
    return f"with seconds = {effect.seconds:g} is over before a hand feels it; give at least {LEAST_PULSE_S:g}"


def _unfit_zone(effect: Effect, places: int) -> str:
    if any(effect.direction) and not _directed(effect, places):
        return f"has a direction outside of the first {places} axes; turn it"
    if not any(effect.direction) and not any(effect.size_m[:places]):
        return f"fills everything; give size_m in the first {places} axes, or a direction"
    return ""


def _box(effect: Effect, rgba: Rgba) -> list[Shape]:
    if not any(effect.size_m):
        return []
    x, y, z = [each or _NO_END_M for each in effect.size_m]
    return [Shape("box", (x, y, z), place_m=effect.place_m, rgba=rgba)]


def _ball(effect: Effect, rgba: Rgba) -> list[Shape]:
    return [Shape("sphere", (effect.radius_m, 0.0, 0.0), place_m=effect.place_m, rgba=rgba)]


def _point(effect: Effect, rgba: Rgba) -> list[Shape]:
    return [Shape("sphere", (_POINT_RADIUS_M, 0.0, 0.0), place_m=effect.place_m, rgba=rgba)]


def _polyline(effect: Effect, rgba: Rgba) -> list[Shape]:
    return [_segment(one, other, rgba) for one, other in pairwise(effect.points_m)]


def _plane_or_box(effect: Effect, rgba: Rgba) -> list[Shape]:
    if not any(effect.direction):
        return _box(effect, rgba)
    turned = _turned_from_z(effect.direction)
    return [Shape("plane", (_NO_END_M, _NO_END_M, 0.0), None, effect.place_m, turned, rgba)]


def _segment(one: Triple, other: Triple, rgba: Rgba) -> Shape:
    middle = tuple([0.5 * (a + b) for a, b in zip(one, other, strict=True)])
    along = [b - a for a, b in zip(one, other, strict=True)]
    size = (_PATH_RADIUS_M, 0.5 * dist(one, other), 0.0)
    return Shape("capsule", size, None, middle, _turned_from_z(along), rgba)


def _turned_from_z(towards: Sequence[float]) -> tuple[float, float, float, float]:
    """Return the shortest turn of the z axis to this direction, as a quaternion w, x, y, z."""
    length = hypot(*towards)
    x, y, z = [each / length for each in towards]
    if z < -0.999999:
        return 0.0, 1.0, 0.0, 0.0
    w = 1.0 + z
    size = hypot(w, x, y)
    return w / size, -y / size, x / size, 0.0


class EffectTraits(NamedTuple):
    """Properties of a kind of effect.

    needs   parameters that must be above 0
    rgba    its colour in pictures and views
    drawn   shapes to draw one with, in that colour
    course  its force has a course of its own, over time or place, along a direction: switched fast it is a vibration
    unfit   what is wrong with one in so many places, with the cure; "" for nothing
    """

    needs: tuple[str, ...]
    rgba: Rgba
    drawn: Callable[[Effect, Rgba], list[Shape]] = _box
    course: bool = False
    unfit: Callable[[Effect, int], str] = _fits


EFFECT_KINDS: Mapping[EffectKind, EffectTraits] = {
    "viscous": EffectTraits(("damping_nspm",), (0.34, 0.71, 0.91, 0.2)),
    "vibration": EffectTraits(("amplitude_n", "frequency_hz"), (0.9, 0.62, 0.0, 0.2), course=True),
    "texture": EffectTraits(("amplitude_n", "period_m"), (0.8, 0.47, 0.65, 0.2), course=True),
    "magnet": EffectTraits(("stiffness_npm", "radius_m"), (0.0, 0.45, 0.7, 0.25), _ball),
    "path": EffectTraits(("stiffness_npm",), (0.0, 0.62, 0.45, 0.8), _polyline, unfit=_unfit_path),
    "zone": EffectTraits(("stiffness_npm",), (0.84, 0.37, 0.0, 0.3), _plane_or_box, unfit=_unfit_zone),
    "curl": EffectTraits(("damping_nspm",), (0.94, 0.89, 0.26, 0.25), unfit=_unfit_curl),
    "constant": EffectTraits(("force_n",), (0.6, 0.6, 0.6, 0.25), course=True),
    "perturbation": EffectTraits(
        ("amplitude_n", "seconds"), (0.4, 0.4, 0.4, 0.25), course=True, unfit=_unfit_perturbation
    ),
    "channel": EffectTraits(("stiffness_npm",), (0.84, 0.37, 0.0, 0.8), _polyline, unfit=_unfit_channel),
    "spring": EffectTraits(("stiffness_npm",), (0.8, 0.47, 0.65, 0.9), _point),
}
"""One row a kind."""
