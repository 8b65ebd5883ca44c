"""Interface of all couplings: the client's end of a scheme that joins a hand to the object.

Each tick:   `elapse` adds the motion of the tick that has passed (`elapse_absent` without a hand, `elapse_held` with the
             clutch held), `force` returns the force of the law.
Each frame:  `end_frame`, then `message` returns what is sent; `start_frame` plays what came.
"""

from collections.abc import Sequence
from math import inf
from typing import Any

from cogrip.devices.device import Capability
from cogrip.machine.rows import Row
from cogrip.protocol.line.energy_reserve import EnergyReserve
from cogrip.protocol.line.energy_sums import CompensatedSum
from cogrip.protocol.line.latest_state import StateReceiver
from cogrip.protocol.settings.hand import HandChange
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.accounts import LineAccount, LinkCount, PlayoutAccount
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.handle import Handle
from cogrip.protocol.wire.messages import Geom


class PortEnergy:
    """Energy through a port so far [J]: `made_j` into the line, `used_j` out of it, `..._now_j` in this frame."""

    __slots__ = ("_made", "_stored_j", "_used", "made_now_j", "used_now_j")

    def __init__(self) -> None:
        self._made, self._used = CompensatedSum(), CompensatedSum()  # up to the last frame that ended
        self._stored_j = 0.0  # their difference
        self.made_now_j = self.used_now_j = 0.0

    def end_frame(self) -> None:
        """Add the frame that ends."""
        self._made.add(self.made_now_j)
        self._used.add(self.used_now_j)
        self._stored_j = self._made.value - self._used.value
        self.made_now_j = self.used_now_j = 0.0

    @property
    def made_j(self) -> float:
        return self._made.value + self.made_now_j

    @property
    def used_j(self) -> float:
        return self._used.value + self.used_now_j

    def port_j(self) -> float:
        """Return the energy that stayed in the line."""
        return self._stored_j + (self.made_now_j - self.used_now_j)


