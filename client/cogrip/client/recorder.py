"""A client core that is recorded: the same core, live, in virtual time, in replay.

Records stand in the order in which things happened. A tick is recorded when its force is known, so the datagrams that came
between its two halves stand before it. Tokens and tickets are not recorded.
"""

import json
from collections.abc import Iterable
from math import isfinite
from typing import overload

import msgspec

from cogrip.client.core import ClientCore
from cogrip.client.device_port import DevicePort
from cogrip.client.inputs import ClientInput, CloseLedger
from cogrip.client.seated import MakePort
from cogrip.devices.device import Capability, Sample
from cogrip.protocol.accounts import ClientAccount
from cogrip.protocol.messages import Hello, with_short_device, with_whole_device
from cogrip.protocol.recording.records import Datagram, Event, Ledger, Tick
from cogrip.protocol.recording.secrets import without_secrets
from cogrip.protocol.recording.sink import CoreRecorder, ObservedQueue, topics

KINDS = ("tick", "datagram_in", "datagram_out", "input", "event", "account", "gap", "clock")
TICK, DATAGRAM_IN, DATAGRAM_OUT, INPUT, EVENT, ACCOUNT = range(6)


def client_topics(who: str) -> tuple[str, ...]:
    """Return the topics of one person's recording."""
    return topics(who, KINDS)


class RecordedClient(CoreRecorder, ClientCore):
    """A core and its recorder. `timing` is set by the driver: see `Tick`."""

    def __init__(self, hello: Hello, capability: Capability, make_port: MakePort = DevicePort) -> None:
        CoreRecorder.__init__(self)
        ClientCore.__init__(self, hello, capability, make_port)
        self.start = start_text(hello, capability)
        self.timing = (0, 0, 0)  # late [us], work [us], skipped
        self._sample: Sample | None = None
        self._state = ""
        self.session.outbox = ObservedQueue(lambda datagram: self._put_datagram(DATAGRAM_OUT, datagram))

    def _put_datagram(self, topic: int, datagram: bytes) -> None:
        if self.keeps:
            self.put(topic, Datagram(without_secrets(datagram, lambda ticket: "-")))

    @overload
    def handle(self, given: CloseLedger, now_ns: int) -> ClientAccount: ...
    @overload
    def handle(self, given: ClientInput, now_ns: int) -> ClientAccount | None: ...
    def handle(self, given: ClientInput, now_ns: int) -> ClientAccount | None:
        self.now_ns = now_ns
        self.put_input(INPUT, given)
        account = super().handle(given, now_ns)
        if account is not None:
            self.put(ACCOUNT, Ledger(msgspec.json.encode(account).decode()))
        return account

    def receive(self, datagram: bytes, now_ns: int) -> None:
        self.now_ns = now_ns
        self._put_datagram(DATAGRAM_IN, datagram)
        super().receive(datagram, now_ns)

    def sense(self, tick: int, sample: Sample | None, now_ns: int) -> None:
        self._sample = sample
        super().sense(tick, sample, now_ns)

    def act(self, now_ns: int) -> tuple[float, ...]:
        self.now_ns = now_ns
        force = super().act(now_ns)
        if self.keeps:
            self.put(TICK, self._tick_record(force))
            safety = self.safety
            if safety.state != self._state:
                self._state = safety.state
                self.put(EVENT, Event(f"{safety.state}: {safety.reason}" if safety.reason else safety.state))
        return force

    def _tick_record(self, force_n: tuple[float, ...]) -> Tick:
        seat, sample = self._seat, self._sample
        coupling, ledger, port, delays = seat.coupling, seat.ledger, seat.port, self.delays
        velocity = tuple(seat.twist)
        position = given = unfit = None
        if sample is not None:
            position = sample.position_m
            given = sample.velocity_mps
            if not isfinite(sum(position) + (sum(given) if given else 0.0)):
                unfit = (_texts(position), _texts(given) if given else None)
                position = None
            if unfit or given == velocity:
                given = None
        late_us, work_us, skipped = self.timing
        return Tick(
            seat.tick, late_us, work_us, position, velocity, force_n, ledger.work.value, ledger.port_j,
            coupling.sent, coupling.returning, coupling.object_state[: len(force_n)], coupling.down_margin_j,
            delays.rtt_ms, ledger.lost, seat.safety.state, skipped,
            coupling.playout_frames, given, unfit,
            sample.age_ticks if sample is not None else 0,
            delays.up_ms, delays.down_ms,
            reserve_j=coupling.down_reserve.now_j, device_reserve_j=port.earned_j + port.reserve_j,
        )  # fmt: skip


def _texts(values: Iterable[float]) -> tuple[str, ...]:
    return tuple(map(repr, values))


def sample_of(tick: Tick, gives_velocity: bool) -> Sample | None:
    """Return the sample that a tick was sensed with."""
    if tick.unfit is not None:
        position, velocity = tick.unfit
        return Sample(tuple(map(float, position)), tuple(map(float, velocity)) if velocity else None, tick.age_ticks)
    if tick.position_m is None:
        return None
    velocity_mps = (tick.given_mps or tick.velocity_mps) if gives_velocity else None
    return Sample(tick.position_m, velocity_mps, tick.age_ticks)  # type: ignore[arg-type]  # finite, or it would stand in `unfit`


def start_text(hello: Hello, capability: Capability) -> str:
    """Return what a client core is made from, as JSON text, less its token."""
    asked = with_short_device(msgspec.structs.replace(hello, token="", ticket=""))
    table = {"hello": msgspec.to_builtins(asked), "capability": msgspec.to_builtins(capability)}
    return json.dumps(table, allow_nan=False)


def start_of(text: str) -> tuple[Hello, Capability]:
    """Read a `start_text`. Raises ValueError (msgspec's among them) or KeyError for any other."""
    table = json.loads(text)
    return with_whole_device(msgspec.convert(table["hello"], Hello)), Capability.recorded(table["capability"])
