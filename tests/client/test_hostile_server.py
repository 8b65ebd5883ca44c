"""A server that means harm: whatever it sends, the force on the hand has a slope, a peak and a loop of a decent rate."""

from itertools import product
from math import dist, hypot

import pytest
from msgspec import structs

from cogrip.client.core import ClientCore
from cogrip.client.inputs import CloseLedger, Connect, Rearm
from cogrip.devices.device import MOST_SLOPE_NPS
from cogrip.devices.registry import make
from cogrip.machine.tick_count import TickCount
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.settings.coupling_kinds import Kind
from cogrip.protocol.settings.rates import LEAST_DEVICE_HZ, Rates, due_ns
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Intent, Leave, Partner, Power, Stamp, State

from tests.client.seated_client import hello, next_waves, seat, welcome
from tests.extent import every, long
from tests.kinds import SCHEMES, object_of

SESSION = 7
SWING = "sine&amplitude_m=0.05&frequency_hz=2"


class Hostile:
    """Its own welcome and frames in front of a true client on a simulated Phantom."""

    def __init__(
        self,
        device_hz: int = 1024,
        network_hz: int = 128,
        hand: str = "hold",
        axes: int = 1,
        kind: Kind = "wave",
        **tables: object,
    ) -> None:
        """device_hz, network_hz: as no valid settings need have them."""
        self.axes, self.seat = (
            axes,
            seat(object={"axes": axes, "kind": object_of(kind)}, coupling={"kind": kind}, **tables),
        )
        self.device = make(f"sim:phantom?hand={hand}", axes=axes)
        self.core = ClientCore(hello(axes=axes, rate_hz=8192.0), self.device.capability)
        self.line = LineSender(axes, 8)
        self.core.handle(Connect(), 0)
        self.core.outbox.clear()
        self.core.receive(welcome(structs.replace(self.seat, rates=Rates(device_hz, network_hz)), SESSION), 0)

    def frame(self, number: int, value: float, now_ns: int) -> bytes:
        values, still, stamp = (value,) * self.axes, (0.0,) * self.axes, Stamp(now_ns + 1)
        message: messages.AnyMessage
        match self.seat.coupling.traits.frame:
            case "Waves":
                message = next_waves(self.line, *values, session=SESSION, sent_ns=now_ns + 1)
            case "State":
                message = State(SESSION, number, (value * 1e-2,) * self.axes, still, 0.0, 0, stamp)
            case "Partner":
                far = (value * 1e-2,) * self.axes
                message = Partner(SESSION, number, far, still, (Intent(1, 0, far, still, 1e4, 0.0),), 0, stamp)
            case "Power":
                much = (1e4 * (number + 1),) * self.axes
                message = Power(SESSION, number, still, still, values, much, still, 0.0, 0, stamp)
        return messages.encode(message)


@pytest.mark.parametrize(("device_hz", "network_hz"), [(250, 125), (1024, 128), long(8192, 128)])
@pytest.mark.parametrize(("kind", "hand", "axes"), every(3, product(SCHEMES, ("hold", SWING), (1, 3))))
def test_no_step_is_larger_than_the_slope_whatever_a_server_sends(
    hand: str, kind: Kind, axes: int, device_hz: int, network_hz: int
) -> None:
    """Frames of 9000 with another sign each time, for two seconds; then calm ones, and the re-armed hand once more."""
    rates = {"device_hz": device_hz, "network_hz": network_hz}
    server = Hostile(device_hz, network_hz, hand, axes, kind, rates=rates)
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
    held = {"slew limited", "wave beyond what the device can bring about", "force clipped"}
    assert held & {*core.safety.counts}, "the frames did arrive, and would have thrown the hand"
    assert 1.0 < largest_n <= 8.5 * (1.0 + 1e-12)
    assert largest_step_n <= MOST_SLOPE_NPS / device_hz * (1.0 + 1e-9)
    assert device_hz != 1024 or largest_step_n < 1.0, "17 N without a slope"


def test_a_welcome_below_the_least_rate_is_refused_and_says_so() -> None:
    assert Hostile(LEAST_DEVICE_HZ, 125).core.seated
    core = Hostile(LEAST_DEVICE_HZ - 1, 83).core
    assert not core.seated
    assert core.session.state == "closed"
    assert core.session.failed.startswith("the server asks for rates.device_hz = 249, at least 250 is")
    (leave,) = [messages.decode(datagram) for datagram in core.outbox]
    assert isinstance(leave, Leave)
    assert leave.session == SESSION


@pytest.mark.parametrize(("wave", "hold", "hand"), every(4, product((5.0, 20.0), (1, 8, 10**6), ("hold", SWING))))
def test_the_motors_give_no_more_than_came_in_at_any_tick(hand: str, hold: int, wave: float) -> None:
    """Waves that throw the hand, of another sign each `hold` frames. The ledger is added up once more, from what was done."""
    server = Hostile(hand=hand)
    core, device, seated = server.core, server.device, server.core.seated
    device.open(1024)
    place = peak_n = gone_j = 0.0  # gone_j: out of the motors and into the line, less what it gave
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
