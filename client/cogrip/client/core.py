"""One person's client without I/O: samples and datagrams in, forces and datagrams out.

Ticks come in two halves, `sense` and `act`. Live they follow each other at once; in virtual time the laboratory puts the
server's step between them, which is the order of theory section 6. All other inputs are values (`cogrip.client.inputs`), which
`handle` takes. This module has the session and its timing, `cogrip.client.seat.seated` all that needs a seat.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from cogrip.client import inputs
from cogrip.client.coupling.interface import Coupling
from cogrip.client.inputs import ClientInput
from cogrip.client.markers import OwnMarkers
from cogrip.client.safety.device_port import DevicePort
from cogrip.client.safety.limiter import Safety
from cogrip.client.seat.seat_account import account_of
from cogrip.client.seat.seated import MakePort, SeatedClient
from cogrip.client.seat.work_account import WorkAccount
from cogrip.devices.device import Capability
from cogrip.devices.sample import Sample
from cogrip.machine.histogram import DurationHistogram
from cogrip.machine.tick_count import Percentiles, TickCount
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.accounts import ClientAccount, DelayAccount
from cogrip.protocol.wire.messages import (
    Bodies,
    Effects,
    Geom,
    Hello,
    Mark,
    Note,
    Person,
    SetHand,
    Stamp,
    Waves,
    encode,
)
from cogrip.protocol.wire.session import ClientSession

TOLD = Person, Bodies, Geom, Mark, Note, SetHand, Effects


class Delays:
    """Delays of the link: round trip, and one way as far as the clocks' offset is known. `..._ms` are the newest."""

    def __init__(self) -> None:
        self.rtt, self.up, self.down = DurationHistogram(), DurationHistogram(), DurationHistogram()
        self.rtt_ms: float | None = None
        self.up_ms: float | None = None
        self.down_ms: float | None = None

    def measure(self, stamp: Stamp, session: ClientSession, now_ns: int) -> None:
        """Read the stamp of a message that came now."""
        clock = session.clock
        rtt_ns = clock.read(stamp, now_ns)
        if rtt_ns is not None:
            self.rtt_ms = _add(self.rtt, rtt_ns)
            self.down_ms = _add(self.down, clock.return_ns)
            if clock.fresh:
                self.up_ms = _add(self.up, clock.forward_ns)
        elif stamp.echo_ns:
            session.drop("implausible stamp")

    def account(self, session: ClientSession) -> DelayAccount:
        """Return the account of both directions, and of the clocks' offset."""
        both = [
            None if value_ns is None else value_ns * 1e-6
            for value_ns in (session.clock.offset_ns, session.clock.uncertainty_ns)
        ]
        return DelayAccount(Percentiles.of(self.up, 1e6), Percentiles.of(self.down, 1e6), *both)


def _add(delays: DurationHistogram, delay_ns: int | None) -> float:
    """Add a delay to a histogram, and return it [ms]."""
    assert delay_ns is not None
    delays.add(delay_ns)
    return delay_ns * 1e-6


