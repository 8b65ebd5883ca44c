"""Energy gate at one's own spring (theory 5b): no hand gets more than it has put in, was given, and the budget of its seat.

Symbols: s stretch of the spring [m], K its stiffness, F_d its damper's force, v velocity of the hand, T tick. Energies in J:

    W      work of the hand, sum of F (x_{k+1} - x_k)
    b      E_0 + W - Don + Cred + Refill - Spill        f = b - K s^2 / 2, what is free; D DAMPED_J

    (1) |s| is cut to sqrt(2 max(0, b - D - (1 - T / tau_s) max(0, f - D before)) / K)
    (2) a damper that pushes is cut to what f - D pays for within tau_s; where b < D the damper alone acts, against the hand,
        which so earns the rest; where b < 0 it does until it has given something out all the same: then nothing does before
        b is 0 again
    (3) what f is above the cap is spilt, above E_0 it is donated, within 50 ms: the counter Don goes to all partners
    (4) a partner credits the growth of the largest counter that it has seen, each its part of it, within 50 ms: at once, it
        would be a step of force

So b >= -eps, the take of two ticks, and over all people sum W >= -sum (E_0 + Refill) - sum eps, whatever hands, models, delays,
losses, order and numbers of people do: nothing of them is in it.
"""

from collections.abc import Sequence
from math import sqrt

from cogrip.machine.addition import add_products
from cogrip.protocol.line.energy_sums import CompensatedSum
from cogrip.protocol.settings.coupling_kinds import GATE_MJ

BUDGET_J = 1e-3 * GATE_MJ  # E_0 of a person
CAP_J = BUDGET_J + 0.1  # most free energy
FADE_S = 0.02  # tau_s
DAMPED_J = (
    0.001  # D: a damper whose speed is told late gives out a part in a thousand of it each time that a hand turns
)
DONATED_S = 0.05  # time in which what is above E_0 is donated, and what was donated is credited
DAMPER_MPS = 0.1  # least speed for which a damper that pushes is paid
AHEAD = 1.5  # part of the hand's own speed for which it is
REFILL_W = 0.02  # refill of a hand that rests
REST_MPS = 0.01
REST_S = 0.25


class SpringGate:
    """Ledger of one person.

    work       W
    donated_j  Don, a counter that only grows
    granted_j  E_0 + Cred + Refill - Don - Spill: all that came in but by the hand itself, less what was given away
    stored_j   K s^2 / 2 in this tick
    gated      ticks in which the force was reduced, of `ticks`
    """

    def __init__(self, tick_s: float) -> None:
        self._tick_s = tick_s
        self.work = CompensatedSum()
        self.donated_j = self.credited_j = self.refilled_j = self.spilt_j = 0.0
        self.granted_j = BUDGET_J
        self.stored_j = 0.0
        self._spare_before_j = BUDGET_J - DAMPED_J  # f - D
        self._coming_j = 0.0  # donated by partners and not yet credited
        self._reduced = False  # by `cut`, in this tick
        self._rested_s = 0.0
        self._worked_j = 0.0  # W at the tick before
        self._below = self._gave_out = False  # b is below 0, and has fallen on since
        self.ticks = self.gated = 0

    @property
    def budget_j(self) -> float:
        """Return b [J]."""
        return self.work.value + self.granted_j

    def credit(self, energy_j: float) -> None:
        """Enter what a partner has donated [J]: it is credited bit by bit."""
        self._coming_j += energy_j

    def cut(self, stretch_m: Sequence[float], stiffness_npm: float) -> float:
        """Return the part of a stretch that may stay, of 1: step (1)."""
        self._reduced = False
        if not stiffness_npm:
            return 1.0
        kept = max(0.0, self._spare_before_j) * (1.0 - self._tick_s / FADE_S)
        most = 2.0 * max(0.0, self.budget_j - DAMPED_J - kept) / stiffness_npm
        square = add_products(stretch_m, stretch_m)
        self._reduced = square > most
        return sqrt(most / square) if self._reduced else 1.0

    def pay(
        self, stretch_m: Sequence[float], stiffness_npm: float, damper_n: Sequence[float], velocity_mps: Sequence[float],
        damping_nspm: float,
    ) -> Sequence[float]:  # fmt: skip
        """Return the damper's force that may act, and settle the tick: steps (2), (3) and the refill at rest."""
        self.stored_j = stored = 0.5 * stiffness_npm * add_products(stretch_m, stretch_m)
        self.ticks += 1
        speed = sqrt(add_products(velocity_mps, velocity_mps))
        if self._coming_j:
            part = self._coming_j * min(1.0, self._tick_s / DONATED_S)
            self._coming_j -= part
            self.credited_j += part
            self.granted_j += part
        before = self.budget_j
        budget = before + self._refill(speed, before - stored)
        free = budget - stored
        work = self.work.value
        worked, self._worked_j = work - self._worked_j, work
        if budget < DAMPED_J:
            self._gave_out = budget < 0.0 and (self._gave_out or (self._below and worked < 0.0))
            self._below = budget < 0.0
            self.gated += 1
            self._spare_before_j = free - DAMPED_J
            return [0.0 if self._gave_out else damping_nspm * rate for rate in velocity_mps]
        self._below = self._gave_out = False
        if add_products(damper_n, velocity_mps) < 0.0:
            size = sqrt(add_products(damper_n, damper_n))
            take = size * max(AHEAD * speed, DAMPER_MPS) * FADE_S
            if take > free - DAMPED_J:
                part = max(0.0, free - DAMPED_J) / take
                damper_n = [part * each for each in damper_n]
                self._reduced = True
        self.gated += self._reduced
        if free > CAP_J:
            self.spilt_j += free - CAP_J
            self.granted_j -= free - CAP_J
            free = CAP_J
        if free > BUDGET_J:
            given = (free - BUDGET_J) * min(1.0, self._tick_s / DONATED_S)
            self.donated_j += given
            self.granted_j -= given
            free -= given
        self._spare_before_j = free - DAMPED_J
        return damper_n

    def _refill(self, speed_mps: float, free_j: float) -> float:
        """Return what a hand that rests is given in this tick [J]."""
        self._rested_s = self._rested_s + self._tick_s if speed_mps < REST_MPS else 0.0
        if self._rested_s < REST_S or free_j >= BUDGET_J:
            return 0.0
        given = min(REFILL_W * self._tick_s, BUDGET_J - free_j)
        self.refilled_j += given
        self.granted_j += given
        return given
