"""A core with a seat, and a server of the test in front of it."""

import math
from collections.abc import Sequence

import numpy as np

from cogrip.client.core import ClientCore
from cogrip.client.device_port import BarePort, DevicePort
from cogrip.client.inputs import Connect
from cogrip.client.wave_coupling import WaveCoupling
from cogrip.devices.device import Capability, Sample
from cogrip.protocol import messages
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.messages import PROTOCOL_VERSION, Stamp, Waves, Welcome
from cogrip.protocol.rates import due_ns
from cogrip.protocol.session import make_hello
from cogrip.protocol.settings import resolve, seat_settings
from cogrip.protocol.settings_digest import digest

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


class Accepting:
    """Stand-in for `Plausibility` that accepts every sample: hands here are random numbers."""

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
        world = {"axes": axes, "kind": thing}
        settings = resolve(
            {"object": world, "coupling": coupling, "playout": {"frames": frames}, "users": [{"name": "anna"}]}
        )
        hello = make_hello(
            software="test", nonce=1, room="", name="", digest="", device="test", axes=axes, rate_hz=1024.0
        )  # fmt: skip
        record = capability(axes, gives_velocity, latency, speed_mps)
        # hands here are random numbers, which the device port would control
        self.core = ClientCore(hello, record, BarePort if bare else DevicePort)
        self.core.handle(Connect(), 0)
        self.settings, self.session = settings, 7
        self.welcome(0)
        assert self.core.seated
        self.core.seated.hand.plausibility = Accepting()  # type: ignore[assignment]
        self.core.outbox.clear()
        self.line = LineSender(axes, 8)
        self.axes = axes

    def welcome(self, now_ns: int) -> None:
        """Receive the seat assignment, new or confirmed."""
        seat = seat_settings(self.settings, 0)
        answer = Welcome(PROTOCOL_VERSION, 1, self.session, digest(self.settings), "test", seat, "a-ticket")
        self.core.receive(messages.encode(answer), now_ns)

    def renew(self, now_ns: int) -> None:
        """Receive the seat assignment of another server: another session, and a line that begins with frame 0."""
        self.session += 1
        self.line = LineSender(self.axes, 8)
        self.welcome(now_ns)

    @property
    def waves(self) -> WaveCoupling:
        assert isinstance(self.core.coupling, WaveCoupling)
        return self.core.coupling

    def hear(self, now_ns: int, *wave: float, lost: bool = False) -> None:
        """Receive a datagram with the server's next wave."""
        self.line.push(wave or (0.0,) * self.axes)
        if lost:
            return
        first, waves, total, squares = self.line.contents()
        state = (0.0,) * (2 * self.axes)
        message = Waves(self.session, first, waves, total, squares, 0.0, 0.0, 0, Stamp(now_ns + 1), state)
        self.core.receive(messages.encode(message), now_ns)

    def tick(self, number: int, *position_m: float, velocity: Sequence[float] = (), age: int = 0) -> tuple[float, ...]:
        now_ns = due_ns(0, number, DEVICE_HZ)
        speed = tuple(velocity) or (0.0,) * self.axes
        self.core.sense(number, Sample(position_m, speed, age), now_ns)
        return self.core.act(now_ns)

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
