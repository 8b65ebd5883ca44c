"""JSON schemas of the records, in the plain form that viewers read: no references, no unions, no arrays of arrays.

Foxglove refuses a whole channel for any of these. A field that may be null has the one type of its values and, as in
OpenAPI 3.0, `nullable`. The descriptions of fields, of records and accounts, are in docs/recordings.md too.
"""

from functools import cache
from typing import Any

import msgspec
from msgspec import inspect

NOT_SHOWN = ("unfit", "triangles", "colours", "points", "period_m", "left_out", "solid")
"""Fields of messages that no schema has: an array of arrays, and those that few shapes or scenes have."""

_NAMES = {
    inspect.IntType: "integer", inspect.FloatType: "number", inspect.StrType: "string", inspect.BoolType: "boolean",
}  # fmt: skip
UNITS = {
    "mps": "m/s", "npm": "N/m", "nspm": "N s/m", "us": "µs", "ms": "ms", "ns": "ns", "m": "m", "n": "N", "j": "J", "s": "s",
    "frames": "network frames", "ticks": "device ticks",
}  # fmt: skip
"""Unit of a field, by the end of its name."""
_OTHER_UNITS = {"wave_up": "sqrt(W)", "wave_down": "sqrt(W)", "ticks": "", "frames": ""}

DESCRIPTIONS = {
    # tick
    "tick": "number of the device tick",
    "late_us": "how late this tick came",
    "work_us": "computing time of the tick or step before",
    "position_m": "position of the hand as the device gave it; null: no sample, or a number that is not finite",
    "velocity_mps": "velocity of the device where it gives one, else estimated from positions",
    "force_n": "force on the hand; of a seat: force of its spring on the object",
    "work_j": "work of the hand against the force, so far",
    "port_j": "energy that went into the wave line, so far",
    "wave_up": "wave u sent at the last frame border",
    "wave_down": "wave v held over this frame",
    "object_m": "position of the object; at a client: as last received",
    "margin_j": "least energy margin of the line down, so far; null: no waves",
    "rtt_ms": "round-trip time, smoothed; null: not measured yet",
    "lost": "network frames from the other end that were lost, so far",
    "state": "state of the client's safety: live, degraded, fault ...",
    "skipped": "ticks or steps that the loop skipped, so far",
    "playout_frames": "frames that the playout holds back now; null: no waves",
    "given_mps": "velocity that the device gave, where it is not velocity_mps",
    "reserve_j": "energy reserve of the line down, as of this frame; null: no waves",
    "device_reserve_j": "energy that the device port may still give",
    "unfit": "position and velocity of a sample with a number that is not finite, as text",
    "age_ticks": "age of the sample",
    "up_ms": "delay of the path up, one way; null: not known",
    "down_ms": "delay of the path down, one way; null: not known",
    "buttons": "buttons that are down: bit k, button k + 1",
    "grip_m": "opening of the gripper; null: there is none",
    # step, and its seats
    "step": "number of the step of the room",
    "object_mps": "velocity of the object",
    "seats": "seats of the room, in the order of the settings",
    "frames": "network frames in this step; more than 1 where the loop missed some",
    "user": "name of the person whose seat it is",
    "seated": "whether somebody has the seat",
    "proxy_m": "position of the person's proxy at the object",
    "up_margin_j": "least energy margin of the line up, so far",
    "line_margin_j": "least of the energy in at the client's port less the energy out at the server's, so far",
    "up_reserve_j": "energy reserve of the line up, as of this frame",
    "line_reserve_j": "energy in at the client's port less the energy out at the server's, as of this frame",
    "up_used_j": "energy that came out of the line up, so far",
    "down_made_j": "energy that went into the line down, so far",
    "normal_n": "normal force of all contacts of the seat's tool; null: no scene",
    "friction_n": "friction of all contacts of the seat's tool",
    "slip_m": "tangential motion of the seat's tool along the body that it touches, since they met",
    "edges": "edges of buttons that the world was given in this step: above 0 a button went down, below 0 up",
    "edge_ticks": "how long each edge had happened when it was sent",
    # geoms and poses of a scene
    "shapes": "shapes that the scene is drawn of",
    "size_m": "size as MJCF has it: radius, half lengths",
    "body": "number of the shape's body among those that move; null: it is fixed to the world",
    "place_m": "place in the body's frame",
    "orientation": "quaternion w, x, y, z; of a handle, null: not known",
    "rgba": "red, green, blue and opacity, 0 to 1; null: the scene gives none",
    "seat": "whose tool it is part of",
    "object": "whether it is part of the object",
    "triangles": "part of a mesh's surface, nine unsigned 16-bit numbers each, as in the message Geom",
    "colours": "red, green and blue of each triangle of a mesh or each cell of a plane's tile, a byte each",
    "points": "numbers of the bodies through whose places a flexible body or a tendon is drawn, 16 bits each",
    "period_m": "sides of a plane's tile along its x and y",
    "left_out": "what MuJoCo draws of the scene and the shapes do not say, in words",
    "offsets_m": "position of each seat's own frame less the object's, three numbers a seat",
    "poses": "place in the object's frame [m] and quaternion w, x, y, z of each body, seven numbers a body",
    # sensors of a scene
    "names": "of each number of the sensors, in the first record alone",
    "sensors": "values of the scene's own sensors, in MuJoCo's units",
    # the others
    "data": "the datagram's bytes",
    "address": "address of the other end; empty at a client",
    "kind": "kind of the input: connect, poll, stop, rearm ...; of a shape: box, sphere, capsule ...",
    "value": "the input as JSON text",
    "verb": "call into the core: call, poll, stop, rearm ...",
    "reason": "why, or the room it is about",
    "count": "how many steps of a room where nobody sits",
    "ticks": "ticks of a loop, as JSON text",
    "room": "name of the room",
    "session": "number of a new session",
    "ticket": "hash of a session ticket",
    "grant": "answer to a request for admission, as JSON text",
    "shown": "public id of the token that was shown with a ticket, as JSON text",
    "text": "the event, in words",
    "monotonic_ns": "the machine's steady clock",
    "utc_ns": "UTC, read at the same moment",
    "messages": "how many messages are missing before this place",
    "account": "the whole account at the end, as JSON text",
}


