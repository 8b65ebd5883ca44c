"""Numbers of a frame as plain JSON, for plots: as they are in the frame, null for what is not known, or not finite."""

import msgspec

from cogrip.protocol.recording.records import Number
from cogrip.protocol.recording.scene_messages import FoxgloveMessage
from cogrip.view.frames import CONTACT, NOT_PASSIVE, PUSHES, PersonFrame, SceneFrame

_encode = msgspec.json.Encoder().encode


class Vector(FoxgloveMessage, frozen=True, gc=False):
    x: Number
    y: Number
    z: Number


class Turned(Vector, frozen=True, gc=False):
    """A quaternion."""

    w: Number


class ObjectNumbers(FoxgloveMessage, frozen=True, gc=False):
    """The object. Its number is that of the room's step."""

    time_s: float
    number: int
    position_m: Vector
    velocity_mps: Vector
    orientation: Turned
    contact: bool


class PersonNumbers(FoxgloveMessage, frozen=True, gc=False):
    """One person, as in `PersonFrame`."""

    time_s: float
    state: str
    pushes: bool
    passive: bool
    hand_m: Vector
    proxy_m: Vector
    seen_m: Vector
    force_n: Vector
    rtt_ms: Number
    up_ms: Number
    down_ms: Number
    buffer_up_ms: Number
    buffer_down_ms: Number
    up_reserve_mj: Number
    line_reserve_mj: Number
    lost: int
    loss: Number
    buttons: int
    grip_m: Number
    handle: Turned


def object_numbers(frame: SceneFrame) -> bytes:
    """Return the object's numbers as JSON."""
    w, x, y, z = frame.orientation
    position, velocity = Vector(*frame.position_m), Vector(*frame.velocity_mps)
    touched = bool(frame.flags & CONTACT)
    return _encode(ObjectNumbers(frame.time_s, frame.number, position, velocity, Turned(x, y, z, w), touched))


def person_numbers(person: PersonFrame, time_s: float) -> bytes:
    """Return a person's numbers as JSON."""
    w, x, y, z = person.orientation
    numbers = PersonNumbers(
        time_s, person.state, bool(person.flags & PUSHES), not person.flags & NOT_PASSIVE, Vector(*person.hand_m),
        Vector(*person.proxy_m), Vector(*person.seen_m), Vector(*person.force_n), person.rtt_ms, person.up_ms,
        person.down_ms, person.buffer_up_ms, person.buffer_down_ms, person.up_reserve_mj, person.line_reserve_mj,
        person.lost, person.loss, person.buttons, person.grip_m, Turned(x, y, z, w),
    )  # fmt: skip
    return _encode(numbers)
