"""Binary messages of the view's socket (`docs/view.md`): frames and chunks of a recording. Those of a hand are its device's."""

import gzip
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from math import nan

from cogrip.devices.web.messages import STATES, ZERO, FrameError, State, vector
from cogrip.machine.rows import Vector
from cogrip.protocol.wire.messages import Pose

FRAME, CHUNK = 1, 4
PUSHES, NOT_PASSIVE, HAND_KNOWN = 1, 2, 4  # flags of a person
CONTACT = 1  # flag of a frame: the object is in contact

_HEAD = struct.Struct("<BBBBI d 3d 3d 4d")
_PERSON = struct.Struct("<BBBBI 3d 3d 3d 3d 8f If4f")
_BODY = struct.Struct("<3d 4d")
_CHUNK = struct.Struct("<B3xII")
HEAD_BYTES, PERSON_BYTES, BODY_BYTES = _HEAD.size, _PERSON.size, _BODY.size


UNKNOWN_TURN = (nan, nan, nan, nan)


@dataclass(frozen=True, slots=True)
class PersonFrame:
    """One person at one moment: lengths [m], force on the object [N], delays [ms], energy reserves now [mJ]; NaN: not known."""

    seat: int
    state: State = "free"
    flags: int = 0
    lost: int = 0
    hand_m: Vector = ZERO
    proxy_m: Vector = ZERO
    force_n: Vector = ZERO
    seen_m: Vector = ZERO
    rtt_ms: float = nan
    up_ms: float = nan
    down_ms: float = nan
    buffer_up_ms: float = nan
    buffer_down_ms: float = nan
    up_reserve_mj: float = nan
    line_reserve_mj: float = nan
    loss: float = nan
    buttons: int = 0  # down: bit k, button k + 1
    grip_m: float = nan
    orientation: tuple[float, ...] = UNKNOWN_TURN  # of the handle: w, x, y, z


@dataclass(frozen=True, slots=True)
class SceneFrame:
    """The object and the people at one moment; `number` is that of the room's step."""

    axes: int
    number: int
    time_s: float
    position_m: Vector
    velocity_mps: Vector
    people: tuple[PersonFrame, ...]
    orientation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    flags: int = 0
    bodies: tuple[Pose, ...] = ()  # of a scene, in the order of their numbers; NaN: not known


def encode(frame: SceneFrame) -> bytes:
    """Return a frame as bytes."""
    head = _HEAD.pack(
        FRAME, frame.axes, len(frame.people), frame.flags, frame.number % 2**32, frame.time_s,
        *frame.position_m, *frame.velocity_mps, *frame.orientation,
    )  # fmt: skip
    people = [_encode_person(person) for person in frame.people]
    return b"".join([head, *people, *[_BODY.pack(*pose) for pose in frame.bodies]])


def _encode_person(person: PersonFrame) -> bytes:
    return _PERSON.pack(
        person.seat, STATES.index(person.state), person.flags, 0, person.lost % 2**32,
        *person.hand_m, *person.proxy_m, *person.force_n, *person.seen_m,
        person.rtt_ms, person.up_ms, person.down_ms, person.buffer_up_ms, person.buffer_down_ms,
        person.up_reserve_mj, person.line_reserve_mj, person.loss, person.buttons, person.grip_m, *person.orientation,
    )  # fmt: skip


def decode(data: bytes) -> SceneFrame:
    """Return the frame in `data`. Raises FrameError."""
    try:
        kind, axes, count, flags, number, time_s, *rest = _HEAD.unpack_from(data)
    except struct.error:
        raise FrameError(f"{len(data)} bytes, fewer than the {HEAD_BYTES} of a frame") from None
    end = HEAD_BYTES + count * PERSON_BYTES
    if kind != FRAME or len(data) < end or (len(data) - end) % BODY_BYTES:
        raise FrameError(f"kind {kind}, {len(data)} bytes: not a frame of {count} people")
    people = tuple([_decode_person(data, HEAD_BYTES + each * PERSON_BYTES) for each in range(count)])
    bodies = tuple(_BODY.iter_unpack(data[end:]))
    return SceneFrame(
        axes, number, time_s, vector(rest[:3]), vector(rest[3:6]), people, tuple(rest[6:10]), flags, bodies
    )


def _decode_person(data: bytes, offset: int) -> PersonFrame:
    seat, state, flags, _, lost, *rest = _PERSON.unpack_from(data, offset)
    if state >= len(STATES):
        raise FrameError(f"state {state} is not one of the {len(STATES)} there are")
    hand_m, proxy_m, force_n, seen_m = [vector(rest[each : each + 3]) for each in (0, 3, 6, 9)]
    rtt, up, down, buffer_up, buffer_down, up_mj, line_mj, loss, buttons, grip_m, *turned = rest[12:]
    return PersonFrame(
        seat, STATES[state], flags, lost, hand_m, proxy_m, force_n, seen_m, rtt, up, down, buffer_up, buffer_down, up_mj,
        line_mj, loss, buttons, grip_m, tuple(turned),
    )  # fmt: skip


def encode_chunk(number: int, frames: Sequence[SceneFrame]) -> bytes:
    """Return a chunk of a recording: frames of the same people and bodies, compressed; the same frames give the same bytes."""
    packed = gzip.compress(b"".join([encode(frame) for frame in frames]), compresslevel=9, mtime=0)
    return _CHUNK.pack(CHUNK, number, len(frames)) + packed


def decode_chunk(data: bytes, people: int, bodies: int = 0) -> tuple[int, list[SceneFrame]]:
    """Return number and frames of a chunk. Raises FrameError."""
    if len(data) < _CHUNK.size or data[0] != CHUNK:
        raise FrameError(f"{len(data)} bytes that are no chunk")
    _, number, count = _CHUNK.unpack_from(data)
    whole, size = gzip.decompress(data[_CHUNK.size :]), HEAD_BYTES + people * PERSON_BYTES + bodies * BODY_BYTES
    if len(whole) != count * size:
        raise FrameError(f"{len(whole)} bytes, not {count} frames of {people} people")
    return number, [decode(whole[each * size : (each + 1) * size]) for each in range(count)]
