"""Passivity at the motors: an energy ledger, two passivity controllers, and the impedance to ask of the device.

Symbols: x position read [m], F force held over a tick [N], T tick [s], M ticks a frame, b_d own damping [N s/m] and c own
friction [N] of the device (its record), q one count [m], v_m speed limit [m/s], E balance [J], E_0 reserve [J].

    E = sum F (x_{k+1} - x_k)  +  what the line gave, less what it took  +  sum over frames of (b_d d^2 / (M T) + c d)

The first term is the hand's work, exact under the hold (theory 7.4); d is the displacement in a frame less one count. E >= -E_1
stays true for every force law if

    |F(k)| <= max((E + E_1) / (v_m T), 2 sqrt(b_d (E + E_1) / T))                                             (`limit`)

and if the line is sent no more in a frame than E has to spare (`spare_j`). Within a frame E counts as sent what the ticks so
far would send, as far as it may be sent: E is what is left at the worst if the frame ends now. docs/device_port.md has the
derivations, the parts of E_0, and the measurements. Passive is not calm: the coupling renders `carried_nspm` at most, what the
device carries by its record (`largest_impedance`), and less once the force has turned back and forth fast.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import dist, exp, hypot, inf, sqrt
from typing import Literal

from cogrip.client.force_limits import SOFT_SLOPE_NPS
from cogrip.client.oscillation import OscillationDetector
from cogrip.client.schemes import SCHEMES
from cogrip.client.velocity import lag_ticks, largest_impedance
from cogrip.devices.device import Capability
from cogrip.protocol.accounts import DeviceAccount
from cogrip.protocol.line.energy_reserve import FIRST_S, known
from cogrip.protocol.settings import SeatSettings

BRISK_MPS = 1.0  # speed whose kinetic energy the reserve holds: a late damper borrows that
UNPAID = 0.25  # fraction of the free reserve that is lent to motion, and comes back
PAYING = 0.1  # fraction of the impedance that the device carries: the damping that pays for a used-up free reserve
FADE = 3.0  # ticks at the speed limit and peak force, over whose energy an unpaid force fades
DOWN = 0.5  # factor of the impedance at each fast reversal of the force in a series of them
BELOW = 0.8  # fraction of the impedance at which a series began: the most that is tried again
UP_S = 2.0  # in which the impedance rises by a factor of e, up to that
TRUST_S = 60.0  # in which that bound rises by a factor of e
LEAST = 0.02  # fraction of the record's impedance
RELEASED_S = 0.5  # for which the force is released where it oscillates, or sits at its limit
MOST_RELEASES = 2  # one more within PERSISTS_S is a fault
PERSISTS_S = 10.0

Cause = Literal["", "oscillation", "limit", "energy"]


class DevicePort:
    """Ledger and controllers of one device, all axes together.

    balance_j     E, now
    least_j       the least E so far, with all that was forgiven
    later_j       the same after the first second: -inf until then, inf until the next `enter`
    reserve_j     E_0
    carried_nspm  the impedance, or damping of virtual coupling, that may be rendered now [N s/m]
    lag_s         time by which a damper acts late (`lag_ticks`)
    ramped        True while the force is ramped, so that the hand does not feel all of it
    oscillates    True once the force has oscillated
    """

    __slots__ = (
        "_changed", "_controlled", "_count_m", "_cut_j", "_damping", "_detector", "_exhausted", "_faded_j",
        "_forgiven_j", "_free_j", "_friction_n", "_given_j", "_limited", "_most_nspm", "_most_step_m", "_own_j", "_pending_j",
        "_persists_ticks", "_record_nspm", "_released_at", "_released_left", "_released_ticks", "_releases", "_tick",
        "_tick_s", "_ticks", "_trust", "_turned", "_up", "balance_j", "carried_nspm", "lag_s", "later_j", "least_j",
        "oscillates", "ramped", "reserve_j",
    )  # fmt: skip

    def __init__(self, capability: Capability, tick_s: float) -> None:
        self._tick_s = tick_s
        self._up, self._trust = exp(tick_s / UP_S), exp(tick_s / TRUST_S)
        self._released_ticks, self._persists_ticks = round(RELEASED_S / tick_s), round(PERSISTS_S / tick_s)
        self.balance_j = self.least_j = 0.0
        self.later_j = -inf
        self._given_j = self._pending_j = 0.0  # of the last call
        self._own_j = 0.0  # what the device's damping has taken
        self._forgiven_j = 0.0  # to hands while their force was ramped
        self._cut_j = 0.0  # what was cut off of the balance, less what was forgiven
        self.ramped = True
        self.oscillates = False
        self._ticks = self._controlled = self._limited = 0  # with force; held by a controller here; by a device limit
        self._changed = False  # a controller here changed the force of this tick
        self._exhausted = 0  # ticks for which the balance has paid for no force
        self._tick = 0
        self._turned = -self._released_ticks - 1  # tick of the last turn of a train
        self._releases = 0
        self._released_at: list[int] = []  # ticks of the releases of the last PERSISTS_S
        self._released_left = 0
        self._detector = OscillationDetector(capability.axes, tick_s)
        self.keep_to(capability)

    def keep_to(self, capability: Capability) -> None:
        """Go by this record from now on."""
        self._record_nspm = largest_impedance(capability, self._tick_s).impedance_nspm
        self.carried_nspm = self._most_nspm = self._record_nspm
        self.lag_s = lag_ticks(capability, self._tick_s) * self._tick_s
        self._damping, self._friction_n = capability.own_damping_nspm, capability.own_friction_n
        self._count_m = capability.resolution_m
        self._most_step_m = most_step_m = capability.speed_mps * self._tick_s
        tick_j = capability.peak_force_n * most_step_m
        self._free_j = 0.5 * capability.apparent_mass_kg * BRISK_MPS * BRISK_MPS
        self._faded_j = self._free_j + FADE * tick_j
        falling_j = 0.5 * capability.peak_force_n**2 * capability.speed_mps / min(capability.slew_nps, SOFT_SLOPE_NPS)
        self.reserve_j = self._faded_j + max(tick_j, falling_j)

    # The ledger

    def enter(self, work_j: float, given_j: float, pending_j: float = 0.0) -> None:
        """Set the hand's work and the energy that the line gave, less what it took, both since the beginning [J].

        pending_j: what the line is to take at the end of the frame under way, as far as it may (`spare_j`)
        """
        balance = work_j + given_j + self._own_j - self._cut_j
        if pending_j:
            spare_j = balance + self._free_j - (self._forgiven_j if self.ramped else 0.0)
            if pending_j > spare_j:
                pending_j = max(0.0, spare_j)
            balance -= pending_j
            given_j -= pending_j
        self.balance_j, self._pending_j = balance, pending_j
        taken_j, self._given_j = self._given_j - given_j, given_j
        if self.ramped and balance < 0.0 < taken_j:
            # The hand moves the line without feeling all of it: the line takes what nobody gave, and the motors gave none of
            # it. To ask that back later would take the force from a hand that did nothing.
            forgiven_j = min(taken_j, -balance)
            self._cut_j -= forgiven_j
            self._forgiven_j += forgiven_j
            self.balance_j = balance = balance + forgiven_j
        earned_j = balance - self._forgiven_j
        if earned_j < self.least_j:
            self.least_j = earned_j
        if earned_j < self.later_j:
            self.later_j = earned_j

    def end_frame(self, start_m: Sequence[float], end_m: Sequence[float], frame_s: float, stored_j: float) -> None:
        """Credit the device's own damping with a frame's motion, and cut the balance off. stored_j: in the coupling."""
        if self._damping or self._friction_n:
            path_m = max(0.0, dist(start_m, end_m) - self._count_m)
            own_j = path_m * (self._damping * path_m / frame_s + self._friction_n)
            self._own_j += own_j
            self.balance_j += own_j
        excess_j = self.balance_j - stored_j - self.reserve_j
        if excess_j > 0.0:
            self._cut_j += excess_j
            self.balance_j -= excess_j
        if self.later_j == -inf and self._tick * self._tick_s >= FIRST_S:
            self.later_j = inf

    @property
    def earned_j(self) -> float:
        """E now, less all that was forgiven."""
        return self.balance_j - self._forgiven_j

    @property
    def spare_j(self) -> float:
        """Energy that the line may be sent at the end of the frame under way.

        While the force is ramped all that was forgiven counts: a hand that pushes then must not load the line for nothing.
        """
        return (self.earned_j if self.ramped else self.balance_j) + self._pending_j + self._free_j

    @property
    def lent_j(self) -> float:
        """Energy that may be used up before anything here takes note of it."""
        return UNPAID * self._free_j

    # The controllers

    @property
    def paying_nspm(self) -> float:
        """Damping that pays, a little at a time, for what a late damper gives: none until a quarter of the free is used."""
        used = -self.balance_j / self._free_j
        return 0.0 if used <= UNPAID else PAYING * self.carried_nspm * min(1.0, (used - UNPAID) / (1.0 - UNPAID))

    def limit(self, force_n: Sequence[float]) -> Sequence[float]:
        """Return the law's force [N], shape (axes,), shortened where the reserve is being used up."""
        left_j = self.balance_j + self._faded_j
        size = hypot(*force_n) if len(force_n) > 1 else abs(force_n[0])
        if size * FADE * self._most_step_m <= left_j or size == 0.0:
            return force_n
        left_j = max(0.0, left_j)
        most_n = max(left_j / (FADE * self._most_step_m), 2.0 * sqrt(self._damping * left_j / self._tick_s))
        if size <= most_n:
            return force_n
        self._changed = True
        return [force * (most_n / size) for force in force_n]

    def watch(
        self,
        force_n: Sequence[float],
        clipped: bool,
        local_n: Sequence[float],
        limited: bool = False,
        reduced: bool = False,
    ) -> Cause:
        """Enter the force of a tick and adapt the impedance. Returns why the force is to be released, "" to go on.

        force_n   to the motors until the next tick [N], shape (axes,)
        clipped   whether it is at the device's peak
        limited   whether any limit of the device holds it
        reduced   whether the coupling renders less than its settings, for `carried_nspm`
        local_n   the part of the law that follows the hand's own motion [N], shape (axes,)
        """
        self._ticks += 1
        self._limited += limited
        self._controlled += reduced or self._changed
        self._changed = False
        carried, record = self.carried_nspm, self._record_nspm
        detector = self._detector
        if carried < record:  # the force of the hand's motion at the record's impedance: else it could shake on unseen
            local_n = [record / carried * local for local in local_n]
        if detector.add(force_n, clipped, local_n):
            if self._tick - self._turned > self._released_ticks:  # the first of its train
                self._most_nspm = max(LEAST * record, BELOW * carried)
            self._turned = self._tick
            self.carried_nspm = max(LEAST * record, DOWN * carried)
        elif carried < record:
            self._most_nspm = min(record, self._trust * self._most_nspm)
            self.carried_nspm = min(self._most_nspm, self._up * carried)
        self._exhausted = self._exhausted + 1 if self.balance_j <= -self._faded_j else 0
        exhausted = self._exhausted > self._released_ticks
        if not (detector.oscillates or detector.at_limit or exhausted):
            return ""
        found: Cause = "oscillation" if detector.oscillates else "limit" if detector.at_limit else "energy"
        if exhausted:
            self._begin_anew()
        self.oscillates = self.oscillates or detector.oscillates
        self._releases += 1
        self._released_left, now = self._released_ticks, self._tick
        self._released_at = [*[tick for tick in self._released_at if now - tick < self._persists_ticks], now]
        detector.forget()
        return found

    # Releases

    @property
    def releasing(self) -> bool:
        """True while the force is released because it oscillated, or sat at its limit."""
        return self._released_left > 0

    @property
    def persists(self) -> bool:
        """True where releases have not helped."""
        return len(self._released_at) > MOST_RELEASES

    def elapse(self) -> None:
        """Enter a tick, with force or without."""
        self._tick += 1
        if self._released_left:
            self._released_left -= 1

    def rearm(self) -> None:
        """Begin anew after a fault. The impedance that was found stays."""
        self._released_at.clear()
        self._released_left = 0
        self._detector.forget()
        self._begin_anew()

    def _begin_anew(self) -> None:
        """Write a negative balance off: one that nothing pays back in time would hold the force at 0 for ever."""
        self._exhausted = 0
        if self.balance_j < 0.0:
            self._forgiven_j -= self.balance_j
            self._cut_j += self.balance_j
            self.balance_j = 0.0

    def account(self) -> DeviceAccount:
        """Return the account of the device port."""
        ticks = max(1, self._ticks)
        return DeviceAccount(
            oscillates=self.oscillates,
            at_limit=self._limited / ticks,
            controlled=self._controlled / ticks,
            leak_j=max(0.0, -self.least_j),
            margin_j=self.least_j + self.reserve_j,
            let_go=self._releases,
            reserve_j=known(self.later_j + self.reserve_j),
        )


def cure(found: Cause, seat: SeatSettings, record: Capability) -> str:
    """Return why the force was released, and what to do."""
    coupling = seat.coupling
    if found == "energy":
        return "the force law took more energy out than came in, and all of the device's reserve; leave this server"
    if found == "limit":
        return (
            f"the force sits at its limit of {record.peak_force_n:g} N; push less, or set coupling.stiffness_npm lower than "
            f"{coupling.stiffness_npm:g}"
        )
    key = SCHEMES[coupling.kind].softer_key
    return f"the force oscillates at the hand; set coupling.{key} lower than {getattr(coupling, key):g}"


class BarePort(DevicePort):
    """The ledger alone, for experiments on force laws without a hand: nothing is limited, adapted or released."""

    def keep_to(self, capability: Capability) -> None:
        super().keep_to(capability)
        self.carried_nspm = self._free_j = inf

    @property
    def paying_nspm(self) -> float:
        return 0.0

    def limit(self, force_n: Sequence[float]) -> Sequence[float]:
        return force_n

    def watch(self, *of_tick: object, limited: bool = False, reduced: bool = False) -> Cause:
        return ""