def unit_of(name: str) -> str:
    """Return the unit of a field, by the end of its name; empty where it has none."""
    return _OTHER_UNITS.get(name, UNITS.get(name.rpartition("_")[2], "") if "_" in name else "")


def described(name: str) -> str:
    """Return the line on a field with its unit, such as `age of the sample [device ticks]`; empty for an unknown field."""
    unit = unit_of(name)
    return " ".join(filter(None, (DESCRIPTIONS.get(name, ""), f"[{unit}]" if unit else "")))


@cache
def json_schema(record: type[msgspec.Struct]) -> bytes:
    """Return the schema of a record as JSON text: every key that is always there, with its unit and what it means."""
    return msgspec.json.encode({"title": record.__name__, **_schema(inspect.type_info(record))})


def _schema(kind: inspect.Type) -> dict[str, Any]:
    if isinstance(kind, inspect.UnionType):
        value = next(each for each in kind.types if not isinstance(each, inspect.NoneType))
        return {**_schema(value), "nullable": True}
    if isinstance(kind, inspect.LiteralType):
        return {"type": "string"}
    if isinstance(kind, inspect.BytesType):
        return {"type": "string", "contentEncoding": "base64"}
    if isinstance(kind, inspect.VarTupleType):
        return {"type": "array", "items": _schema(kind.item_type)}
    if isinstance(kind, inspect.StructType):
        fields = [field for field in kind.fields if field.name not in NOT_SHOWN]
        properties = {field.encode_name: _field(field) for field in fields}
        return {"type": "object", "properties": properties, "required": list(properties)}
    return {"type": _NAMES[type(kind)]}


def _field(field: inspect.Field) -> dict[str, Any]:
    text = described(field.name)
    return {"title": field.encode_name, **({"description": text} if text else {}), **_schema(field.type)}
