"""Numbers of a frame as plain JSON, for plots: as they are in the frame, null for what is not known."""

import msgspec

from cogrip.protocol.recording.scene_messages import FoxgloveMessage, Quaternion, Vector3
from cogrip.view.frames import CONTACT, NOT_PASSIVE, PUSHES, PersonFrame, SceneFrame

_encode = msgspec.json.Encoder().encode


class ObjectNumbers(FoxgloveMessage, frozen=True, gc=False):
    """The object. Its number is that of the room's step."""

    time_s: float
    number: int
    position_m: Vector3
    velocity_mps: Vector3
    orientation: Quaternion
    contact: bool


class PersonNumbers(FoxgloveMessage, frozen=True, gc=False):
    """One person, as in `PersonFrame`."""

    time_s: float
    state: str
    pushes: bool
    passive: bool
    hand_m: Vector3
    proxy_m: Vector3
    seen_m: Vector3
    force_n: Vector3
    rtt_ms: float
    up_ms: float
    down_ms: float
    buffer_up_ms: float
    buffer_down_ms: float
    up_reserve_mj: float
    line_reserve_mj: float
    lost: int
    loss: float
    buttons: int
    grip_m: float
    handle: Quaternion


def object_numbers(frame: SceneFrame) -> bytes:
    """Return the object's numbers as JSON."""
    w, x, y, z = frame.orientation
    position, velocity = Vector3(*frame.position_m), Vector3(*frame.velocity_mps)
    touched = bool(frame.flags & CONTACT)
    return _encode(ObjectNumbers(frame.time_s, frame.number, position, velocity, Quaternion(x, y, z, w), touched))


def person_numbers(person: PersonFrame, time_s: float) -> bytes:
    """Return a person's numbers as JSON."""
    w, x, y, z = person.orientation
    numbers = PersonNumbers(
        time_s, person.state, bool(person.flags & PUSHES), not person.flags & NOT_PASSIVE, Vector3(*person.hand_m),
        Vector3(*person.proxy_m), Vector3(*person.seen_m), Vector3(*person.force_n), person.rtt_ms, person.up_ms,
        person.down_ms, person.buffer_up_ms, person.buffer_down_ms, person.up_reserve_mj, person.line_reserve_mj,
        person.lost, person.loss, person.buttons, person.grip_m, Quaternion(x, y, z, w),
    )  # fmt: skip
    return _encode(numbers)
