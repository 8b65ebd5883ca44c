"""Messages for the 3D panels of Foxglove and Lichtblick: `foxglove.SceneUpdate` and `foxglove.FrameTransforms`, as JSON.

Field names and meanings are those of the published schemas (github.com/foxglove/foxglove-sdk, schemas/jsonschema). They are
pictures: lengths are rounded to 0.1 um. What is exact stands in the records.
"""

from collections.abc import Collection, Sequence
from functools import lru_cache
from math import isfinite, sqrt
from typing import Any, NamedTuple

import msgspec
from msgspec import inspect

from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Vector
from cogrip.protocol.drawing import Shape
from cogrip.protocol.session_drawing import FORCE_M_PER_N, HAND_SIZE_M, LEAST_DRAWN_N, OBJECT_COLOUR, colour

SCENE_UPDATE, FRAME_TRANSFORMS = "foxglove.SceneUpdate", "foxglove.FrameTransforms"
_encode = msgspec.json.Encoder().encode
_DIGITS = 7
_SHAFT_M, _HEAD_M = 0.003, 0.008
_PLANE_M, _NO_END_M = 0.001, 2.0  # thickness of a plane, and side of one without an end
_ALL = 1  # number that stands for all entities in a deletion
_LINE_STRIP, _LINE_LIST = 0, 2


class FoxgloveMessage(msgspec.Struct, frozen=True, gc=False):
    """Base of all messages and their parts."""


class Time(FoxgloveMessage, frozen=True, gc=False):
    sec: int
    nsec: int


class Duration(FoxgloveMessage, frozen=True, gc=False):
    sec: int = 0
    nsec: int = 0


class Vector3(FoxgloveMessage, frozen=True, gc=False):
    x: float
    y: float
    z: float


class Point3(Vector3, frozen=True, gc=False):
    pass


class Quaternion(FoxgloveMessage, frozen=True, gc=False):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


class Pose(FoxgloveMessage, frozen=True, gc=False):
    position: Vector3 = Vector3(0.0, 0.0, 0.0)
    orientation: Quaternion = Quaternion()


class Color(FoxgloveMessage, frozen=True, gc=False):
    r: float
    g: float
    b: float
    a: float = 1.0


class ArrowPrimitive(FoxgloveMessage, frozen=True, gc=False):
    pose: Pose
    shaft_length: float
    color: Color
    shaft_diameter: float = _SHAFT_M
    head_length: float = _HEAD_M
    head_diameter: float = 2 * _SHAFT_M


class CubePrimitive(FoxgloveMessage, frozen=True, gc=False):
    size: Vector3
    color: Color
    pose: Pose = Pose()


class SpherePrimitive(FoxgloveMessage, frozen=True, gc=False):
    size: Vector3
    color: Color
    pose: Pose = Pose()


class CylinderPrimitive(FoxgloveMessage, frozen=True, gc=False):
    """Its axis is z."""

    size: Vector3
    color: Color
    pose: Pose = Pose()
    bottom_scale: float = 1.0
    top_scale: float = 1.0


class LinePrimitive(FoxgloveMessage, frozen=True, gc=False):
    points: tuple[Point3, ...]
    color: Color
    colors: tuple[Color, ...] = ()
    indices: tuple[int, ...] = ()
    type: int = _LINE_LIST
    pose: Pose = Pose()
    thickness: float = 2.0
    scale_invariant: bool = True


class TextPrimitive(FoxgloveMessage, frozen=True, gc=False):
    text: str
    color: Color
    pose: Pose = Pose(Vector3(0.0, 0.0, 2 * HAND_SIZE_M))
    billboard: bool = True
    font_size: float = 14.0
    scale_invariant: bool = True


class KeyValuePair(FoxgloveMessage, frozen=True, gc=False):
    key: str
    value: str


class TriangleListPrimitive(FoxgloveMessage, frozen=True, gc=False):
    points: tuple[Point3, ...]
    color: Color
    pose: Pose = Pose()
    colors: tuple[Color, ...] = ()
    indices: tuple[int, ...] = ()


class NotUsed(FoxgloveMessage, frozen=True, gc=False):
    """A primitive that is never sent: models."""


