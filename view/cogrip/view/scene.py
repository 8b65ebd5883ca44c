"""Scene of a view: what does not change from frame to frame (`docs/view.md`)."""

from collections.abc import Sequence
from itertools import product
from math import dist, isfinite
from typing import Literal

import msgspec

from cogrip.machine.rows import Vector
from cogrip.protocol.drawing import Shape
from cogrip.protocol.session_drawing import colour as colour
from cogrip.protocol.session_drawing import object_size_m
from cogrip.protocol.settings.object_kinds import kind_of
from cogrip.protocol.wire.messages import Pose

Mode = Literal["live", "recording"]
WORKSPACE_M = ((-0.1, 0.1),) * 3
_WIDEST_M = 2.0  # largest coordinate that the camera takes in
EventKind = Literal["joined", "left", "lost", "kicked", "fault", "marker", "button", "other"]


class SceneEvent(msgspec.Struct, frozen=True, tag_field="type", tag="event"):
    """Something that happened at `time_s` on the session's clock."""

    time_s: float
    kind: EventKind
    who: str
    text: str


class ScenePerson(msgspec.Struct, frozen=True):
    """A person in the scene. anchor_m: where on the object this person holds it."""

    seat: int
    name: str
    colour: str
    anchor_m: Vector


class DrawnObject(msgspec.Struct, frozen=True):
    """The shared object as it is drawn. kind: as in the settings."""

    kind: str
    shape: Literal["box", "sphere", "wall"]
    size_m: Vector
    mass_kg: float


def scene_object(kind: str, mass_kg: float) -> DrawnObject:
    """Return the object of a kind as it is drawn."""
    return DrawnObject(kind, "wall" if kind_of(kind).fixed else "box", object_size_m(kind), mass_kg)


class Geometry(msgspec.Struct, frozen=True):
    """A fixed body of the scene."""

    shape: Literal["box", "plane"]
    position_m: Vector
    normal: Vector
    size_m: Vector


class PageScene(msgspec.Struct, frozen=True, tag_field="type", tag="scene"):
    """All that a page needs before its first frame."""

    room: str
    mode: Mode
    axes: int
    network_hz: int
    device_hz: int
    object: DrawnObject
    people: tuple[ScenePerson, ...] = ()
    geometry: tuple[Geometry, ...] = ()
    workspace_m: tuple[tuple[float, float], ...] = WORKSPACE_M
    geoms: tuple[Shape, ...] = ()  # of a scene: drawn instead of the object
    effects: tuple[Shape, ...] = ()  # haptic effects, beside it
    hand: bool = False
    own_seat: int | None = None
    note: str = ""
    duration_s: float | None = None
    chunks: int = 0
    events: tuple[SceneEvent, ...] = ()
    version: int = 1


def workspace_of(shapes: Sequence[Shape], poses: Sequence[Pose]) -> tuple[tuple[float, float], ...]:
    """Return what the camera takes in of a scene: the usual workspace, all bodies where they are, no more below its floor."""
    low, high = [each for each, _ in WORKSPACE_M], [each for _, each in WORKSPACE_M]
    floors: list[float] = []
    for shape in shapes:
        if shape.kind == "plane":
            if shape.body is None and abs(shape.orientation[0]) > 0.999:
                floors.append(shape.place_m[2])
            continue
        reach = dist(shape.size_m, (0.0,) * 3)
        places: list[Sequence[float]] = [poses[body][:3] for body in shape.bodies if body < len(poses)]
        if shape.body is None and not shape.soft:
            places = [shape.place_m]
        elif shape.body is not None:
            reach += dist(shape.place_m, (0.0,) * 3)
        for at, axis in product(places, range(3)):
            if isfinite(at[axis]):
                low[axis] = max(-_WIDEST_M, min(low[axis], at[axis] - reach))
                high[axis] = min(_WIDEST_M, max(high[axis], at[axis] + reach))
    floor = max((each for each in floors if each < 0.0), default=low[2])
    low[2] = max(low[2], floor)
    return tuple(zip(low, high, strict=True))


def turn_of(shapes: Sequence[Shape], poses: Sequence[Pose]) -> tuple[float, float, float, float]:
    """Return the orientation of the object's body; unturned where it has none, or it is not known."""
    body = next((shape.body for shape in shapes if shape.object and shape.body is not None), None)
    if body is None or body >= len(poses) or not all(map(isfinite, poses[body])):
        return 1.0, 0.0, 0.0, 0.0
    w, x, y, z = poses[body][3:]
    return w, x, y, z


def to_json(message: PageScene | SceneEvent | Sequence[SceneEvent]) -> str:
    """Return a text message."""
    return msgspec.json.encode(message).decode()