class ClientCore:
    """Session, timing and, once there is one, the seat of one person.

    seated   the seat, None before there is one
    account  all that this end knows, since `CloseLedger`
    now_ns   time of the newest tick or input
    """

    def __init__(self, hello: Hello, capability: Capability, make_port: MakePort = DevicePort) -> None:
        self.session = ClientSession(hello)
        self.delays = Delays()
        self.seated: SeatedClient | None = None
        self.account: ClientAccount | None = None
        self.now_ns = 0
        self.markers = OwnMarkers()
        self.marked: list[str] = []  # markers set or told since its owner emptied it
        self._capability = capability
        self._make_port = make_port

    def handle(self, given: ClientInput, now_ns: int) -> ClientAccount | None:
        """Do what an input asks for. Returns the account for `CloseLedger`, else None."""
        self.now_ns = now_ns
        return HANDLERS[type(given)](self, given)

    def receive(self, datagram: bytes, now_ns: int) -> None:
        """Handle a datagram. One that is unexpected is dropped and counted by name."""
        session, seated = self.session, self.seated
        message = session.receive(datagram, now_ns)
        welcome = session.welcome
        if seated is None:
            if welcome is not None and welcome.role == "player":
                self.seated = SeatedClient(welcome.settings, session, self._capability, self._make_port)
            return
        if welcome is not None and welcome.session != seated.session_id:
            seated.renew(welcome.session)
        if message is None or (type(message) is not Waves and isinstance(message, TOLD)):  # `isinstance` is slow here
            self._take(seated, message)
            return
        if seated.tick < 0:  # the device is still being opened: what comes now must not set the jitter buffer
            session.drop("before the first tick")
            return
        self.delays.measure(message.stamp, session, now_ns)
        seated.receive(message, now_ns)

    def _take(self, seated: SeatedClient, message: object) -> None:
        """Handle a message of `TOLD`, which is no frame of the coupling."""
        if isinstance(message, Geom) and not seated.coupling.receive_shape(message):
            self.session.drop("unexpected")
        if isinstance(message, Mark) and self.markers.receive(message, seated.settings.seat):
            self.marked.append(message.text)
        if isinstance(message, SetHand):
            seated.orders.receive(message)
        if isinstance(message, Effects):
            self.outbox.append(encode(seated.receive_effects(message)))

    def sense(self, tick: int, sample: Sample | None, now_ns: int) -> None:
        """Process the ticks since the last call with the sample read now, and the timers of the session."""
        self.now_ns = now_ns
        seated, session = self.seated, self.session
        if seated is None:
            raise _seatless()
        seated.sense(tick, sample, now_ns)
        session.poll(now_ns)
        if session.state != "seated":
            return
        changes = seated.orders.changes
        if self.markers.pending():
            session.outbox.extend(map(encode, self.markers.due(seated.session_id, now_ns)))
        if changes.pending():
            session.outbox.extend(map(encode, changes.due(seated.session_id, now_ns)))

    def act(self, now_ns: int) -> tuple[float, ...]:
        """Return the force [N], shape (axes,), to hold until the next tick: F of P eq. 9, which loads the hand."""
        if self.seated is None:
            raise _seatless()
        return self.seated.act(now_ns)

    def _fail(self, reason: str) -> None:
        if self.seated is not None:
            self.seated.safety.fail(reason)

    def _be_patient(self, give_up_ns: int) -> None:
        self.session.give_up_ns = give_up_ns

    def _mark(self, text: str) -> None:
        if self.markers.add(text):
            self.marked.append(text)

    def _stop(self) -> None:
        if self.seated is not None:
            self.seated.stop()

    def _close_ledger(self, ticks: TickCount) -> ClientAccount:
        rtt_ms = Percentiles.of(self.delays.rtt, 1e6)
        self.account = account_of(self._seat, ticks, rtt_ms, self.delays.account(self.session))
        return self.account

    def _leave(self, reason: str) -> None:
        """Raises ValueError before `CloseLedger`."""
        if self.account is None:
            raise ValueError("a client leaves before its ledger was closed")
        if self.session.state in ("seated", "resuming"):
            self.session.leave(reason, self.account, self.now_ns)
        elif self.session.farewell is not None:
            self.session.answer_farewell(self.account)

    # What its driver and the laboratory read

    @property
    def _seat(self) -> SeatedClient:
        if self.seated is None:
            raise _seatless()
        return self.seated

    @property
    def outbox(self) -> deque[bytes]:
        """Datagrams to send, oldest first."""
        return self.session.outbox

    @property
    def seat(self) -> SeatSettings | None:
        """Settings of the seat, None before there is one."""
        return self.seated.settings if self.seated else None

    @property
    def capability(self) -> Capability:
        """Record of the device, as it was made or as it said once open."""
        return self.seated.capability if self.seated else self._capability

    @property
    def safety(self) -> Safety:
        return self._seat.safety

    @property
    def coupling(self) -> Coupling:
        return self._seat.coupling

    @property
    def port(self) -> DevicePort:
        return self._seat.port

    @property
    def ledger(self) -> WorkAccount:
        return self._seat.ledger

    @property
    def tick(self) -> int:
        return self._seat.tick

    @property
    def position_m(self) -> tuple[float, ...]:
        return self._seat.pose

    @property
    def velocity_mps(self) -> Sequence[float]:
        return self._seat.twist

    @property
    def force_n(self) -> tuple[float, ...]:
        return self._seat.wrench

    @property
    def may_leave(self) -> bool:
        """True once hand and object are let go: leaving is no jolt to those who stay."""
        return self._seat.may_leave

    @property
    def in_fault(self) -> bool:
        """Return whether the force is off until the user re-arms."""
        return self.seated is not None and self.seated.safety.state == "fault"

    @property
    def unstable(self) -> str:
        """Return how the force of this end was unstable, "" if it was not."""
        return self.seated.safety.unstable if self.seated else ""

    @property
    def saturated(self) -> str:
        """Return how the force sat at the device's limit until it was let go, "" if it did not."""
        return self.seated.safety.saturated if self.seated else ""

    @property
    def left(self) -> str:
        """Return how the hand left the device's workspace, "" if it did not."""
        return self.seated.safety.left if self.seated else ""


def _seatless() -> ValueError:
    return ValueError("there is no seat yet")


HANDLERS: Mapping[type[ClientInput], Callable[[ClientCore, Any], ClientAccount | None]] = {
    inputs.Connect: lambda core, given: core.session.connect(core.now_ns),
    inputs.Poll: lambda core, given: core.session.poll(core.now_ns),
    inputs.Reached: lambda core, given: core.session.reached(core.now_ns),
    inputs.Patience: lambda core, given: core._be_patient(given.give_up_ns),
    inputs.KeepSeat: lambda core, given: core.session.heartbeat(core.now_ns),
    inputs.DeviceOpened: lambda core, given: core._seat.equip(given.capability),
    inputs.DeviceFailed: lambda core, given: core._fail(given.reason),
    inputs.ForceApplied: lambda core, given: core._seat.applied(given.force_n),
    inputs.Stop: lambda core, given: core._stop(),
    inputs.Rearm: lambda core, given: core._seat.rearm(),
    inputs.Clutch: lambda core, given: core._seat.clutch(given.held),
    inputs.SetHand: lambda core, given: core._seat.orders.order(given.change),
    inputs.Mark: lambda core, given: core._mark(given.text),
    inputs.CloseLedger: lambda core, given: core._close_ledger(given.ticks),
    inputs.Leave: lambda core, given: core._leave(given.reason),
}
"""Method that `handle` calls for each input."""