class SceneEntity(FoxgloveMessage, frozen=True, gc=False):
    timestamp: Time
    frame_id: str
    id: str
    frame_locked: bool = True
    lifetime: Duration = Duration()
    metadata: tuple[KeyValuePair, ...] = ()
    arrows: tuple[ArrowPrimitive, ...] = ()
    cubes: tuple[CubePrimitive, ...] = ()
    spheres: tuple[SpherePrimitive, ...] = ()
    cylinders: tuple[CylinderPrimitive, ...] = ()
    lines: tuple[LinePrimitive, ...] = ()
    triangles: tuple[TriangleListPrimitive, ...] = ()
    texts: tuple[TextPrimitive, ...] = ()
    models: tuple[NotUsed, ...] = ()


class SceneEntityDeletion(FoxgloveMessage, frozen=True, gc=False):
    timestamp: Time
    type: int = _ALL
    id: str = ""


class SceneUpdate(FoxgloveMessage, frozen=True, gc=False):
    deletions: tuple[SceneEntityDeletion, ...]
    entities: tuple[SceneEntity, ...]


class FrameTransform(FoxgloveMessage, frozen=True, gc=False):
    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    translation: Vector3
    rotation: Quaternion = Quaternion()


class FrameTransforms(FoxgloveMessage, frozen=True, gc=False):
    transforms: tuple[FrameTransform, ...]


class Body(NamedTuple):
    """A thing to draw, at the origin of its frame. size_m: edges of a box, diameters of a sphere; shapes: instead of either."""

    frame: str
    size_m: Vector
    colour: str
    box: bool = False
    label: str = ""
    alpha: float = 1.0
    shapes: tuple[tuple[Shape, Color], ...] = ()


class Place(NamedTuple):
    """A frame's place in the root frame."""

    frame: str
    at_m: Vector
    turned: Quaternion = Quaternion()


class Push(NamedTuple):
    """A person's force on the object, drawn at `at_m`; the coupling is drawn from there to `hand_m` where that is known."""

    at_m: Vector
    force_n: Vector
    colour: str
    hand_m: Vector | None = None


def scene_update(time_ns: int, bodies: Sequence[Body]) -> bytes:
    """Return the whole scene: whatever was drawn before is deleted, so that a viewer may begin with any message."""
    now = _time(time_ns)
    return _encode(SceneUpdate((SceneEntityDeletion(now),), tuple([_entity(now, body) for body in bodies])))


def _entity(now: Time, body: Body) -> SceneEntity:
    size, color = _vector(body.size_m), _color(body.colour, body.alpha)
    texts = (TextPrimitive(body.label, _color(body.colour)),) if body.label else ()
    if body.shapes:
        return _shaped(now, body)
    if body.box:
        return SceneEntity(now, body.frame, body.frame, cubes=(CubePrimitive(size, color),), texts=texts)
    return SceneEntity(now, body.frame, body.frame, spheres=(SpherePrimitive(size, color),), texts=texts)


def _shaped(now: Time, body: Body) -> SceneEntity:
    cubes: list[CubePrimitive] = []
    spheres: list[SpherePrimitive] = []
    cylinders: list[CylinderPrimitive] = []
    surfaces: list[TriangleListPrimitive] = []
    for shape, color in body.shapes:
        pose = Pose(_vector(_three(shape.place_m)), quaternion_of(shape.orientation))
        a, b, c = shape.size_m
        if shape.kind == "box":
            cubes.append(CubePrimitive(_vector((2 * a, 2 * b, 2 * c)), color, pose))
        elif shape.kind == "plane":
            sides = [2 * each if each > 0.0 else _NO_END_M for each in (a, b)]
            cubes.append(CubePrimitive(_vector((sides[0], sides[1], _PLANE_M)), color, pose))
        elif shape.kind == "ellipsoid":
            spheres.append(SpherePrimitive(_vector((2 * a, 2 * b, 2 * c)), color, pose))
        elif shape.kind == "mesh":
            corners = tuple([_point(each) for each in shape.corners_m()])
            painted = tuple([Color(*rgb, color.a) for rgb in shape.triangle_colours() for _ in range(3)])
            surfaces.append(TriangleListPrimitive(corners, color, pose, painted))
        elif shape.kind == "sphere":
            spheres.append(SpherePrimitive(_vector((2 * a, 2 * a, 2 * a)), color, pose))
        else:
            cylinders.append(CylinderPrimitive(_vector((2 * a, 2 * a, 2 * b)), color, pose))
        if shape.kind == "capsule":
            along = _third_axis(shape.orientation)
            for sign in (-b, b):
                end = [place + sign * each for place, each in zip(shape.place_m, along, strict=True)]
                spheres.append(SpherePrimitive(_vector((2 * a, 2 * a, 2 * a)), color, Pose(_vector(_three(end)))))
    return SceneEntity(
        now, body.frame, body.frame, cubes=tuple(cubes), spheres=tuple(spheres), cylinders=tuple(cylinders),
        triangles=tuple(surfaces),
    )  # fmt: skip


