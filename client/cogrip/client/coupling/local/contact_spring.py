"""Spring and damper of a contact, as its device carries them, and the energy gate that pays for its depth (theory 7.7).

Where a surface is to be elsewhere it goes there as far as that costs no more than the contact has dissipated (passive
set-position modulation, Lee and Huang, IEEE T-RO 2010): each tick, with depth d, U = K max(d, 0)^2 / 2 and the hand's x,

    E += F (x_{k+1} - x_k) - (U_{k+1} - U_k), at most MOST_SAVED_J      p+ nearest to its goal with U(p+) - U(p) <= E

While the force is ramped by a gain g the spring holds g U: that is the U of E. g grows without anybody's work, so a surface of
whatever kind yields then: it goes with the hand as far as keeps E >= -LENT_J. After a fault nothing is paid.
"""

from math import inf, sqrt

from cogrip.client.hand.velocity import largest_impedance
from cogrip.client.rows.springs import spring_j, stretch_m
from cogrip.devices.device import Capability
from cogrip.protocol.settings.seat import SeatSettings

MOST_SAVED_J = 1e-3  # largest E
LENT_J = 1e-4
"""Depth below 0 to which E may fall while the force is ramped: a touch loads the spring before any force has worked."""
MOST_STEP_N = 0.5  # largest change of the force in a tick by a surface that moves


class ContactGate:
    """Energy gate of a contact. saved_j: E, what may be spent on moving the surface into the hand."""

    def __init__(self) -> None:
        self.saved_j = self._counted_j = 0.0  # E, and U as it knows it

    def begin(self, stored_j: float) -> None:
        """Let this U count as paid, and nothing more."""
        self.saved_j, self._counted_j = 0.0, stored_j

    def settle(self, stored_j: float, ramped: bool) -> float:
        """Enter the U of now. Return how much of it may stay: of a ramped force, what the hand has paid for."""
        saved = self.saved_j - (stored_j - self._counted_j)
        if ramped and saved < -LENT_J:
            unpaid = min(stored_j, -LENT_J - saved)
            stored_j -= unpaid
            saved += unpaid
        self.saved_j, self._counted_j = min(MOST_SAVED_J, saved), stored_j
        return stored_j

    def move(self, stored_j: float) -> None:
        """Enter the U after the surface was moved."""
        self.saved_j -= max(0.0, stored_j - self._counted_j)
        self._counted_j = stored_j

    def grown(self, depth_m: float, goal_m: float, stiffness_npm: float) -> float:
        """Return the depth nearest to `goal_m` that E pays for and that changes the force by MOST_STEP_N at most."""
        if not stiffness_npm:
            return goal_m
        step = MOST_STEP_N / stiffness_npm
        most = sqrt(depth_m * depth_m + 2.0 * max(0.0, self.saved_j) / stiffness_npm)
        return min(max(goal_m, depth_m - step), most, depth_m + step)


class ContactSpring:
    """Spring and damper of one seat's contact.

    stiffness, damping  K and B as they are rendered now
    watched             factor on a contact's force that makes it what the device port watches
    reduced             whether the device carries less than the settings ask for
    gate                energy gate
    """

    def __init__(self, seat: SeatSettings) -> None:
        self._tick_s = seat.rates.tick_s
        self._asked_npm, self._asked_nspm = seat.coupling.stiffness_npm, seat.coupling.damping_nspm
        self._lag_s, self._peak_n, self._record_nspm = 0.0, inf, inf  # of the device
        self.stiffness, self.damping = self._asked_npm, self._asked_nspm
        self._carried = -1.0  # impedance that they are for
        self.reduced = False
        self.watched = 1.0
        self.gate = ContactGate()

    def fit(self, record: Capability, lag_s: float) -> None:
        """Set the device record. lag_s: time by which a damper acts late on it [s]."""
        self._lag_s, self._peak_n, self._carried = lag_s, record.peak_force_n, -1.0
        self._record_nspm = largest_impedance(record, self._tick_s).impedance_nspm

    def carry(self, carried_nspm: float) -> None:
        """Set stiffness and damping to what the device carries.

        Where the device port takes from the damper, the spring is reduced with it: a spring that keeps its stiffness while
        its damper goes rings the more. The port watches the contact as it would be with all of both (`DevicePort.watch`).
        """
        if carried_nspm == self._carried:  # as mostly
            return
        self._carried, whole = carried_nspm, min(self._asked_nspm, self._record_nspm)
        self.damping = min(whole, carried_nspm)
        kept = self.damping / whole if whole else 1.0
        self.stiffness = min(kept * self._asked_npm, carried_nspm / self._lag_s if self._lag_s else inf)
        self.reduced = self.stiffness < self._asked_npm or self.damping < self._asked_nspm
        left = min(kept, self.stiffness / self._asked_npm) if self._asked_npm else kept
        self.watched = min(1.0, carried_nspm / self._record_nspm / left) if self._record_nspm < inf and left else 1.0

    def stored_j(self, depth_m: float, gain: float) -> float:
        """Return g U."""
        return gain * spring_j(self.stiffness, depth_m, self._peak_n)

    def kept_m(self, depth_m: float, gain: float) -> float:
        """Return the depth that a contact may keep: less where it has not been paid for, none where there is no force."""
        stored = self.stored_j(depth_m, gain)
        kept = self.gate.settle(stored, gain < 1.0)
        if gain == 0.0:
            return 0.0
        return depth_m if kept == stored else stretch_m(self.stiffness, kept / gain, self._peak_n)
