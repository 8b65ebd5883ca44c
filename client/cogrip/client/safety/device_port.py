"""Passivity at the motors: an energy ledger, two passivity controllers, and the impedance to ask of the device.

Symbols: x position read [m], F force held over a tick [N], T tick [s], M ticks a frame, b_d own damping [N s/m] and c own
friction [N] of the device (its record), q one count [m], v_m speed limit [m/s], m apparent mass [kg], F_peak peak force [N],
E balance [J], E_0 reserve [J]. The reserve is what the device may give out beyond what came in, in three parts:

    E_free = m (FREE_RESERVE_MPS)^2 / 2     E_1 = E_free + FADE_TICKS F_peak v_m T     E_0 = E_1 + energy of a falling force

    E = sum F (x_{k+1} - x_k)  +  what the line gave, less what it took  +  sum over frames of (b_d d^2 / (M T) + c d)

The first term is the hand's work, exact under the hold (theory 7.4); d is the displacement in a frame less one count.
E >= -E_1 stays true for every force law if

    |F(k)| <= max((E + E_1) / (v_m T), 2 sqrt(b_d (E + E_1) / T))                                             (`limit`)

and if the line is sent no more energy in a frame than `spare_j`. Within a frame E already excludes what the line would be
sent if the frame ended now. docs/device_port.md has the derivations and the measurements. A passive force can still
oscillate: `CarriedImpedance` bounds what a coupling renders, and `Releases` lets the force go where that does not help.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import dist, hypot, inf, sqrt
from typing import Literal

from cogrip.client.hand.velocity import lag_ticks
from cogrip.client.rows.row_size import surely_below
from cogrip.client.safety.carried_impedance import CarriedImpedance
from cogrip.client.safety.force_limits import SOFT_SLOPE_NPS
from cogrip.client.safety.releases import Releases
from cogrip.devices.device import Capability
from cogrip.protocol.line.energy_reserve import FIRST_S, known
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.accounts import DeviceAccount

FREE_RESERVE_MPS = 1.0  # speed whose kinetic energy is E_free: a late damper takes that and gives it back
TOLERATED_FRACTION = 0.25  # deficit -E that is tolerated, as a fraction of E_free: the motion gives it back
INJECTED_FRACTION = 0.1  # damping injected where all of E_free is used up, as a fraction of what the device carries
FADE_TICKS = 3.0  # The force is scaled from 1 to 0 over the energy of so many ticks at speed limit and peak force.

Cause = Literal["", "oscillation", "limit", "energy"]


class DevicePort:
    """Ledger and controllers of one device, all axes together.

    balance_j     E, now
    least_j       the least E so far, less all that was forgiven (`set_energies`)
    given_out_j   the largest energy that the motors gave out beyond what came in, what was forgiven apart
    later_j       the same after the first second: -inf until then, inf until the next `set_energies`
    reserve_j     E_0
    carried       the impedance, or damping of virtual coupling, that may be rendered now
    releases      of the force
    lag_s         time by which a damper acts late (`lag_ticks`)
    ramped        True while the force is ramped, so that the hand does not feel all of it
    oscillates    True once the force has oscillated
    """

    __slots__ = (
        "_changed", "_controlled", "_count_m", "_cut_j", "_damping", "_dissipated_j", "_exhausted", "_forgiven_j", "_free_j",
        "_friction_n", "_given_j", "_limited", "_most_step_m", "_pending_j", "_tick", "_tick_s", "_ticks", "_usable_j",
        "_written_off_j", "balance_j", "carried", "given_out_j", "lag_s", "later_j", "least_j", "oscillates", "ramped",
        "releases", "reserve_j",
    )  # fmt: skip

    def __init__(self, capability: Capability, tick_s: float, frame_ticks: int = 1) -> None:
        self._tick_s = tick_s
        self.balance_j = self.least_j = self.given_out_j = 0.0
        self._written_off_j = 0.0  # of deficits that were set to 0
        self.later_j = -inf
        self._given_j = self._pending_j = 0.0  # of the last call
        self._dissipated_j = 0.0  # by the device's own damping and friction
        self._forgiven_j = 0.0  # energy that the line took while the force was ramped, and E does not count
        self._cut_j = 0.0  # energy above the upper limit of E that was removed, less what was forgiven
        self.ramped = True
        self.oscillates = False
        self._ticks = self._controlled = self._limited = 0  # with force; held by a controller here; by a device limit
        self._changed = False  # a controller here changed the force of this tick
        self._exhausted = 0  # ticks since E fell to -E_1, so that `limit` allows no force
        self._tick = 0
        self.carried = CarriedImpedance(capability.axes, tick_s, frame_ticks)
        self.releases = Releases(tick_s)
        self.set_record(capability)

    def set_record(self, capability: Capability) -> None:
        """Set the device record."""
        self.carried.set_record(capability, self._tick_s)
        self.lag_s = lag_ticks(capability, self._tick_s) * self._tick_s
        self._damping, self._friction_n = capability.own_damping_nspm, capability.own_friction_n
        self._count_m = capability.resolution_m
        self._most_step_m = most_step_m = capability.speed_mps * self._tick_s
        tick_j = capability.peak_force_n * most_step_m
        self._free_j = 0.5 * capability.apparent_mass_kg * FREE_RESERVE_MPS * FREE_RESERVE_MPS
        self._usable_j = self._free_j + FADE_TICKS * tick_j
        falling_j = 0.5 * capability.peak_force_n**2 * capability.speed_mps / min(capability.slew_nps, SOFT_SLOPE_NPS)
        self.reserve_j = self._usable_j + max(tick_j, falling_j)

    # The ledger

    def set_energies(self, work_j: float, given_j: float, pending_j: float = 0.0) -> None:
        """Set the hand's work and the energy that the line gave less what it took, both since the beginning [J].

        pending_j: energy that the line would take if the frame under way ended now; counted up to `spare_j`
        """
        balance = work_j + given_j + self._dissipated_j - self._cut_j
        if pending_j:
            spare_j = balance + self._free_j - (self._forgiven_j if self.ramped else 0.0)
            if pending_j > spare_j:
                pending_j = max(0.0, spare_j)
            balance -= pending_j
            given_j -= pending_j
        self.balance_j, self._pending_j = balance, pending_j
        taken_j, self._given_j = self._given_j - given_j, given_j
        if self.ramped and balance < 0.0 < taken_j:
            # A ramped force does less work than the line takes, and the motors gave out none of the difference. To count it
            # against E would reduce the force later, although the device gave nothing out: E forgives it.
            forgiven_j = min(taken_j, -balance)
            self._cut_j -= forgiven_j
            self._forgiven_j += forgiven_j
            self.balance_j = balance = balance + forgiven_j
        given_out_j = self._written_off_j - balance
        if given_out_j > self.given_out_j:
            self.given_out_j = given_out_j
        earned_j = balance - self._forgiven_j
        if earned_j < self.least_j:
            self.least_j = earned_j
        if earned_j < self.later_j:
            self.later_j = earned_j

    def end_frame(self, start_m: Sequence[float], end_m: Sequence[float], frame_s: float, stored_j: float) -> None:
        """Add what the device's own damping dissipated in a frame, and limit E to E_0 above what the coupling stores [J]."""
        if self._damping or self._friction_n:
            path_m = max(0.0, dist(start_m, end_m) - self._count_m)
            own_j = path_m * (self._damping * path_m / frame_s + self._friction_n)
            self._dissipated_j += own_j
            self.balance_j += own_j
        excess_j = self.balance_j - stored_j - self.reserve_j
        if excess_j > 0.0:
            self._cut_j += excess_j
            self.balance_j -= excess_j
        if self.later_j == -inf and self._tick * self._tick_s >= FIRST_S:
            self.later_j = inf

    def left_j(self) -> float:
        """Return what is left to the device's force before this port limits it [J]: earned, and in reserve."""
        return self.balance_j - self._forgiven_j + self.reserve_j

    @property
    def earned_j(self) -> float:
        """E now, less all that was forgiven."""
        return self.balance_j - self._forgiven_j

    @property
    def spare_j(self) -> float:
        """Energy that the line may be sent at the end of the frame under way [J].

        While the force is ramped all that was forgiven is deducted, so that a hand that pushes then does not load the line.
        """
        return (self.earned_j if self.ramped else self.balance_j) + self._pending_j + self._free_j

    @property
    def tolerated_j(self) -> float:
        """Deficit -E up to which no damping is injected [J]."""
        return TOLERATED_FRACTION * self._free_j

    # The controllers

    @property
    def injected_nspm(self) -> float:
        """Damping that the passivity controller injects [N s/m]; 0 while -E is below TOLERATED_FRACTION of E_free.

        It dissipates the energy that a late damper has given out.
        """
        used = -self.balance_j / self._free_j
        if used <= TOLERATED_FRACTION:
            return 0.0
        return (
            INJECTED_FRACTION * self.carried.nspm * min(1.0, (used - TOLERATED_FRACTION) / (1.0 - TOLERATED_FRACTION))
        )

    def damped(self, force_n: Sequence[float], velocity_mps: Sequence[float]) -> Sequence[float]:
        """Return the law's force [N] with the injected damper's, shape (axes,)."""
        if self.balance_j >= 0.0 or not (injected := self.injected_nspm):
            return force_n
        return [law + injected * speed for law, speed in zip(force_n, velocity_mps, strict=True)]

    def limit(self, force_n: Sequence[float]) -> Sequence[float]:
        """Return the law's force [N], shape (axes,), scaled down to the bound on |F(k)| above where E + E_1 is small."""
        left_j = self.balance_j + self._usable_j
        if left_j > 0.0 and surely_below(force_n, left_j / (FADE_TICKS * self._most_step_m)):
            return force_n
        size = hypot(*force_n) if len(force_n) > 1 else abs(force_n[0])
        if size * FADE_TICKS * self._most_step_m <= left_j or size == 0.0:
            return force_n
        left_j = max(0.0, left_j)
        most_n = max(left_j / (FADE_TICKS * self._most_step_m), 2.0 * sqrt(self._damping * left_j / self._tick_s))
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
        absorbs: bool = False,
    ) -> Cause:
        """Check the force of a tick for oscillation, and adapt what is carried. Return why the force is to be released, or "".

        force_n   to the motors until the next tick [N], shape (axes,)
        clipped   whether it is at the device's peak
        limited   whether any limit of the device holds it
        reduced   whether the coupling renders less than its settings, for what is carried
        local_n   the part of the law that follows the hand's own motion [N], shape (axes,)
        absorbs   whether the coupling absorbs the returning wave where less is rendered: then that quiets a line, too
        """
        self._ticks += 1
        self._limited += limited
        self._controlled += reduced or self._changed
        self._changed = False
        carried, detector = self.carried, self.carried.detector
        carried.adapt(self._tick, force_n, clipped, local_n, absorbs)
        self._exhausted = self._exhausted + 1 if self.balance_j <= -self._usable_j else 0
        exhausted = self._exhausted > self.releases.ticks
        if not (detector.oscillates or detector.at_limit or exhausted):
            return ""
        found: Cause = "oscillation" if detector.oscillates else "limit" if detector.at_limit else "energy"
        if exhausted:
            self._write_off()
        if absorbs and detector.oscillates:
            carried.come_back_with_less()
        self.oscillates = self.oscillates or detector.oscillates
        self.releases.begin(self._tick)
        detector.forget()
        return found

    def elapse(self) -> None:
        """Count a tick, with force or without."""
        self._tick += 1
        self.releases.elapse()

    def rearm(self) -> None:
        """Reset after a fault. What is carried stays as it is."""
        self.releases.forget()
        self.carried.detector.forget()
        self._write_off()

    def _write_off(self) -> None:
        """Set a negative balance to 0: otherwise one that nothing fills in time would hold the force at 0 for ever."""
        self._exhausted = 0
        if self.balance_j < 0.0:
            self._forgiven_j -= self.balance_j
            self._written_off_j -= self.balance_j
            self._cut_j += self.balance_j
            self.balance_j = 0.0

    def account(self) -> DeviceAccount:
        """Return the account of the device port."""
        ticks = max(1, self._ticks)
        return DeviceAccount(
            oscillates=self.oscillates,
            at_limit=self._limited / ticks,
            controlled=self._controlled / ticks,
            leak_j=self.given_out_j,
            margin_j=self.least_j + self.reserve_j,
            let_go=self.releases.count,
            reserve_j=known(self.later_j + self.reserve_j),
            budget_j=self.reserve_j,
        )


def cure(found: Cause, seat: SeatSettings, record: Capability) -> str:
    """Return why the force was released, and what to do."""
    coupling = seat.coupling
    if found == "energy":
        return "the force law took more energy out than came in, and all of the device's reserve; leave this server"
    if found == "limit":
        most = f"{record.peak_force_n:g} N"
        if record.gripper is not None:
            most += f", or {record.gripper.peak_force_n:g} N of the gripper"
        if record.rotation is not None:
            most += f", or {record.rotation.peak_torque_nm:g} N m of torque"
        lower = f"set coupling.stiffness_npm lower than {coupling.stiffness_npm:g}"
        return f"the force sits at its limit of {most}; push less, or {lower}"
    key = coupling.traits.softer_key
    return f"the force oscillates at the hand; set coupling.{key} lower than {getattr(coupling, key):g}"