def _three(values: Sequence[float]) -> Vector:
    x, y, z = values
    return x, y, z


def _third_axis(orientation: Sequence[float]) -> Vector:
    """Return where a rotation takes the z axis."""
    w, x, y, z = orientation
    return 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)


def quaternion_of(orientation: Sequence[float]) -> Quaternion:
    """Return w, x, y, z as these messages have it."""
    w, x, y, z = orientation
    return Quaternion(round(x, _DIGITS), round(y, _DIGITS), round(z, _DIGITS), round(w, _DIGITS))


def scene_bodies(room: str, shapes: Sequence[Shape], held: Collection[int]) -> list[Body]:
    """Return the bodies of a scene, and as one, in the root frame, what is fixed; without tools that nobody holds."""
    parts: dict[str, list[tuple[Shape, Color]]] = {}
    for shape in shapes:
        if shape.seat is None or shape.seat in held:
            own = _color(OBJECT_COLOUR) if shape.rgba is None else Color(*shape.rgba)
            color = own if shape.seat is None else _color(colour(shape.seat))
            if not shape.soft:  # these follow each frame: `soft_entities`
                parts.setdefault(room if shape.body is None else body_frame(room, shape.body), []).append(
                    (shape, color)
                )
    return [Body(frame, (0.0, 0.0, 0.0), OBJECT_COLOUR, shapes=tuple(each)) for frame, each in parts.items()]


def body_frame(room: str, body: int) -> str:
    """Return the frame of a scene's body."""
    return f"{room}/body/{body}"


def body_places(room: str, shapes: Sequence[Shape], poses: Sequence[Sequence[float]]) -> list[Place]:
    """Return where a scene's bodies are; those whose pose is not known, and points of what is flexible, are left out."""
    return [
        Place(body_frame(room, number), _three(poses[number][:3]), quaternion_of(poses[number][3:]))
        for number in sorted({shape.body for shape in shapes if shape.body is not None})
        if number < len(poses) and all(map(isfinite, poses[number]))
    ]


def soft_entities(
    time_ns: int, room: str, shapes: Sequence[Shape], poses: Sequence[Sequence[float]]
) -> tuple[SceneEntity, ...]:
    """Return flexible bodies as triangles and tendons as lines, where their points are now; none where one is not known."""
    lines: list[LinePrimitive] = []
    surfaces: list[TriangleListPrimitive] = []
    for shape in shapes:
        numbers = shape.bodies if shape.points else ()
        if not numbers or any(number >= len(poses) or not all(map(isfinite, poses[number][:3])) for number in numbers):
            continue
        color = _color(OBJECT_COLOUR) if shape.rgba is None else Color(*shape.rgba)
        corners = {number: at for at, number in enumerate(dict.fromkeys(numbers))}
        points = tuple([_point(_three(poses[number][:3])) for number in corners])
        indices = tuple([corners[number] for number in numbers])
        if shape.kind == "flex":
            surfaces.append(TriangleListPrimitive(points, color, indices=indices))
        else:
            lines.append(
                LinePrimitive(
                    points, color, (), indices, _LINE_STRIP, thickness=2.0 * shape.size_m[0], scale_invariant=False
                )
            )
    if not lines and not surfaces:
        return ()
    return (SceneEntity(_time(time_ns), room, "soft", lines=tuple(lines), triangles=tuple(surfaces)),)


def soft_update(soft: tuple[SceneEntity, ...]) -> bytes:
    """Return flexible bodies and tendons, instead of those before."""
    return _encode(SceneUpdate((), soft))


