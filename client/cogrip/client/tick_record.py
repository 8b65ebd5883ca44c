"""The record of a client's tick, `Tick`, as JSON text or as MessagePack: the same to the byte as if it were encoded whole.

What every tick changes stands first, and is encoded each time. What a frame leaves as it is keeps its bytes; the last field, a
number of every tick again, is put behind them.
"""

from collections.abc import Callable, Iterable, Sequence
from math import isfinite, nan
from typing import TYPE_CHECKING, Any

from cogrip.client.seated import SeatedClient
from cogrip.client.tick_packing import BEGIN, pack_tick
from cogrip.devices.device import Sample
from cogrip.protocol.recording.records import Tick, TickHead
from cogrip.protocol.recording.sink import encode

if TYPE_CHECKING:
    from cogrip.client.core import Delays

Rows = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]


class TickRecord:
    """Records of one client, made by `encoder`: `sink.encode` or `sink.pack`."""

    __slots__ = ("_begin", "_encode", "_end", "_none_bytes", "_numbers", "_rest", "_rows")

    def __init__(self, encoder: Callable[[Any], bytes] = encode) -> None:
        self._encode = encoder
        text = encoder is encode
        self._begin = b"{" if text else BEGIN
        self._end = b"}" if text else b""
        self._none_bytes = len(encoder(None)) + len(self._end)
        self._rows: Rows = (), (), ()  # behind the head, as they were encoded last
        self._numbers: tuple[object, ...] = ()
        self._rest = b""  # their bytes

    def of(
        self, seat: SeatedClient, sample: Sample | None, force_n: tuple[float, ...], timing: tuple[int, int, int],
        delays: "Delays",
    ) -> bytes:  # fmt: skip
        """Return the record of the tick that has been sensed with this sample and has given this force. timing: see `Tick`."""
        coupling, ledger, port, encode_ = seat.coupling, seat.ledger, seat.port, self._encode
        velocity = tuple(seat.twist)
        position = given = unfit = orientation = grip_m = None
        age_ticks = buttons = 0
        if sample is not None:
            position, given, age_ticks = sample.position_m, sample.velocity_mps, sample.age_ticks
            buttons, orientation, grip_m = sample.buttons, sample.orientation, sample.grip_m
            hand = seat.hand  # what it has taken over is finite
            used = position is hand.position_m and (given is None or given is hand.velocity_mps)
            if not used and not isfinite(sum(position) + (sum(given) if given else 0.0)):
                unfit = (_texts(position), _texts(given) if given else None)
                position = None
            if unfit or given == velocity:
                given = None
        late_us, work_us, skipped = timing
        (port_j, lost, playout_frames), work_j = ledger.recorded(), ledger.work.value
        left_j = port.earned_j + port.reserve_j
        numbers: tuple[Any, ...] = (
            coupling.down_margin_j, delays.rtt_ms, lost, seat.safety.state, skipped, playout_frames,
            given, unfit, age_ticks, delays.up_ms, delays.down_ms, coupling.down_reserve.now_j, buttons, orientation, grip_m,
        )  # fmt: skip
        sent, returning, state = self._rows
        same = sent is coupling.sent and returning is coupling.returning and state is coupling.object_state
        # -0.0 equals 0.0
        if (
            not same
            or given is not None
            or numbers != self._numbers
            or grip_m == 0.0
            or (orientation is not None and 0.0 in orientation)
        ):
            self._rows, self._numbers = (coupling.sent, coupling.returning, coupling.object_state), numbers
            head = seat.tick, late_us, work_us, position, velocity, force_n, work_j, port_j
            tick = Tick(*head, coupling.sent, coupling.returning, coupling.object_state[: len(force_n)], *numbers)
            head_bytes = len(encode_(TickHead(*head))) - 1 - len(self._end)
            self._rest = encode_(tick)[len(self._begin) + head_bytes : -self._none_bytes]
        if not self._end:
            return pack_tick(
                seat.tick, late_us, work_us, position, velocity, force_n, work_j, port_j, self._rest, left_j
            )
        begun = encode_(TickHead(seat.tick, late_us, work_us, position, velocity, force_n, work_j, port_j))[1:-1]
        return b"".join((self._begin, begun, self._rest, encode_(left_j), self._end))


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
