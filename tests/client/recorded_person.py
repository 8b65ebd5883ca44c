"""A recorded client called as the live loop calls it, and a server's words for it to hear."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from cogrip.client.inputs import CloseLedger, Connect, DeviceFailed, KeepSeat, Leave, Poll, Rearm, Stop
from cogrip.client.recorder import KINDS, RecordedClient, client_topics
from cogrip.devices.device import Capability, Sample
from cogrip.machine.tick_count import Percentiles, TickCount
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.settings.digest import digest
from cogrip.protocol.settings.rates import due_ns
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Farewell, Refuse, Stamp, Welcome

from tests.client import seated_client
from tests.client.seated_client import DEVICE_HZ, M, hello
from tests.recorded_end import Put, RecordedEnd, mangled, next_frame, well_formed

START_NS = 1_000_000_000  # of tick 0
SESSION = 7
TOKEN, TICKET = "t0ken-t0ken-t0ken-t0ke", "tick3t-tick3t-tick3t-t"
Word = tuple[str, int, float]  # kind, number within it, size


def capability(axes: int, gives_velocity: bool) -> Capability:
    return replace(seated_client.capability(axes, gives_velocity), peak_force_n=10.0, damping_nspm=10.0)


class Person(RecordedEnd):
    role, who, file, rate_hz = "client", "anna", "client-anna.mcap", DEVICE_HZ
    core: RecordedClient

    def __init__(self, axes: int = 1, gives_velocity: bool = False, world: Mapping[str, Any] = {}) -> None:
        what = {"axes": axes, **world.get("object", {})}
        self.settings = resolve({**world, "object": what, "users": [{"name": "anna"}]})
        asked = hello(name="anna", axes=axes, token=TOKEN)
        super().__init__(RecordedClient(asked, capability(axes, gives_velocity)), client_topics("anna"))
        self.axes, self.gives_velocity = axes, gives_velocity
        self.tick, self.now_ns = -1, 0
        self.received = False
        self.session = SESSION
        self.line = LineSender(axes, 4)
        self.said: list[bytes] = [b""]

    def ticks_in(self, noted: Sequence[Put]) -> int:
        return sum(KINDS[topic] == "tick" for topic, *_ in noted)

    def welcome(self) -> bytes:
        seat = seat_settings(self.settings, 0)
        return messages.encode(Welcome(3, 1, self.session, digest(self.settings), "test", seat, TICKET))

    def take_seat(self) -> None:
        self.core.handle(Connect(), self.now_ns)
        self.core.receive(self.welcome(), self.now_ns)
        self.now_ns += 300_000_000
        self.core.handle(KeepSeat(), self.now_ns)

    def frame(self, value: float) -> bytes:
        """The next frame of the line down."""
        stamp = Stamp(self.now_ns + 1, max(0, self.now_ns - 5_000_000), 1_000_000)
        return next_frame(self.line, self.session, (value,) * self.axes, stamp, self.settings.coupling.kind, up=False)

    def word(self, kind: str, number: int, value: float) -> bytes:
        """Return a datagram as it may arrive. number: which one of that kind."""
        known = {
            **mangled(self.said, number),
            **well_formed(self.session, number, (value,) * self.axes, value),
            "welcome": self.welcome(),
            "farewell": messages.encode(Farewell(self.session, "enough")),
            "refuse": messages.encode(Refuse(1, 1, "full", "the room is full")),
        }
        if kind == "renewed":  # the server was started anew
            self.session += 1
            self.line = LineSender(self.axes, 4)
            known[kind] = self.welcome()
        datagram = self.frame(value) if kind == "next" else known[kind]
        self.said.append(datagram)
        return datagram

    def run_tick(self, gap: int, sample: Sample | None, words: Sequence[Word] = ()) -> None:
        core = self.core
        if self.received:  # since the last tick; a live loop calls the core before it ticks again
            core.handle(KeepSeat(), self.now_ns)
        self.received = False
        self.tick += gap
        now_ns = self.now_ns = due_ns(START_NS, self.tick, DEVICE_HZ) + gap * 1000  # late, as live ticks are
        core.sense(self.tick, sample, now_ns)
        for word in words:
            core.receive(self.word(*word), now_ns)
        core.timing = (gap, self.tick % 50, self.tick // 100)
        core.act(now_ns)
        core.outbox.clear()

    def sample(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> Sample:
        velocity = tuple(velocity_mps[: self.axes]) if self.gives_velocity else None
        return Sample(tuple(position_m[: self.axes]), velocity)

    def swing_m(self, gap: int) -> float:
        """Return where a hand that swings is after `gap` ticks."""
        return 0.02 * math.sin(0.02 * (self.tick + gap))

    def run(self, ticks: int, answered: bool = True) -> None:
        """Tick with a hand that swings, and a server that answers or has fallen silent."""
        for _ in range(ticks):
            phase = 0.02 * (self.tick + 1)
            place, speed = self.swing_m(1), 0.02 * 0.02 * DEVICE_HZ * math.cos(phase)
            words = [("next", 0, 0.2 * math.cos(phase))] if answered and (self.tick + 1) % M == 0 else []
            self.run_tick(1, self.sample((place,) * 3, (speed,) * 3), words)

    def end(self, reason: str) -> None:
        ticks = TickCount(self.tick + 1, self.tick + 1, Percentiles(1.0, 2.0, 3.0, 4.0))
        self.core.handle(CloseLedger(ticks), self.now_ns)
        self.core.handle(Leave(reason), self.now_ns)

    def poll(self, later_ns: int, words: Sequence[Word] = ()) -> None:
        self.now_ns += later_ns
        self.core.handle(Poll(), self.now_ns)
        for word in words:
            self.core.receive(self.word(*word), self.now_ns)
            self.received = True


def scripted() -> Person:
    """Return a session with every kind of message, input and state."""
    person = Person(2, gives_velocity=False)
    person.poll(0, [("garbage", 3, 0.0)])
    person.take_seat()
    person.run(60)
    person.run_tick(1, Sample((math.nan, 0.0), None))
    person.run(5)
    person.core.handle(Rearm(), person.core.now_ns)
    person.run(30)
    person.run_tick(300, person.sample((person.swing_m(300),) * 2, ()))  # the watchdog
    person.core.handle(Rearm(), person.core.now_ns)
    person.run(40)
    person.core.handle(DeviceFailed("device: unplugged"), person.core.now_ns)
    person.run_tick(1, None)
    person.core.handle(Stop(), person.core.now_ns)
    person.run(10)
    person.end("the session is over")
    person.poll(100_000_000)
    person.poll(1_000_000, [("farewell", 0, 0.0)])
    return person


SCRIPT = scripted()


def outages() -> Person:
    """Return a session that resumes its line, and then begins a new one."""
    person = Person(1)
    person.poll(0)
    person.take_seat()
    person.run(40)
    for silent, gap, words in ((550, 1, [("welcome", 0, 0.0)]), (530, 3, [("renewed", 0, 0.0), ("next", 0, 0.1)])):
        person.run(silent, answered=False)
        person.run_tick(gap, person.sample((person.swing_m(gap),) * 3, ()), words)
        person.run(60)
    person.core.handle(Stop(), person.core.now_ns)
    person.run(5)
    person.end("the session is over")
    person.poll(1_000_000, [("farewell", 0, 0.0)])
    return person
