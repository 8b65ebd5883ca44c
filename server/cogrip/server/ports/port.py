"""Port: the server's end of one person's line, between the messages of a coupling scheme and the world."""

from math import inf
from typing import Any

from cogrip.machine.rows import Row
from cogrip.protocol.line.energy_reserve import EnergyReserve
from cogrip.protocol.line.energy_sums import rounding_fraction
from cogrip.protocol.line.latest_state import StateReceiver
from cogrip.protocol.line.loop_meter import LoopMeter
from cogrip.protocol.line.received_waves import ReceivedWaves
from cogrip.protocol.line.receiver import LineReceiver
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.accounts import LinkCount, PlayoutAccount
from cogrip.protocol.wire.button_edges import EdgeReceiver
from cogrip.protocol.wire.clock import MessageClock
from cogrip.server.ports.seat_limits import SeatLimits

Turned = tuple[Row, Row]
"""Rotation vector of a hand, and the angle that it has travelled since its first frame, each [rad], shape (3,)."""


class Port:
    """Takes in one kind of message, gives the world a row a step, and sends its answer back.

    axes           of the seat
    origin, hand   hand before its first frame and after its newest [m, rad]; None before the first
    turned         how the hand had turned after the frame popped last; None where that is not known, or nothing turns
    impedance_nspm of the row popped last; None where the settings' one stays
    next_step_ns   time of the room's next step, which its room sets; below 0 before the first
    proxy          of the newest frame, as its client reports it, in the hand's own frame [m]; None where it does not
    absorbed_j     energy that came out of the line here and did not go to the world
    up_margin_j    least energy margin of the line up so far; None where no ledger of one direction is kept
    up_reserve     energy reserve of the line up
    handle         buttons, orientation and grip of the device
    behind         frames sent down that the client had not applied when it sent the frame popped last; None before that
    loops          the loop over the last second; None where no stiffness adapts to it
    """

    def __init__(self, seat: SeatSettings) -> None:
        self.axes = seat.object.axes
        self.impedance_nspm: float | None = None
        self.next_step_ns = -1
        self.absorbed_j = 0.0
        self.up_margin_j: float | None = 0.0
        self.proxy: Row | None = None
        self.turned: Turned | None = None
        self.behind: int | None = None
        self.loops: LoopMeter | None = None
        self._rounding = rounding_fraction(seat.rates.ticks_per_frame)
        self.origin: Row | None = None
        self.hand: Row | None = None
        self.up_reserve = EnergyReserve(seat.rates.network_hz)
        self.handle = EdgeReceiver()

    def receive(self, message: Any, now_ns: int) -> bool:
        """Receive a frame, of the scheme's message type, that came now. Return False for one that cannot be of this line."""
        raise NotImplementedError

    def take_in(self, datagram: ReceivedWaves, now_ns: int) -> bool:
        """Receive waves, as `receive` does. Return False where the scheme has other messages."""
        return False

    def set_limits(self, limits: SeatLimits) -> None:
        """Bound what the seat brings in by these limits from now on."""
        raise NotImplementedError

    def let_impedance_change(self) -> None:
        """Go by the impedance that the client says of each frame; a port without waves has none."""

    def pop(self, frames: int) -> Row:
        """Return the row to step with; `frames` > 1 if the loop missed frames - 1 steps."""
        raise NotImplementedError

    def push(self, row: Row) -> None:
        """Send the world's answer to a step."""
        raise NotImplementedError

    def message(self, session: int, clock: MessageClock, now_ns: int, object_state: Row, port_j: float) -> bytes:
        """Return the message of this step, encoded, with the clock's stamp.

        object_state: position [m], then velocity [m/s]
        """
        raise NotImplementedError

    def port_in_j(self) -> float | None:
        """Return the energy that had gone in at the client's port up to the frame just popped, where it is known."""
        raise NotImplementedError

    @property
    def neutral(self) -> Row:
        """Answer to a step that did not count."""
        raise NotImplementedError

    @property
    def made_j(self) -> float:
        """Energy that went into the line here so far."""
        return 0.0

    @property
    def used_j(self) -> float:
        """Energy that came out of the line here so far."""
        return 0.0

    def rounding_j(self) -> float:
        """Return the error that rounding alone can make in the energy ledger of both directions."""
        raise NotImplementedError

    @property
    def credit_left(self) -> float:
        """Credit that the line up leaves to the next one, per axis [W] (SPEC 5.4)."""
        return inf

    @credit_left.setter
    def credit_left(self, left: float) -> None:
        """Lend no more than that; a line without a credit has nothing to bound."""

    @property
    def playout_frames(self) -> float | None:
        """Depth of the jitter buffer now; None without one."""
        return None

    @property
    def power_left(self) -> float:
        """Level of the power's bucket, of 1."""
        return 1.0

    @property
    def limited(self) -> dict[str, int]:
        """Limitations so far, by reason."""
        raise NotImplementedError

    def receiver(self) -> LineReceiver | StateReceiver[Any]:
        """Return the end of the line up."""
        raise NotImplementedError

    @property
    def lost(self) -> int:
        """Frames that were sent and never came."""
        return self.receiver().lost

    def count(self) -> LinkCount:
        """Return the counts of the line up."""
        return self.receiver().count()

    def playout_account(self) -> PlayoutAccount | None:
        """Return the account of the jitter buffer; None without one."""
        return None
