"""People as the server knows them: whoever has a seat, and observers."""

from math import inf, isnan
from typing import Literal, NamedTuple

from cogrip.protocol.line.energy_reserve import EnergyReserve
from cogrip.protocol.line.received_waves import ReceivedWaves
from cogrip.protocol.secure.channel import Address
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.accounts import ClientAccount, SeatAccount
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.messages import Edges, Frame, Stamp
from cogrip.protocol.wire.session import LOST_NS, QUIET_NS, SEAT
from cogrip.server.checkpoint import SeatCheckpoint
from cogrip.server.ports.port import Port
from cogrip.server.ports.seat_limits import ClaimedRecord, SeatLimits
from cogrip.server.rate_limit import HELLOS, Buckets
from cogrip.server.seats.effects import EffectSender
from cogrip.server.seats.geometry_sender import GeometrySender
from cogrip.server.seats.hand_changes import SentChanges
from cogrip.server.seats.spring_ramp import SpringRamp
from cogrip.server.seats.stiffness_adaptation import StiffnessAdapter

MOST_EARLIER = 8  # most seat sessions before the last one of which a seat keeps the accounts


class Participant:
    """Common fields of a seat and an observer.

    address      None: unbound; `SeatTable` alone writes it
    ticket       session ticket, to repeat the welcome; neither recorded nor saved
    ticket_hash  hash of the ticket that resumes this session, "" none
    token        public id of the token that admitted the session
    asked_ns     when the hello came by which the address is bound
    """

    def __init__(self, number: int, name: str) -> None:
        self.number = number
        self.name = name
        self.session = self.nonce = 0
        self.address: Address = None
        self.last_received_ns = self.since_ns = self.asked_ns = 0
        self.clock = MessageClock()
        self.ticket = self.ticket_hash = self.token = ""
        self.hellos = Buckets(1, HELLOS)

    def begin(self, session: int, nonce: int, now_ns: int) -> None:
        """Begin a session."""
        self.session, self.nonce = session, nonce
        self.last_received_ns = self.since_ns = now_ns
        self.clock = MessageClock()

    def void_ticket(self) -> None:
        """Void the session ticket, so that nobody can resume the session."""
        self.ticket_hash = ""


class Observer(Participant):
    """One observer of a room."""


class SeatSession(NamedTuple):
    """Accounts of both ends of a seat session that is over; None where the client did not report."""

    client: ClientAccount | None
    seat: SeatAccount

    def least_margin(self) -> float:
        """Return the least energy margin that this end measured [J]; one that is not a number is the least of all."""
        margins = [self.seat.up_margin_j, self.seat.line_margin_j]
        return min([-inf if isnan(margin) else margin for margin in margins if margin is not None], default=0.0)


class Seat(Participant):
    """One person's seat. `state` changes by `protocol.wire.session.SEAT` alone."""

    def __init__(self, settings: SeatSettings, number: int = 0) -> None:
        super().__init__(number, settings.user)
        self.settings = self.begins_with = settings
        self.state: Literal["free", "seated"] = "free"
        self.rtt_ns: int | None = None  # newest measured round trip
        self.port: Port | None = None
        self.adapter: StiffnessAdapter | None = None
        self.spring: SpringRamp | None = None  # once it was changed
        self.geometry: GeometrySender | None = None  # where its client renders contact
        self.hand = SentChanges(settings, settings.rates.network_hz)
        self.effects: EffectSender | None = None  # once there are any
        self.on_object = False
        self.line_margin_j = 0.0  # of both directions of the line together, as `line_reserve`
        self.line_reserve = EnergyReserve(settings.rates.network_hz)
        self.account: ClientAccount | None = None  # reported by the client when it left
        self.last: SeatAccount | None = None  # of this end, at that time
        self.earlier: list[SeatSession] = []  # oldest first
        self.record: ClaimedRecord | None = None  # of the device that the seat was taken with
        self.limits = SeatLimits()  # of what it may bring in
        self.reserved_until_ns: int | None = None  # for the ticket's holder
        self.farewell = b""  # the last one, to be repeated
        self.farewell_ns = 0
        self.power_left = 1.0  # of the power's bucket, when the seat was left
        self.credit_left = inf  # to the next line up, per axis [W]
        self.limited: dict[str, int] = {}  # limitations before the present port, by reason

    def read_stamp(self, stamp: Stamp, now_ns: int) -> bool:
        """Read the stamp of a message; False where it cannot be."""
        return self.read_times(stamp.sent_ns, stamp.echo_ns, stamp.held_ns, now_ns)

    def read_times(self, sent_ns: int, echo_ns: int, held_ns: int, now_ns: int) -> bool:
        """Do what `read_stamp` does with the readings of a stamp."""
        rtt_ns = self.clock.read_times(sent_ns, echo_ns, held_ns, now_ns)
        if rtt_ns is not None:
            self.rtt_ns = rtt_ns
            return True
        return not echo_ns

    def take_in(self, datagram: ReceivedWaves, now_ns: int) -> bool:
        """Receive waves without a handle. Return False for those that cannot be of this seat."""
        return self.port is not None and self.port.take_in(datagram, now_ns)

    def receive(self, message: Frame | Edges, framed: bool, now_ns: int) -> bool:
        """Receive a frame (`framed`) or button edges. Return False for a message that cannot be of this seat."""
        port, handle = self.port, message.handle
        if port is None or not (port.receive(message, now_ns) if framed else type(message) is Edges):
            return False
        return handle is None or port.handle.receive(handle, message.stamp.sent_ns)

    def void_ticket(self) -> None:
        self.ticket_hash = ""
        self.reserved_until_ns = None

    def forget(self) -> None:
        """Forget whoever had the seat: the room begins anew."""
        self.void_ticket()
        self.account = self.last = self.record = None
        self.earlier = []
        self.limited = {}

    def is_free(self, now_ns: int) -> bool:
        """Return whether a newcomer may have this seat."""
        return self.state == "free" and (self.reserved_until_ns is None or now_ns >= self.reserved_until_ns)

    def reserved_ns(self, now_ns: int) -> int:
        """Return for how much longer the seat is reserved for somebody who fell silent; 0 where nobody did."""
        if self.state == "free":
            return max(0, (self.reserved_until_ns or 0) - now_ns)
        silent_ns = now_ns - self.last_received_ns
        return max(1, LOST_NS - silent_ns) if silent_ns >= QUIET_NS else 0

    def checkpoint(self) -> SeatCheckpoint:
        """Return the state that a next server goes on from."""
        return SeatCheckpoint(
            self.name,
            self.session,
            self.nonce,
            self.ticket_hash,
            self.token,
            self.record,
            self.hand.wanted,
            self.hand.line,
        )

    def restore(self, before: SeatCheckpoint) -> None:
        """Restore the session of a checkpoint, which the holder of its ticket can resume."""
        self.session, self.nonce, self.ticket_hash = before.session, before.nonce, before.ticket
        self.token, self.record = before.token, before.record
        if before.tool is not None:
            self.hand.wanted = before.tool
        self.hand.line = before.line

    def close_seat_session(self) -> None:
        """Keep the accounts of the session before; of too many, drop the most passive session."""
        if self.last is not None:
            self.earlier.append(SeatSession(self.account, self.last))
        if len(self.earlier) > MOST_EARLIER:
            self.earlier.remove(max(self.earlier, key=SeatSession.least_margin))
        self.account = self.last = None

    def step(self, event: str) -> bool:
        """Change the state by an event; False where the event does not apply."""
        after = SEAT.get((self.state, event))
        if after is None:
            return False
        self.state = after  # type: ignore[assignment]  # the table's values are states
        return True
