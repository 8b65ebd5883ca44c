"""A client core that is recorded: the same core, live, in virtual time, in replay.

Records stand in the order in which things happened. A tick is recorded when its force is known, so the datagrams that came
between its two halves stand before it. Tokens and tickets are not recorded.
"""

import json
from collections.abc import Callable
from typing import Any

import msgspec

from cogrip.client.core import ClientCore
from cogrip.client.inputs import ClientInput
from cogrip.client.safety.device_port import DevicePort
from cogrip.client.seat.seated import MakePort
from cogrip.client.tick_record import TickRecord
from cogrip.devices.device import Capability
from cogrip.devices.sample import Sample
from cogrip.protocol.recording.records import Datagram, Event, Ledger
from cogrip.protocol.recording.secrets import without_secrets
from cogrip.protocol.recording.sink import CoreRecorder, ObservedQueue, Sink, encode, topics
from cogrip.protocol.wire.accounts import ClientAccount
from cogrip.protocol.wire.messages import Hello, with_short_device, with_whole_device

KINDS = ("tick", "datagram_in", "datagram_out", "input", "event", "account", "gap", "clock")
TICK, DATAGRAM_IN, DATAGRAM_OUT, INPUT, EVENT, ACCOUNT = range(6)


def client_topics(who: str) -> tuple[str, ...]:
    """Return the topics of one person's recording."""
    return topics(who, KINDS)


class RecordedClient(ClientCore):
    """A core and its recorder. `timing` is set by the driver: see `Tick`."""

    def __init__(self, hello: Hello, capability: Capability, make_port: MakePort = DevicePort) -> None:
        super().__init__(hello, capability, make_port)
        self._recorder = CoreRecorder()
        self.start = start_text(hello, capability)
        self.timing = (0, 0, 0)  # late [us], work [us], skipped
        self._sample: Sample | None = None
        self._state = ""
        self._ticks = TickRecord()
        self.session.outbox = ObservedQueue(lambda datagram: self._put_datagram(DATAGRAM_OUT, datagram))

    def record(self, sink: Sink, encode: Callable[[Any], bytes] = encode) -> None:
        """Write to `sink` what was held, and all that follows: see `CoreRecorder.record`."""
        self._ticks = TickRecord(encode)
        self._recorder.record(sink, encode)

    def _put_datagram(self, topic: int, datagram: bytes) -> None:
        if self._recorder.keeps:
            self._recorder.put(topic, self.now_ns, Datagram(without_secrets(datagram, _ticket_left_out)))

    def handle(self, given: ClientInput, now_ns: int) -> ClientAccount | None:
        self.now_ns = now_ns
        self._recorder.put_input(INPUT, now_ns, given)
        account = super().handle(given, now_ns)
        if account is not None:
            self._recorder.put(ACCOUNT, now_ns, Ledger(msgspec.json.encode(account).decode()))
        return account

    def receive(self, datagram: bytes, now_ns: int) -> None:
        self.now_ns = now_ns
        self._put_datagram(DATAGRAM_IN, datagram)
        ClientCore.receive(self, datagram, now_ns)  # `super` costs as much as three calls

    def sense(self, tick: int, sample: Sample | None, now_ns: int) -> None:
        self._sample = sample
        ClientCore.sense(self, tick, sample, now_ns)

    def act(self, now_ns: int) -> tuple[float, ...]:
        self.now_ns = now_ns
        force, seat, recorder = ClientCore.act(self, now_ns), self.seated, self._recorder
        if recorder.keeps and seat is not None:
            record = self._ticks.of(seat, self._sample, force, self.timing, self.delays)
            recorder.sink.put(TICK, now_ns, record)
            state = seat.safety.state
            if state != self._state:
                self._state, reason = state, seat.safety.reason
                recorder.put(EVENT, now_ns, Event(f"{state}: {reason}" if reason else state))
        if self.marked:
            for text in self.marked:
                recorder.put(EVENT, now_ns, Event(f"marker: {text}"))
            self.marked.clear()
        return force


def _ticket_left_out(ticket: str) -> str:
    return "-"


def start_text(hello: Hello, capability: Capability) -> str:
    """Return what a client core is made from, as JSON text, less its token."""
    asked = with_short_device(msgspec.structs.replace(hello, token="", ticket=""))
    table = {"hello": msgspec.to_builtins(asked), "capability": msgspec.to_builtins(capability)}
    return json.dumps(table, allow_nan=False)


def start_of(text: str) -> tuple[Hello, Capability]:
    """Read a `start_text`. Raises ValueError (msgspec's among them) or KeyError for any other."""
    table = json.loads(text)
    return with_whole_device(msgspec.convert(table["hello"], Hello)), Capability.recorded(table["capability"])