def forces_update(time_ns: int, root: str, pushes: Sequence[Push], soft: tuple[SceneEntity, ...] = ()) -> bytes:
    """Return arrows of forces and lines of couplings, instead of those before, and what is flexible (`soft_entities`)."""
    now = _time(time_ns)
    arrows = tuple([_arrow(push) for push in pushes if _norm(push.force_n) >= LEAST_DRAWN_N])
    lines = tuple(
        [
            LinePrimitive((_point(push.at_m), _point(push.hand_m)), _color(push.colour))
            for push in pushes
            if push.hand_m is not None
        ]
    )
    return _encode(SceneUpdate((), (SceneEntity(now, root, "forces", arrows=arrows, lines=lines), *soft)))


def frame_transforms(time_ns: int, root: str, places: Sequence[Place]) -> bytes:
    """Return where frames are in the frame `root`."""
    now = _time(time_ns)
    return _encode(
        FrameTransforms(
            tuple([FrameTransform(now, root, each.frame, _vector(each.at_m), each.turned) for each in places])
        )
    )


def turned_to(direction: Vector) -> Quaternion:
    """Return the rotation that turns the first axis into `direction` (half-way quaternion 1 + d.x, x cross d)."""
    length = _norm(direction)
    x, y, z = (each / length for each in direction)
    if x < -1.0 + 1e-9:
        return Quaternion(0.0, 0.0, 1.0, 0.0)
    norm = sqrt(2.0 * (1.0 + x))
    return Quaternion(0.0, round(-z / norm, 5), round(y / norm, 5), round(norm / 2.0, 5))


def _arrow(push: Push) -> ArrowPrimitive:
    length = round(FORCE_M_PER_N * _norm(push.force_n), 5)
    pose = Pose(_vector(push.at_m), turned_to(push.force_n))
    return ArrowPrimitive(pose, max(0.0, length - _HEAD_M), _color(push.colour), head_length=min(_HEAD_M, length))


def _norm(values: Vector) -> float:
    return sqrt(add_floats([each * each for each in values]))


def _point(values: Vector) -> Point3:
    x, y, z = values
    return Point3(round(x, _DIGITS), round(y, _DIGITS), round(z, _DIGITS))


def _vector(values: Vector) -> Vector3:
    x, y, z = values
    return Vector3(round(x, _DIGITS), round(y, _DIGITS), round(z, _DIGITS))


@lru_cache(256)
def _color(colour: str, alpha: float = 1.0) -> Color:
    red, green, blue = (round(int(colour[each : each + 2], 16) / 255, 3) for each in (1, 3, 5))
    return Color(red, green, blue, alpha)


def _time(time_ns: int) -> Time:
    return Time(*divmod(max(0, time_ns), 10**9))


_TYPES = {
    inspect.IntType: "integer",
    inspect.FloatType: "number",
    inspect.StrType: "string",
    inspect.BoolType: "boolean",
}


def _schema(kind: inspect.Type) -> dict[str, Any]:
    if isinstance(kind, inspect.UnionType):  # may be null, as in the schemas of records
        value = next(each for each in kind.types if not isinstance(each, inspect.NoneType))
        return {**_schema(value), "nullable": True}
    if isinstance(kind, inspect.VarTupleType):
        return {"type": "array", "items": _schema(kind.item_type)}
    if isinstance(kind, inspect.StructType):
        name = kind.cls.__name__
        title = f"foxglove.{name}" if kind.cls.__module__ == __name__ else f"cogrip.{name}"
        if kind.cls in (Time, Duration):
            title = name.lower()
        properties = {field.encode_name: _schema(field.type) for field in kind.fields}
        required = {"required": list(properties)} if properties else {}  # early JSON Schema takes no empty list
        return {"title": title, "type": "object", "properties": properties, **required}
    return {"type": _TYPES[type(kind)]}


def json_schema(message: type[FoxgloveMessage]) -> bytes:
    """Return the JSON schema of a message, as text."""
    return _encode(_schema(inspect.type_info(message)))


SCHEMAS: dict[str, bytes] = {
    SCENE_UPDATE: json_schema(SceneUpdate),
    FRAME_TRANSFORMS: json_schema(FrameTransforms),
}
"""JSON schema of the part that is used, as text, by the name of the schema."""
