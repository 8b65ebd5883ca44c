"""Messages between a page's pointer and its virtual device: `pointer` and `own hand` of `docs/view.md`."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, nan
from typing import Literal

from cogrip.machine.rows import Vector

POINTER, OWN_HAND = 2, 3
HOLDS = 1  # flag of a pointer message: the pointer holds the device
BUTTONS = 16  # buttons that a pointer message tells of
MOST_POINTER_M = 10.0  # largest coordinate of a pointer

State = Literal["free", "joining", "live", "degraded", "fault", "silent"]
STATES: tuple[State, ...] = ("free", "joining", "live", "degraded", "fault", "silent")
ZERO: Vector = (0.0, 0.0, 0.0)

_POINTER = struct.Struct("<BBHI 3d")
_OWN_HAND = struct.Struct("<BBHI 3d 3d d")
POINTER_BYTES, OWN_HAND_BYTES = _POINTER.size, _OWN_HAND.size


class FrameError(ValueError):
    """A binary message that is none of the page's; the text says why."""


@dataclass(frozen=True, slots=True)
class Pointer:
    """Where a page's pointer wants its hand to be [m]; holds: False lets go; buttons: that are down, one bit each."""

    number: int
    holds: bool
    target_m: Vector
    buttons: int = 0


@dataclass(frozen=True, slots=True)
class OwnHand:
    """The virtual device of a page: position [m], force on the hand [N], and the newest pointer message that it took."""

    state: State = "joining"
    taken: int = 0
    position_m: Vector = ZERO
    force_n: Vector = ZERO
    limit_n: float = nan


def vector(values: Sequence[float]) -> Vector:
    """Return up to three numbers as three, 0 for an axis that is not there."""
    x, y, z = (*values[:3], 0.0, 0.0, 0.0)[:3]
    return x, y, z


def encode_pointer(pointer: Pointer) -> bytes:
    """Return a pointer message as bytes."""
    return _POINTER.pack(POINTER, HOLDS if pointer.holds else 0, pointer.buttons, pointer.number, *pointer.target_m)


def decode_pointer(data: bytes) -> Pointer:
    """Return the pointer message in `data`. Raises FrameError, also for a target that is not finite or implausibly far."""
    if len(data) != POINTER_BYTES or data[0] != POINTER:
        raise FrameError(f"{len(data)} bytes that are no pointer message of {POINTER_BYTES}")
    _, flags, buttons, number, *target = _POINTER.unpack(data)
    if flags & ~HOLDS:
        raise FrameError("a reserved bit is set")
    if not all(isfinite(each) and abs(each) <= MOST_POINTER_M for each in target):
        raise FrameError(f"the target is not within {MOST_POINTER_M:g} m")
    return Pointer(number, bool(flags & HOLDS), vector(target), buttons)


def encode_own_hand(hand: OwnHand) -> bytes:
    """Return the own hand as bytes."""
    return _OWN_HAND.pack(
        OWN_HAND, STATES.index(hand.state), 0, hand.taken, *hand.position_m, *hand.force_n, hand.limit_n
    )


def decode_own_hand(data: bytes) -> OwnHand:
    """Return the own hand in `data`. Raises FrameError."""
    if len(data) != OWN_HAND_BYTES or data[0] != OWN_HAND or data[1] >= len(STATES):
        raise FrameError(f"{len(data)} bytes that are no own hand of {OWN_HAND_BYTES}")
    _, state, _, taken, *rest = _OWN_HAND.unpack(data)
    return OwnHand(STATES[state], taken, vector(rest[:3]), vector(rest[3:6]), rest[6])
