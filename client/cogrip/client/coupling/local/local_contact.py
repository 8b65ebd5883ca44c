"""Contact rendered by the client itself, at the device rate (`coupling.kind = "local"`; theory section 7.7).

`LocalCoupling` is a wave line with a contact in front of it: the hand touches the contact, and what is behind the contact
moves the line's port. What is touched is a part: a wall or a face of a free object (`local_surface`), fixed shapes of a scene
in places (`local_scene`), the same with a hand that turns its tool (`local_poses`).
"""

from collections.abc import Callable, Sequence
from math import inf
from operator import mul

from msgspec.structs import replace

from cogrip.client.coupling.interface import Coupling
from cogrip.client.coupling.local.contact_spring import ContactSpring
from cogrip.client.coupling.wave_coupling import WaveCoupling
from cogrip.devices.device import Capability
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES
from cogrip.protocol.line.energy_sums import CompensatedSum
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.handle import Handle
from cogrip.protocol.wire.messages import Geom, Waves


class Contact:
    """The contact of a hand, rendered here in front of a line.

    spring      spring and damper of the contact, and its energy gate
    position_m  of the hand at this tick; None for no hand
    proxy_m     place of the hand without the depth of contact, shape (places,)
    late        whether the line's port is at the hand, so that old samples were made against waves of then
    """

    late = False

    def __init__(self, seat: SeatSettings, line: "LocalCoupling") -> None:
        self._line, self._tick_s = line, seat.rates.tick_s
        self.spring = ContactSpring(seat)
        self.position_m: Row | None = None
        self.proxy_m: Row = (0.0,) * min(seat.object.axes, PLACES)

    @property
    def stored_j(self) -> float:
        """Energy in the spring."""
        raise NotImplementedError

    @property
    def pressed(self) -> tuple[float, Sequence[float]] | None:
        """Depth in fixed geometry where it should be [m], and its direction; None where it is not known here."""
        return None

    def fit(self, record: Capability, lag_s: float) -> None:
        """Set the device record. lag_s: time by which a damper acts late on it [s]."""
        self.spring.fit(record, lag_s)

    def go_on_from(self, before: "Contact") -> None:
        """Begin as the contact of this seat's line before ended: what the hand presses on does not vanish under it."""
        self.proxy_m, self.spring.gate = before.proxy_m, before.spring.gate

    def gap(self) -> bool:
        """Return whether the force is to fall softly for the line's sake; it is made here, so mostly not."""
        return False

    def force(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> list[float]:
        """Return the force on the hand [N], shape (axes,)."""
        raise NotImplementedError

    def elapse(self, applied_n: Sequence[float], mean_velocity_mps: Sequence[float]) -> None:
        """Enter a tick of the hand, of what is behind the contact, and of the line."""
        raise NotImplementedError

    def elapse_absent(self) -> None:
        """Enter a tick without a hand."""
        zero = (0.0,) * len(self._line.sent)
        if self.position_m is not None:
            self.release()
        self.elapse(zero, zero)

    def release(self) -> None:
        """Leave what the hand has touched."""
        self.position_m = None
        self.spring.gate.begin(0.0)

    def given_j(self, line_j: float) -> float:
        """Return the energy that all behind the hand gave it, of what the line gave."""
        return line_j

    def pending_j(self, line_j: float) -> float:
        """Return the energy that the frame under way would have the other end take, of that of the line."""
        return line_j

    def spare_j(self, spare_j: float) -> float:
        """Return what the frame may give the line at most."""
        return spare_j

    def start_frame(self) -> None:
        """Go on to the next frame of the line, which plays from now on."""

    def fits(self, message: Waves) -> bool:
        """Return whether a message has the state that the server sends to such a contact."""
        return len(message.state) == len(self._line.object_state)

    def told(self, state: Row) -> None:
        """Take in what the newest state has behind the object's own."""

    def receive_shape(self, geom: Geom) -> bool:
        """Receive a shape of the room's fixed geometry. Return False where it does not fit, or this contact needs none."""
        return False


class LocalCoupling(WaveCoupling):
    """A contact here, the wave line behind it."""

    def __init__(self, seat: SeatSettings, make_contact: Callable[[SeatSettings, "LocalCoupling"], Contact]) -> None:
        super().__init__(seat)
        self._hand_j = CompensatedSum()  # work of the hand
        self.contact = make_contact(seat, self)

    def fit(self, record: Capability, lag_s: float) -> None:
        super().fit(record, lag_s)
        self.contact.fit(record, lag_s)

    def go_on_from(self, before: Coupling) -> None:
        super().go_on_from(before)
        if isinstance(before, LocalCoupling):
            self.ramp_gain = before.ramp_gain
            self.contact.go_on_from(before.contact)

    def set_latency(self, ticks: int) -> None:
        """The line begins behind the contact: its own ticks are never late, unless its port is at the hand."""
        if self.contact.late:
            super().set_latency(ticks)

    @property
    def pressed(self) -> tuple[float, Sequence[float]] | None:
        return self.contact.pressed

    @property
    def stored_j(self) -> float:
        return self.contact.stored_j

    def entered_j(self) -> float:
        return self._hand_j.value

    def given_j(self) -> float:
        return self.contact.given_j(super().given_j())

    def pending_j(self) -> float:
        return self.contact.pending_j(super().pending_j())

    def gap(self) -> bool:
        return self.contact.gap()

    def elapse(self, mean_velocity_mps: Sequence[float], velocity_mps: Sequence[float], hold: float = 1.0) -> None:
        applied = self.applied_n
        self._hand_j.add(add_floats(map(mul, applied, mean_velocity_mps)) * self._tick_s)
        self.contact.elapse(applied, mean_velocity_mps)

    def elapse_absent(self) -> None:
        self.contact.elapse_absent()

    def end_frame(self, spare_j: float = inf) -> int:
        return super().end_frame(self.contact.spare_j(spare_j))

    def start_frame(self) -> int:
        ticks = super().start_frame()
        self.contact.start_frame()
        return ticks

    def force(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> list[float]:
        return self.contact.force(position_m, velocity_mps)

    def receive(self, message: Waves) -> bool:
        newest, state, own = self.newest, message.state, len(self.object_state)
        if not self.contact.fits(message):
            return False
        if len(state) > own:
            message = replace(message, state=state[:own])
        if not super().receive(message):
            return False
        if self.newest > newest:
            self.contact.told(state[own:])
        return True

    def receive_shape(self, geom: Geom) -> bool:
        return self.contact.receive_shape(geom)

    def message(
        self, session: int, clock: MessageClock, now_ns: int, origin_m: Row, position_m: Row, velocity_mps: Sequence[float],
        handle: Handle | None = None,
    ) -> bytes:  # fmt: skip
        place = position_m + self.contact.proxy_m
        return super().message(session, clock, now_ns, origin_m, place, velocity_mps, handle)

    # The line, as the contact moves it

    def enter_line(self, velocity_mps: Sequence[float]) -> None:
        """Enter a tick of the line, whose port has moved at this mean velocity."""
        super().elapse(velocity_mps, velocity_mps)

    def leave_line(self) -> None:
        """Enter a tick in which nothing is sent, and what comes is absorbed."""
        super().elapse_absent()

    def line_force(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> list[float]:
        """Return the line's force at its port."""
        return super().force(position_m, velocity_mps)
