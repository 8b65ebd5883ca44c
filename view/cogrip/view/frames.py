"""Binary messages of the view's socket (`docs/view.md`): frames, the own hand, pointer messages, chunks of a recording."""

import gzip
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite, nan
from typing import Literal

FRAME, POINTER, OWN_HAND, CHUNK = 1, 2, 3, 4
PUSHES, NOT_PASSIVE, HAND_KNOWN = 1, 2, 4  # flags of a person
CONTACT = 1  # flag of a frame
HOLDS = 1  # flag of a pointer message
MOST_POINTER_M = 10.0  # a pointer farther away is no pointer

State = Literal["free", "joining", "live", "degraded", "fault", "silent"]
STATES: tuple[State, ...] = ("free", "joining", "live", "degraded", "fault", "silent")
Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)

_HEAD = struct.Struct("<BBBBI d 3d 3d 4d")
_PERSON = struct.Struct("<BBBBI 3d 3d 3d 3d 8f")
_POINTER = struct.Struct("<BBHI 3d")
_OWN_HAND = struct.Struct("<BBHI 3d 3d d")
_CHUNK = struct.Struct("<B3xII")
POINTER_BYTES = _POINTER.size
HEAD_BYTES, PERSON_BYTES = _HEAD.size, _PERSON.size


class FrameError(ValueError):
    """A binary message that is not one of this page's; the text says why."""


@dataclass(frozen=True, slots=True)
class PersonFrame:
    """One person at one moment: lengths [m], force on the object [N], delays [ms], energy balances now [mJ]; NaN: not known."""

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
    up_balance_mj: float = nan
    line_balance_mj: float = nan
    loss: float = nan


@dataclass(frozen=True, slots=True)
class Frame:
    """The object and the people at one moment; `number` is that of the room's step."""

    axes: int
    number: int
    time_s: float
    position_m: Vector
    velocity_mps: Vector
    people: tuple[PersonFrame, ...]
    orientation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    flags: int = 0


@dataclass(frozen=True, slots=True)
class Pointer:
    """Where a page's pointer wants its hand to be [m]; holds: False lets go."""

    number: int
    holds: bool
    target_m: Vector


@dataclass(frozen=True, slots=True)
class OwnHand:
    """The virtual device of a page: position [m], force on the hand [N], and the newest pointer message that it took."""

    state: State = "joining"
    taken: int = 0
    position_m: Vector = ZERO
    force_n: Vector = ZERO
    limit_n: float = field(default=nan)


def vector(values: Sequence[float]) -> Vector:
    """Return up to three numbers as three, 0 for an axis that is not there."""
    x, y, z = (*values[:3], 0.0, 0.0, 0.0)[:3]
    return x, y, z


def encode(frame: Frame) -> bytes:
    """Return a frame as bytes."""
    head = _HEAD.pack(
        FRAME, frame.axes, len(frame.people), frame.flags, frame.number % 2**32, frame.time_s,
        *frame.position_m, *frame.velocity_mps, *frame.orientation,
    )  # fmt: skip
    return head + b"".join([_encode_person(person) for person in frame.people])


def _encode_person(person: PersonFrame) -> bytes:
    return _PERSON.pack(
        person.seat, STATES.index(person.state), person.flags, 0, person.lost % 2**32,
        *person.hand_m, *person.proxy_m, *person.force_n, *person.seen_m,
        person.rtt_ms, person.up_ms, person.down_ms, person.buffer_up_ms, person.buffer_down_ms,
        person.up_balance_mj, person.line_balance_mj, person.loss,
    )  # fmt: skip


def decode(data: bytes) -> Frame:
    """Return the frame in `data`. Raises FrameError."""
    try:
        kind, axes, count, flags, number, time_s, *rest = _HEAD.unpack_from(data)
    except struct.error:
        raise FrameError(f"{len(data)} bytes, fewer than the {HEAD_BYTES} of a frame") from None
    if kind != FRAME or len(data) != HEAD_BYTES + count * PERSON_BYTES:
        raise FrameError(f"kind {kind}, {len(data)} bytes: not a frame of {count} people")
    people = tuple([_decode_person(data, HEAD_BYTES + each * PERSON_BYTES) for each in range(count)])
    return Frame(axes, number, time_s, vector(rest[:3]), vector(rest[3:6]), people, tuple(rest[6:10]), flags)


def _decode_person(data: bytes, offset: int) -> PersonFrame:
    seat, state, flags, _, lost, *rest = _PERSON.unpack_from(data, offset)
    if state >= len(STATES):
        raise FrameError(f"state {state} is not one of the {len(STATES)} there are")
    hand_m, proxy_m, force_n, seen_m = [vector(rest[each : each + 3]) for each in (0, 3, 6, 9)]
    return PersonFrame(seat, STATES[state], flags, lost, hand_m, proxy_m, force_n, seen_m, *rest[12:])


def encode_pointer(pointer: Pointer) -> bytes:
    """Return a pointer message as bytes."""
    return _POINTER.pack(POINTER, HOLDS if pointer.holds else 0, 0, pointer.number, *pointer.target_m)


def decode_pointer(data: bytes) -> Pointer:
    """Return the pointer message in `data`. Raises FrameError, also for a target that is not finite or implausibly far."""
    if len(data) != POINTER_BYTES or data[0] != POINTER:
        raise FrameError(f"{len(data)} bytes that are no pointer message of {POINTER_BYTES}")
    _, flags, reserved, number, *target = _POINTER.unpack(data)
    if flags & ~HOLDS or reserved:
        raise FrameError("a reserved bit is set")
    if not all(isfinite(each) and abs(each) <= MOST_POINTER_M for each in target):
        raise FrameError(f"the target is not within {MOST_POINTER_M:g} m")
    return Pointer(number, bool(flags & HOLDS), vector(target))


def encode_own_hand(hand: OwnHand) -> bytes:
    """Return the own hand as bytes."""
    return _OWN_HAND.pack(
        OWN_HAND, STATES.index(hand.state), 0, hand.taken, *hand.position_m, *hand.force_n, hand.limit_n
    )


def decode_own_hand(data: bytes) -> OwnHand:
    """Return the own hand in `data`. Raises FrameError."""
    if len(data) != _OWN_HAND.size or data[0] != OWN_HAND or data[1] >= len(STATES):
        raise FrameError(f"{len(data)} bytes that are no own hand of {_OWN_HAND.size}")
    _, state, _, taken, *rest = _OWN_HAND.unpack(data)
    return OwnHand(STATES[state], taken, vector(rest[:3]), vector(rest[3:6]), rest[6])


def encode_chunk(number: int, frames: Sequence[Frame]) -> bytes:
    """Return a chunk of a recording: frames of the same people, compressed; the same frames give the same bytes."""
    packed = gzip.compress(b"".join([encode(frame) for frame in frames]), compresslevel=9, mtime=0)
    return _CHUNK.pack(CHUNK, number, len(frames)) + packed


def decode_chunk(data: bytes, people: int) -> tuple[int, list[Frame]]:
    """Return number and frames of a chunk. Raises FrameError."""
    if len(data) < _CHUNK.size or data[0] != CHUNK:
        raise FrameError(f"{len(data)} bytes that are no chunk")
    _, number, count = _CHUNK.unpack_from(data)
    whole, size = gzip.decompress(data[_CHUNK.size :]), HEAD_BYTES + people * PERSON_BYTES
    if len(whole) != count * size:
        raise FrameError(f"{len(whole)} bytes, not {count} frames of {people} people")
    return number, [decode(whole[each * size : (each + 1) * size]) for each in range(count)]
