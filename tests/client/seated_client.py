"""A core with a seat, a server of the test in front of it, and the messages that open a session."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cogrip.client.core import ClientCore
from cogrip.client.coupling.wave_coupling import WaveCoupling
from cogrip.client.inputs import CloseLedger, Connect
from cogrip.client.safety.device_port import DevicePort
from cogrip.client.seat.seated import SeatedClient
from cogrip.devices.device import Capability, Sample
from cogrip.devices.plausibility import Plausibility
from cogrip.machine.tick_count import TickCount
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.settings.rates import due_ns
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.accounts import ClientAccount
from cogrip.protocol.wire.messages import PROTOCOL_VERSION, Hello, Stamp, Waves, Welcome
from cogrip.protocol.wire.session import make_hello
from cogrip.sim.bare_port import BarePort

DEVICE_HZ, M = 1024, 8
T_C, T_N = 1 / DEVICE_HZ, 1 / 128
ROOT = math.sqrt(2.0 * 20.0)


def capability(axes: int = 1, gives_velocity: bool = True, latency: int = 0, speed_mps: float = 1e6) -> Capability:
    return Capability(
        family="test", model="arm", axes=axes, workspace_m=((-1.0, 1.0),) * axes, peak_force_n=100.0,
        continuous_force_n=2.0, stiffness_npm=1e3, damping_nspm=100.0, slew_nps=1e6, speed_mps=speed_mps,
        resolution_m=0.0, apparent_mass_kg=0.1, rate_hz=8192, gives_velocity=gives_velocity,
        latency_ticks=latency,
    )  # fmt: skip


def hello(**changes: Any) -> Hello:
    """Return the hello of a client of one axis, with these changes."""
    given = {"software": "test", "nonce": 1, "room": "", "name": "", "digest": "", "device": "test", "axes": 1}
    return make_hello(**{**given, "rate_hz": 1024.0, **changes})


def seat(**tables: Any) -> SeatSettings:
    """Return anna's seat under these tables of settings."""
    return seat_settings(resolve({"users": [{"name": "anna"}], **tables}), 0)


def welcome(seat: SeatSettings, session: int = 7, nonce: int = 1, **more: Any) -> bytes:
    """Return the seat assignment that answers a hello."""
    return messages.encode(Welcome(PROTOCOL_VERSION, nonce, session, "", "test", seat, "a-ticket", **more))


def next_waves(
    line: LineSender, *wave: float, session: int = 7, sent_ns: int = 0, state: Sequence[float] | None = None
) -> Waves:
    """Push a wave, and return the server's message that carries it. state: place and speed of the object."""
    line.push(wave)
    first, waves, total, squares = line.contents()
    state = (0.0,) * (2 * len(wave)) if state is None else tuple(state)
    return Waves(session, first, waves, total, squares, 0.0, 0.0, 0, Stamp(sent_ns), state)


def at_ns(tick: int) -> int:
    """Return when a tick is due."""
    return due_ns(0, tick, DEVICE_HZ)


class Credulous(Plausibility):
    """Believes every sample."""

    def judge(self, tick: int, sample: Sample) -> str:
        return ""


class Client:
    """A seated core and its server: tests read back what it sends, and hand it waves frame by frame."""

    def __init__(
        self,
        axes: int = 1,
        gives_velocity: bool = True,
        latency: int = 0,
        frames: int = 0,
        speed_mps: float = 1e6,
        bare: bool = True,
        thing: str = "cube",
        **coupling: object,
    ) -> None:
        record = capability(axes, gives_velocity, latency, speed_mps)
        self.seat = seat(object={"axes": axes, "kind": thing}, coupling=coupling, playout={"frames": frames})
        # hands here are random numbers, which the device port would control, and `Plausibility` would refuse
        self.core = ClientCore(hello(axes=axes), record, BarePort if bare else DevicePort)
        self.core.handle(Connect(), 0)
        self.axes, self.session = axes, 7
        self.welcome(0)
        self.seated.hand.plausibility = Credulous(record, self.seat.rates.tick_s)
        self.core.outbox.clear()
        self.line = LineSender(axes, 8)

    def welcome(self, now_ns: int) -> None:
        """Receive the seat assignment, new or confirmed."""
        self.core.receive(welcome(self.seat, self.session), now_ns)

    def renew(self, now_ns: int) -> None:
        """Receive the seat assignment of another server: another session, and a line that begins with frame 0."""
        self.session += 1
        self.line = LineSender(self.axes, 8)
        self.welcome(now_ns)

    @property
    def seated(self) -> SeatedClient:
        assert self.core.seated
        return self.core.seated

    @property
    def waves(self) -> WaveCoupling:
        assert isinstance(self.core.coupling, WaveCoupling)
        return self.core.coupling

    def hear(self, now_ns: int, *wave: float, lost: bool = False) -> None:
        """Receive a datagram with the server's next wave."""
        message = next_waves(self.line, *wave or (0.0,) * self.axes, session=self.session, sent_ns=now_ns + 1)
        if not lost:
            self.core.receive(messages.encode(message), now_ns)

    def tick(self, number: int, *position_m: float, velocity: Sequence[float] = (), age: int = 0) -> tuple[float, ...]:
        speed = tuple(velocity) or (0.0,) * self.axes
        self.core.sense(number, Sample(position_m, speed, age), at_ns(number))
        return self.core.act(at_ns(number))

    def run(
        self,
        ticks: range,
        place_m: float | Callable[[int], float] = 0.0,
        wave: float | Callable[[int], object] | None = None,
        speed_mps: float = 0.0,
    ) -> list[float]:
        """Tick a hand of one axis. wave: comes with each frame, or what is done then. Returns the forces."""
        forces = []
        for number in ticks:
            border = number > 0 and number % M == 0
            if border and callable(wave):
                wave(number)
            elif border and wave is not None:
                self.hear(at_ns(number), wave)
            place = place_m(number) if callable(place_m) else place_m
            forces.append(self.tick(number, place, velocity=[speed_mps])[0])
        return forces

    def account(self) -> ClientAccount:
        """Return what it would say of its session, if that ended now."""
        return self.core.handle(CloseLedger(TickCount()), self.core.now_ns)

    def total(self) -> float:
        """Return sum u T_c of all ticks so far, as it went into frames; one axis, boxcar."""
        sender, unsent = self.waves.up.sender, sum(self.waves.up.decimator._sum)  # type: ignore[attr-defined]
        _, waves, before, _ = sender.contents()
        return (sum(before) + sum(waves)) * T_N + unsent * T_C

    def sent(self) -> list[messages.AnyMessage]:
        found = [messages.decode(datagram) for datagram in self.core.outbox]
        self.core.outbox.clear()
        return found

    def frames(self) -> list[tuple[float, ...]]:
        """Return all frames sent since the last call, each once, in order."""
        found: dict[int, tuple[float, ...]] = {}
        for message in self.sent():
            assert isinstance(message, Waves)
            for at in range(len(message.waves) // self.axes):
                found[message.first + at] = message.waves[at * self.axes : (at + 1) * self.axes]
        assert sorted(found) == list(range(min(found), max(found) + 1))
        return [found[number] for number in sorted(found)]


def walk(seed: int, steps: int, axes: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    random = np.random.default_rng(seed)
    return np.cumsum(random.uniform(-1e-4, 1e-4, (steps, axes)), axis=0)