class Coupling:
    """Energies in J, forces in N, rows of shape (axes,).

    Its owner sets

        applied_n      before `elapse`: the force that the hand felt in the ticks that are entered
        carried_nspm   before `force`: impedance, or damping, that the device renders at most
        ramp_gain      gain of the ramp that the force goes through
        cut_n          what limits took from the force that is held now, None for nothing

    and reads

        frame_ticks    device ticks in a frame, M
        local_n        part of the law that follows the hand's own motion
        reduced        whether less than the settings ask for is rendered
        absorbs        whether rendering less absorbs a part of what returns
        implausible    what is counted of this frame, as no device or scene brings it about; "" for nothing
        returning      v held over this frame, `sent` u of the last one [sqrt(W)]; 0 without waves
        object_state   positions and velocities of the object as last received, shape (2 axes,)
        down_margin_j  least margin of the line down; None where no ledger of one direction is kept
        down_reserve   its energy reserve
        turns          whether it asks by `turn` how the tool is turned, which lengths do not tell
    """

    def __init__(self, seat: SeatSettings) -> None:
        self.absorbs = False
        self.turns = False
        self._seat, axes = seat, seat.object.axes
        self.frame_ticks = seat.rates.ticks_per_frame
        self.applied_n: Sequence[float] = (0.0,) * axes
        self.carried_nspm = inf
        self.ramp_gain = 1.0
        self.cut_n: Sequence[float] | None = None
        self.local_n: Sequence[float] = (0.0,) * axes
        self.reduced = False
        self.implausible = ""
        self.still: Row = (0.0,) * axes
        self.returning: Row = self.still
        self.sent: Row = (0.0,) * axes
        self.object_state: Row = (0.0,) * (2 * axes)
        self.down_margin_j: float | None = 0.0
        self.down_reserve = EnergyReserve(seat.rates.network_hz)

    def gap(self) -> bool:
        """Return whether the wave held now stands for one that is missing."""
        return False

    @property
    def played(self) -> bool:
        """True where the frame that plays now had come in its time."""
        return False

    @property
    def pressed(self) -> tuple[float, Sequence[float]] | None:
        """Depth in fixed geometry where it should be [m], and its direction; None where it is not known here."""
        return None

    @property
    def deficit_frames(self) -> float:
        """Position deficit of the line down, in frames of the wave that plays now."""
        return 0.0

    @property
    def stored_j(self) -> float:
        """Energy kept here of all that the other end gave."""
        return 0.0

    @property
    def refilled_j(self) -> float:
        """Energy that the coupling gave to a hand at rest, beyond its credit."""
        return 0.0

    @property
    def port_j(self) -> float:
        """Energy that went into the coupling here."""
        raise NotImplementedError

    def entered_j(self) -> float:
        """Return the energy that the hand put in: into the line, unless there is something between the two."""
        return self.port_j

    @property
    def credit_left(self) -> float:
        """Credit that the line down leaves to the next one, per axis [W] (SPEC 5.4)."""
        return inf

    @credit_left.setter
    def credit_left(self, left: float) -> None:
        """Do nothing: there is no line of waves."""

    def given_j(self) -> float:
        """Return the energy that the other end gave this one, less what it took up to the last frame that ended."""
        raise NotImplementedError

    def pending_j(self) -> float:
        """Return the energy that the ticks of the frame under way would have the other end take."""
        return 0.0

    @property
    def newest(self) -> int:
        """Number of the newest frame received; -1 before the first."""
        raise NotImplementedError

    def fit(self, record: Capability, lag_s: float) -> None:
        """Set the device record. lag_s: time by which a damper acts late on it [s]."""
        raise NotImplementedError

    def set_latency(self, ticks: int) -> None:
        """Samples are `ticks` ticks old from now on."""

    def elapse(self, mean_velocity_mps: Sequence[float], velocity_mps: Sequence[float], hold: float = 1.0) -> None:
        """Add a tick that has passed. Velocities are of the tool [m/s].

        mean_velocity_mps  displacement between the samples of the tick over its length T_c
        velocity_mps       velocity sample at its start
        hold               factor on the forward wave of a client that is leaving: from 1 down to 0
        """
        raise NotImplementedError

    def elapse_held(self) -> None:
        """Add a tick that has passed with the clutch held: the tool stands still."""
        self.elapse(self.still, self.still)

    def elapse_absent(self) -> None:
        """Add a tick that has passed without a hand."""

    def turn(self, position_m: Row, rotation_rad: Row) -> None:
        """Enter the tool's rotation vector at a place, in lengths, as a sample has come."""

    def end_frame(self, spare_j: float = inf) -> int:
        """End a frame, which may give the line at most `spare_j`. Return the ticks of the next."""
        raise NotImplementedError

    def start_frame(self) -> int:
        """Play what has come for the next frame. Return for how many ticks."""
        raise NotImplementedError

    def force(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> Sequence[float]:
        """Return the law's force on the hand [N]."""
        raise NotImplementedError

    def message(
        self, session: int, clock: MessageClock, now_ns: int, origin_m: Row, position_m: Row, velocity_mps: Sequence[float],
        handle: Handle | None = None,
    ) -> bytes:  # fmt: skip
        """Return what is sent of the frame that ended, encoded. handle: what the device told beside its axes."""
        raise NotImplementedError

    def receive(self, message: Any) -> bool:
        """Receive a message of the server. Return False where it cannot be of this line."""
        raise NotImplementedError

    def receive_shape(self, geom: Geom) -> bool:
        """Receive a shape of the room's fixed geometry. Return False where it does not fit, or this coupling needs none."""
        return False

    def lost(self) -> int:
        """Return the number of frames from the server that were lost."""
        raise NotImplementedError

    def count(self) -> LinkCount:
        """Count the frames that came down."""
        raise NotImplementedError

    @property
    def playout_frames(self) -> float | None:
        """Frames that the jitter buffer holds back now; None without one."""
        return None

    def recorded(self) -> tuple[float, int, float | None]:
        """Return what the record of a tick has of the line: `port_j`, `lost()`, `playout_frames`."""
        return self.port_j, self.lost(), self.playout_frames

    def playout_account(self) -> PlayoutAccount | None:
        """Return how frames were played out; None without a jitter buffer."""
        return None

    def loop_frames(self) -> float | None:
        """Return the measured loop: frames from a message to the frame in which its answer is applied."""
        return None

    def go_on_from(self, before: "Coupling") -> None:
        """Begin as this line of the same seat ended; `fit` comes after."""
        self.down_margin_j = before.down_margin_j  # of all lines: the new one begins with 0
        self.credit_left = before.credit_left  # all lines together lend one credit

    def change(self, seat: SeatSettings) -> None:
        """Go by these settings of line and spring from now on."""
        self._seat = seat

    def line_held(self) -> HandChange:
        """Return the line's settings as they hold; nothing where there is no line of waves, or none was changed."""
        return HandChange()

    def seat_now(self) -> SeatSettings:
        """Return the seat's settings with what is in use in place of what was to begin with."""
        return self._seat

    def line_account(self) -> LineAccount | None:
        """Return impedance and filter of the line; None without waves."""
        return None


class LatestStateCoupling(Coupling):
    """Base of the couplings whose newest message wins. One that is missing leaves no gap: the last one stands."""

    def __init__(self, seat: SeatSettings) -> None:
        super().__init__(seat)
        self._receiver: StateReceiver[Any] = StateReceiver()
        self._number = -1
        self._peak_n, self._lag_s = inf, 0.0  # of the device

    def fit(self, record: Capability, lag_s: float) -> None:
        self._peak_n, self._lag_s = record.peak_force_n, lag_s

    @property
    def newest(self) -> int:
        return self._receiver.newest

    def lost(self) -> int:
        return self._receiver.lost

    def count(self) -> LinkCount:
        return self._receiver.count()
