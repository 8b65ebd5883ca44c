"""A client core that notes every call and everything that comes of it: the same core, live, in virtual time, in replay.

What is noted stands in the order in which it happened. A tick is noted when its force is known, so the datagrams that
came between its two halves stand before it. Tokens and tickets are not noted: a replay plays what was noted.
"""

import json
from collections.abc import Iterable
from math import isfinite

import msgspec

from cogrip.client.core import ClientCore
from cogrip.devices.device import Capability, Sample
from cogrip.protocol.accounts import ClientAccount, TickCount
from cogrip.protocol.messages import Hello, with_short_device, with_whole_device
from cogrip.protocol.recording.records import Command, Datagram, Event, Ledger, Tick
from cogrip.protocol.recording.secrets import without_secrets
from cogrip.protocol.recording.sink import Held, Nowhere, ObservedQueue, Sink, encode, topics

KINDS = ("tick", "datagram_in", "datagram_out", "command", "event", "account", "gap", "clock")
TICK, DATAGRAM_IN, DATAGRAM_OUT, COMMAND, EVENT, ACCOUNT = range(6)


def client_topics(who: str) -> tuple[str, ...]:
    """Topics of one person's recording."""
    return topics(who, KINDS)


class RecordedClient(ClientCore):
    """Messages are held until `record` says where they go. `timing` is the driver's: see `Tick`."""

    def __init__(self, hello: Hello, capability: Capability) -> None:
        super().__init__(hello, capability)
        self.start = start_text(hello, capability)
        self.timing = (0, 0, 0)  # late [us], work [us], skipped
        self._held = Held()
        self._sink: Sink = self._held
        self._now_ns = 0
        self._sample: Sample | None = None
        self._state = ""
        self.session.outbox = ObservedQueue(self._sent)

    def record(self, sink: Sink) -> None:
        """Give what was noted so far to `sink`, and all that follows."""
        self._sink = sink
        self._held.pour(sink)

    def _sent(self, datagram: bytes) -> None:
        self._sink.put(DATAGRAM_OUT, self._now_ns, encode(Datagram(without_secrets(datagram, _blank))))

    def _command(self, verb: str, now_ns: int, reason: str = "", ticks: str = "") -> None:
        self._now_ns = now_ns
        self._sink.put(COMMAND, now_ns, encode(Command(verb, reason, ticks=ticks)))

    def call(self, now_ns: int) -> None:
        self._command("call", now_ns)
        super().call(now_ns)

    def poll(self, now_ns: int) -> None:
        self._command("poll", now_ns)
        super().poll(now_ns)

    def keep_seat(self, now_ns: int) -> None:
        self._command("keep_seat", now_ns)
        super().keep_seat(now_ns)

    def fail(self, reason: str) -> None:
        self._command("fail", self._now_ns, reason)
        super().fail(reason)

    def acted(self, force_n: tuple[float, ...]) -> None:
        self._command("acted", self._now_ns, msgspec.json.encode(force_n).decode())
        super().acted(force_n)

    def equip(self, capability: Capability) -> None:
        self._command("equip", self._now_ns, json.dumps(msgspec.to_builtins(capability), allow_nan=False))
        super().equip(capability)

    def stop(self) -> None:
        self._command("stop", self._now_ns)
        super().stop()

    def rearm(self) -> None:
        self._command("rearm", self._now_ns)
        super().rearm()

    def leave(self, reason: str, account: ClientAccount, now_ns: int) -> None:
        self._command("leave", now_ns, reason)
        super().leave(reason, account, now_ns)

    def account(self, ticks: TickCount) -> ClientAccount:
        account = super().account(ticks)
        self._command("account", self._now_ns, ticks=msgspec.json.encode(ticks).decode())
        self._sink.put(ACCOUNT, self._now_ns, encode(Ledger(msgspec.json.encode(account).decode())))
        return account

    def receive(self, datagram: bytes, now_ns: int) -> None:
        self._now_ns = now_ns
        self._sink.put(DATAGRAM_IN, now_ns, encode(Datagram(without_secrets(datagram, _blank))))
        super().receive(datagram, now_ns)

    def sense(self, tick: int, sample: Sample | None, now_ns: int) -> None:
        self._now_ns = now_ns
        self._sample = sample
        super().sense(tick, sample, now_ns)

    def act(self, now_ns: int) -> tuple[float, ...]:
        force = super().act(now_ns)
        if type(self._sink) is Nowhere:
            return force
        sample, velocity, coupling, safety = self._sample, tuple(self.velocity_mps), self.coupling, self.safety
        port = self.port
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
        rtt_ms = self.rtt_ms
        tick = Tick(
            self.tick, late_us, work_us, position, velocity, force, self.work_j, self.port_j,
            tuple(coupling.sent), coupling.returning, coupling.object_state[: len(force)], coupling.down_margin_j,
            rtt_ms if rtt_ms == rtt_ms else None, self.lost, safety.state, skipped,
            coupling.playout_frames, given, unfit,
            sample.age_ticks if sample is not None else 0,
            self.up_ms, self.down_ms,
            reserve_j=coupling.down_reserve.now_j, device_reserve_j=port.earned_j + port.reserve_j,
        )  # fmt: skip
        self._sink.put(TICK, now_ns, encode(tick))
        if safety.state != self._state:
            self._state = safety.state
            self._sink.put(
                EVENT, now_ns, encode(Event(f"{safety.state}: {safety.reason}" if safety.reason else safety.state))
            )
        return force


def _blank(ticket: str) -> str:
    """In place of a ticket; that there was one stays known."""
    return "-"


def _texts(values: Iterable[float]) -> tuple[str, ...]:
    return tuple(map(repr, values))


def sample_of(tick: Tick, gives_velocity: bool) -> Sample | None:
    """The sample that a tick was sensed with."""
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
    return json.dumps(
        {"hello": msgspec.to_builtins(asked), "capability": msgspec.to_builtins(capability)}, allow_nan=False
    )


def start_of(text: str) -> tuple[Hello, Capability]:
    """The way back. Raises ValueError (msgspec's among them) or KeyError for anything else."""
    table = json.loads(text)
    return with_whole_device(msgspec.convert(table["hello"], Hello)), Capability.recorded(table["capability"])


def capability_of(text: str) -> Capability:
    """A record as `equip` notes it. Raises ValueError."""
    return Capability.recorded(json.loads(text))
