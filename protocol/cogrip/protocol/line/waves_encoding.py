"""Encoder of waves: the message of one frame, as bytes. Compiled, `waves_encoding.pyx` takes its place."""

from collections.abc import Sequence

from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.wire.clock import Clock
from cogrip.protocol.wire.handle import Handle
from cogrip.protocol.wire.messages import Waves, encode


def encode_waves(
    session: int, sender: LineSender, made_j: float, port_j: float, acknowledged: int, clock: Clock, now_ns: int,
    state: Sequence[float], phase: int, impedance_nspm: float, since: int, edges: int, applied: int = 0,
    handle: Handle | None = None,
) -> bytes:  # fmt: skip
    """Return the `Waves` of a line's newest frames, encoded. The fields are those of `Waves`."""
    first, waves, total, squares = sender.contents()
    return encode(Waves(
        session, first, waves, total, squares, made_j, port_j, acknowledged, clock.stamp(now_ns), tuple(state), phase,
        applied, impedance_nspm, since, handle, edges,
    ))  # fmt: skip
