"""The record of a client's tick, `Tick`, as JSON text or as MessagePack: the same to the byte as if it were encoded whole.

What every tick changes stands first, and is encoded each time. What a frame leaves as it is keeps its bytes; the last field, a
number of every tick again, is put behind them.
"""

from collections.abc import Callable, Iterable, Sequence
from math import inf, isfinite, nan
from typing import TYPE_CHECKING, Any

from cogrip.client.seat.seated import SeatedClient
from cogrip.client.tick_packing import BEGIN, pack_tick
from cogrip.devices.sample import Sample
from cogrip.machine.addition import add_floats
from cogrip.protocol.line.energy_reserve import known
from cogrip.protocol.recording.records import Tick, TickHead
from cogrip.protocol.recording.sink import encode

if TYPE_CHECKING:
    from cogrip.client.core import Delays


Head = tuple[int, int, int, Any, Any, Any, float, float]


class TickRecord:
    """Records of one client, made by `encoder`: `sink.encode` or `sink.pack`."""

    __slots__ = (
        "_age_ticks",
        "_begin",
        "_buttons",
        "_encode",
        "_end",
        "_held",
        "_lost",
        "_none_bytes",
        "_plain",
        "_playout_frames",
        "_reserve_j",
        "_rest",
        "_skipped",
    )  # fmt: skip

    def __init__(self, encoder: Callable[[Any], bytes] = encode) -> None:
        self._encode = encoder
        text = encoder is encode
        self._begin = b"{" if text else BEGIN
        self._end = b"}" if text else b""
        self._none_bytes = len(encoder(None)) + len(self._end)
        self._rest = (
            b""  # bytes of what stands behind the head, as they were encoded last; from here on what they are of
        )
        self._plain = False  # the sample had nothing but a position that was used, and whole numbers
        self._held: tuple[Any, ...] = (None,) * 8
        self._lost = self._skipped = self._age_ticks = self._buttons = -1
        self._reserve_j = -inf
        self._playout_frames: float | None = None

    def of(
        self, seat: SeatedClient, sample: Sample | None, force_n: tuple[float, ...], timing: tuple[int, int, int],
        delays: "Delays",
    ) -> bytes:  # fmt: skip
        """Return the record of the tick that has been sensed with this sample and has given this force. timing: see `Tick`."""
        coupling, ledger, port = seat.coupling, seat.ledger, seat.port
        velocity = tuple(seat.twist)
        position = given = unfit = orientation = grip_m = None
        age_ticks = buttons = 0
        if sample is not None:
            position, given, age_ticks = sample.position_m, sample.velocity_mps, sample.age_ticks
            buttons, orientation, grip_m = sample.buttons, sample.orientation, sample.grip_m
            hand = seat.hand  # what it has taken over is finite
            used = position is hand.position_m and (given is None or given is hand.velocity_mps)
            if not used and not isfinite(add_floats(position) + (add_floats(given) if given else 0.0)):
                unfit = (_texts(position), _texts(given) if given else None)
                position = None
            if unfit or given == velocity:
                given = None
        late_us, work_us, skipped = timing
        (port_j, lost, playout_frames), work_j = ledger.recorded(), ledger.work.value
        left_j, reserve_j = port.left_j(), coupling.down_reserve.balance_j
        held = (
            coupling.sent, coupling.returning, coupling.object_state, coupling.down_margin_j, delays.rtt_ms, delays.up_ms,
            delays.down_ms, seat.safety.state,
        )  # fmt: skip
        plain = given is None and unfit is None and orientation is None and grip_m is None
        same = plain and self._plain and lost == self._lost and skipped == self._skipped
        same = same and age_ticks == self._age_ticks and buttons == self._buttons
        same = same and reserve_j == self._reserve_j and playout_frames == self._playout_frames
        if not (same and _identical(held, self._held)):
            self._plain, self._held, self._lost, self._skipped = plain, held, lost, skipped
            self._age_ticks, self._buttons, self._reserve_j = age_ticks, buttons, reserve_j
            self._playout_frames = playout_frames
            head = seat.tick, late_us, work_us, position, velocity, force_n, work_j, port_j
            self._rest = self._encode_rest(head, given, unfit, orientation, grip_m)
        if not self._end:
            return pack_tick(
                seat.tick, late_us, work_us, position, velocity, force_n, work_j, port_j, self._rest, left_j
            )
        begun = self._encode(TickHead(seat.tick, late_us, work_us, position, velocity, force_n, work_j, port_j))[1:-1]
        return b"".join((self._begin, begun, self._rest, self._encode(left_j), self._end))

    def _encode_rest(self, head: Head, given: Any, unfit: Any, orientation: Any, grip_m: Any) -> bytes:
        """Return the bytes of a record that stand between its head and its last field."""
        sent, returning, state, margin_j, rtt_ms, up_ms, down_ms, safety = self._held
        reserve_j = known(self._reserve_j)
        tick = Tick(
            *head, sent, returning, state[: len(sent)], margin_j, rtt_ms, self._lost, safety, self._skipped,
            self._playout_frames, given, unfit, self._age_ticks, up_ms, down_ms, reserve_j, self._buttons, orientation, grip_m,
        )  # fmt: skip
        head_bytes = len(self._encode(TickHead(*head))) - 1 - len(self._end)
        return self._encode(tick)[len(self._begin) + head_bytes : -self._none_bytes]


def _identical(row: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    for at in range(len(row)):  # noqa: SIM110 - compiled, a plain loop
        if row[at] is not other[at]:
            return False
    return True


def _texts(values: Iterable[float]) -> tuple[str, ...]:
    return tuple(map(repr, values))


def sample_of(tick: Tick, gives_velocity: bool) -> Sample | None:
    """Return the sample that a tick was sensed with."""
    turned: Sequence[float | None] | None = tick.orientation
    if turned is not None:
        turned = tuple([nan if part is None else part for part in turned])
    handle: Any = tick.age_ticks, tick.buttons, turned, tick.grip_m
    if tick.unfit is not None:
        position, velocity = tick.unfit
        return Sample(tuple(map(float, position)), tuple(map(float, velocity)) if velocity else None, *handle)
    if tick.position_m is None:
        return None
    velocity_mps = (tick.given_mps or tick.velocity_mps) if gives_velocity else None
    return Sample(tick.position_m, velocity_mps, *handle)  # type: ignore[arg-type]  # finite, or it would stand in `unfit`
