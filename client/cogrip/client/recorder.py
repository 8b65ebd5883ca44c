"""A client core that is recorded: the same core, live, in virtual time, in replay.

Records stand in the order in which things happened. A tick is recorded when its force is known, so the datagrams that came
between its two halves stand before it. Tokens and tickets are not recorded.
"""

import json
from collections.abc import Iterable
from math import isfinite, nan
from typing import Any, overload

import msgspec

from cogrip.client.core import ClientCore
from cogrip.client.coupling import Row
from cogrip.client.device_port import DevicePort
from cogrip.client.inputs import ClientInput, CloseLedger
from cogrip.client.seated import MakePort, SeatedClient
from cogrip.devices.device import Capability, Sample
from cogrip.protocol.accounts import ClientAccount
from cogrip.protocol.hello_padding import with_short_device, with_whole_device
from cogrip.protocol.messages import Hello
from cogrip.protocol.recording.records import Datagram, Event, Ledger, Tick, TickHead
from cogrip.protocol.recording.secrets import without_secrets
from cogrip.protocol.recording.sink import CoreRecorder, ObservedQueue, encode, topics

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
        self._rows: tuple[Row, Row, Row] = (), (), ()  # of a tick's record behind its head, and their text
        self._numbers: tuple[object, ...] = ()
        self._rest_text = b""
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
        ClientCore.sense(self, tick, sample, now_ns)  # `super` costs as much as three calls

    def act(self, now_ns: int) -> tuple[float, ...]:
        self.now_ns = now_ns
        force, seat = ClientCore.act(self, now_ns), self.seated
        if self.keeps and seat is not None:
            self._sink.put(TICK, now_ns, self._tick_text(seat, force))
            state = seat.safety.state
            if state != self._state:
                self._state, reason = state, seat.safety.reason
                self.put(EVENT, Event(f"{state}: {reason}" if reason else state))
        if self.marked:
            for text in self.marked:
                self.put(EVENT, Event(f"marker: {text}"))
            self.marked.clear()
        return force

    def _tick_text(self, seat: SeatedClient, force_n: tuple[float, ...]) -> bytes:
        """Return the `Tick` as JSON text. What a frame leaves as it is keeps its text."""
        sample, coupling, ledger, port, delays = self._sample, seat.coupling, seat.ledger, seat.port, self.delays
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
        late_us, work_us, skipped = self.timing
        head = (seat.tick, late_us, work_us, position, velocity, force_n, ledger.work.value, ledger.port_j)
        text, rows = encode(TickHead(*head)), (coupling.sent, coupling.returning, coupling.object_state)
        numbers: tuple[Any, ...] = (
            coupling.down_margin_j, delays.rtt_ms, ledger.lost, seat.safety.state, skipped, coupling.playout_frames,
            given, unfit, age_ticks, delays.up_ms, delays.down_ms, coupling.down_reserve.now_j, buttons, orientation, grip_m,
        )  # fmt: skip
        sent, returning, state = self._rows
        same = rows[0] is sent and rows[1] is returning and rows[2] is state and given is None  # -0.0 equals 0.0
        if not same or numbers != self._numbers or grip_m == 0.0 or (orientation is not None and 0.0 in orientation):
            self._rows, self._numbers = rows, numbers
            tick = Tick(*head, rows[0], rows[1], rows[2][: len(force_n)], *numbers)
            self._rest_text = encode(tick)[len(text) - 1 : -len(b"null}")]
        return b"".join((text[:-1], self._rest_text, encode(port.earned_j + port.reserve_j), b"}"))


def _texts(values: Iterable[float]) -> tuple[str, ...]:
    return tuple(map(repr, values))


def sample_of(tick: Tick, gives_velocity: bool) -> Sample | None:
    """Return the sample that a tick was sensed with."""
    turned = tick.orientation
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


def start_text(hello: Hello, capability: Capability) -> str:
    """Return what a client core is made from, as JSON text, less its token."""
    asked = with_short_device(msgspec.structs.replace(hello, token="", ticket=""))
    table = {"hello": msgspec.to_builtins(asked), "capability": msgspec.to_builtins(capability)}
    return json.dumps(table, allow_nan=False)


def start_of(text: str) -> tuple[Hello, Capability]:
    """Read a `start_text`. Raises ValueError (msgspec's among them) or KeyError for any other."""
    table = json.loads(text)
    return with_whole_device(msgspec.convert(table["hello"], Hello)), Capability.recorded(table["capability"])
