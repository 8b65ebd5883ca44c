"""A server that means harm: whatever it sends, the force on the hand has a slope, a peak and a loop of a decent rate."""

from itertools import product
from math import dist, hypot

import pytest
from msgspec import structs

from cogrip.client.core import ClientCore
from cogrip.client.force_limits import MOST_SLOPE_NPS
from cogrip.client.inputs import CloseLedger, Connect, Rearm
from cogrip.devices.registry import make
from cogrip.protocol import messages
from cogrip.protocol.accounts import TickCount
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.messages import PROTOCOL_VERSION, Leave, Power, Stamp, State, Waves, Welcome
from cogrip.protocol.rates import LEAST_DEVICE_HZ, Rates, due_ns
from cogrip.protocol.session import make_hello
from cogrip.protocol.settings import Settings, resolve, seat_settings
from cogrip.protocol.settings_digest import digest

from tests.extent import every, long

SESSION = 7


class Hostile:
    """Its own welcome and frames in front of a true client on a simulated Phantom."""

    def __init__(self, settings: Settings, hand: str = "hold") -> None:
        axes = settings.object.axes
        self.settings, self.axes = settings, axes
        self.device = make(f"sim:phantom?hand={hand}", axes=axes)
        self.core = ClientCore(
            make_hello(
                software="x", nonce=1, room="", name="", digest="", device="sim:phantom", axes=axes, rate_hz=8192.0
            ),
            self.device.capability,
        )
        self.line = LineSender(axes, 8)
        self.core.handle(Connect(), 0)

    def welcome(self, device_hz: int, network_hz: int) -> None:
        """Receive a seat assignment with rates that no valid settings have."""
        seat = structs.replace(seat_settings(self.settings, 0), rates=Rates(device_hz, network_hz))
        answer = Welcome(PROTOCOL_VERSION, 1, SESSION, digest(self.settings), "x", seat, "")
        self.core.receive(messages.encode(answer), 0)

    def frame(self, number: int, value: float, now_ns: int) -> bytes:
        axes, stamp = self.axes, Stamp(now_ns + 1)
        values = (value,) * axes
        kind = self.settings.coupling.kind
        if kind == "wave":
            self.line.push(values)
            first, waves, total, squares = self.line.contents()
            return messages.encode(
                Waves(SESSION, first, waves, total, squares, 0.0, 0.0, 0, stamp, (0.0,) * (2 * axes))
            )
        if kind == "coupling":
            return messages.encode(State(SESSION, number, (value * 1e-2,) * axes, (0.0,) * axes, 0.0, 0, stamp))
        much = (1e4 * (number + 1),) * axes
        return messages.encode(
            Power(SESSION, number, (0.0,) * axes, (0.0,) * axes, values, much, (0.0,) * axes, 0.0, 0, stamp)
        )


@pytest.mark.parametrize(("device_hz", "network_hz"), [(250, 125), (1024, 128), long(8192, 128)])
@pytest.mark.parametrize(
    ("kind", "hand", "axes"),
    every(3, product(("wave", "coupling", "tdpa"), ("hold", "sine&amplitude_m=0.05&frequency_hz=2"), (1, 3))),
)
def test_no_step_is_larger_than_the_slope_whatever_a_server_sends(
    hand: str, kind: str, axes: int, device_hz: int, network_hz: int
) -> None:
    """Frames of 9000 with another sign each time, for two seconds; then calm ones, and the re-armed hand once more."""
    settings = resolve(
        {
            "coupling": {"kind": kind},
            "object": {"axes": axes},
            "rates": {"device_hz": device_hz, "network_hz": network_hz},
            "users": [{"name": "a"}],
        }
    )
    server = Hostile(settings, hand)
    server.welcome(device_hz, network_hz)
    core, device = server.core, server.device
    device.open(device_hz)
    per_frame, last, largest_n, largest_step_n = device_hz // network_hz, (0.0,) * axes, 0.0, 0.0
    for tick in range(3 * device_hz):
        now_ns = due_ns(0, tick, device_hz)
        core.sense(tick, device.read(tick), now_ns)
        if tick % per_frame == 0 and tick:
            number = tick // per_frame - 1
            core.receive(server.frame(number, 9000.0 if number % 2 else -9000.0, now_ns), now_ns)
        force = core.act(now_ns)
        device.write(force)
        largest_n = max(largest_n, hypot(*force))
        largest_step_n = max(largest_step_n, dist(force, last))
        last = force
        if core.safety.state == "fault":
            core.handle(Rearm(), core.now_ns)
    counts = core.safety.counts
    held = ("slew limited", "wave beyond what the device can bring about", "force clipped")
    assert any(counts.get(name) for name in held), "the frames did arrive, and would have thrown the hand"
    assert largest_n > 1.0
    assert largest_n <= 8.5 * (1.0 + 1e-12)
    assert largest_step_n <= MOST_SLOPE_NPS / device_hz * (1.0 + 1e-9)
    if device_hz == 1024:
        assert largest_step_n < 1.0, "17 N without a slope"


def test_a_welcome_below_the_least_rate_is_refused_and_says_so() -> None:
    server = Hostile(resolve({"users": [{"name": "a"}]}))
    server.core.outbox.clear()
    server.welcome(LEAST_DEVICE_HZ - 1, 83)
    assert not server.core.seated
    assert server.core.session.state == "closed"
    assert server.core.session.failed.startswith("the server asks for rates.device_hz = 249, at least 250 is")
    (leave,) = [messages.decode(datagram) for datagram in server.core.outbox]
    assert isinstance(leave, Leave)
    assert leave.session == SESSION


def test_a_welcome_at_the_least_rate_is_taken() -> None:
    server = Hostile(resolve({"users": [{"name": "a"}]}))
    server.welcome(LEAST_DEVICE_HZ, 125)
    assert server.core.seated


@pytest.mark.parametrize(
    ("wave", "hold", "hand"),
    every(4, product((5.0, 20.0), (1, 8, 10**6), ("hold", "sine&amplitude_m=0.05&frequency_hz=2"))),
)
def test_the_motors_give_no_more_than_came_in_at_any_tick(hand: str, hold: int, wave: float) -> None:
    """Waves that throw the hand, of another sign each `hold` frames. The ledger is added up once more, from what was done."""
    server = Hostile(resolve({"users": [{"name": "a"}]}), hand)
    server.welcome(1024, 128)
    core, device = server.core, server.device
    device.open(1024)
    seated, place, gone_j, peak_n = (
        core.seated,
        0.0,
        0.0,
        0.0,
    )  # gone_j: out of the motors and into the line, less what it gave
    assert seated is not None
    for tick in range(3 * 1024):
        now_ns, force, played = due_ns(0, tick, 1024), seated.force_n[0], seated.coupling.returning[0]
        core.sense(tick, device.read(tick), now_ns)
        at = seated.hand.position_m[0]
        if tick:
            gone_j -= force * (at - place) + 0.5 * played * played / 1024
        place = at
        if tick % 8 == 0 and tick:
            gone_j += 0.5 * seated.coupling.sent[0] ** 2 / 128
            core.receive(server.frame(tick // 8 - 1, wave if tick // 8 // hold % 2 else -wave, now_ns), now_ns)
        assert gone_j <= seated.port.reserve_j + 1e-9
        (force,) = core.act(now_ns)
        device.write((force,))
        peak_n = max(peak_n, abs(force))
    margin_j = core.handle(CloseLedger(TickCount()), core.now_ns).device.margin_j
    assert margin_j is not None
    assert margin_j >= 0.0, "so says the verdict"
    assert peak_n > 2.0
