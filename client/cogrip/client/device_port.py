"""Passivity at the motors: an energy ledger, a passivity controller, and the impedance that the device is asked to render.

Symbols: x position read [m], F force held over a tick [N], T tick [s], b_d own damping [N s/m] and c own friction [N] of the device
(its record), q one count [m], E balance, E_0 reserve [J], v_m speed limit [m/s]

    E = sum F (x_{k+1} - x_k)  +  what the line gave, less what it took  +  sum over frames of (b_d |dx|^2 / T_n + c |dx|)

The first term is the hand's work, exact under the hold (theory 7.4). The device's own damping takes at least what the third term says,
with dx the displacement of a frame less one count (Cauchy-Schwarz; a path is no shorter than its chord). E is kept at or above
-E_0 for every force law, and every motion within the speed limit: a tick gives out at most |F| v_m T, or F^2 T / (4 b_d), so

    |F(k)| <= max((E + E_0) / (v_m T), 2 sqrt(b_d (E + E_0) / T))

and the line is sent no more than what leaves E at -FLOOR E_0 (`spare_j`). E is cut off at what is stored plus E_0, so that energy
of long ago pays for nothing. docs/device_port.md has the derivation and the measurements.

Passive is not calm: a damper beyond what the device carries may buzz on the energy that the hand supplies. So the coupling is asked
for `carried_nspm` at most: what the record says that the device carries (`largest_impedance`), less wherever the force reverses fast.
"""

from collections.abc import Sequence
from math import dist, exp, hypot, inf, sqrt

from cogrip.client.oscillation import OscillationDetector
from cogrip.client.velocity import lag_ticks, largest_impedance
from cogrip.devices.device import Capability
from cogrip.protocol.accounts import DeviceAccount

REACH_MPS = 1.0  # a brisk hand; the reserve holds the kinetic energy that it gives the device
FADE = 3.0  # ticks at the speed limit, over whose energy a force that is not paid for fades
DOWN = 0.7  # of the impedance, at each fast reversal of a train
BELOW = 0.8  # of the impedance at which a train began: what is tried again at most
UP_S = 2.0  # in which it comes back by a factor of e, as far as that
TRUST_S = 60.0  # in which that bound rises by a factor of e
LEAST = 0.02  # of what the record says
REST_S = 0.5  # for which the force is let go where it oscillates, or sits at its limit
MOST_RESTS = 2  # one more within GOES_ON_S is a fault
GOES_ON_S = 10.0


class DevicePort:
    """The ledger and the controllers of one device, all axes together."""

    def __init__(self, capability: Capability, tick_s: float) -> None:
        self._tick_s = tick_s
        self._up = exp(tick_s / UP_S)
        self._trust = exp(tick_s / TRUST_S)
        self.detector = OscillationDetector(capability.axes, tick_s, capability.resolution_m)
        self.balance_j = self.least_j = 0.0
        self._own_j = 0.0  # what the device's damping has taken
        self._cut_j = 0.0  # what was cut off of the balance
        self.ticks = self.controlled = self.limited = 0  # ticks with force; held by this controller; by any limit
        self.oscillates = False  # was found to
        self._rests: list[int] = []  # ticks at which the force was let go, of the last GOES_ON_S
        self._rest_ticks = round(REST_S / tick_s)
        self._goes_on_ticks = round(GOES_ON_S / tick_s)
        self._tick = 0
        self._rest_left = 0
        self.ramped = True  # the force of the tick under way
        self.fed = 0
        self.most_fast = 0
        self.keep_to(capability)

    def keep_to(self, capability: Capability) -> None:
        """Go by this record from now on."""
        self._record_nspm = largest_impedance(capability, self._tick_s).impedance_nspm
        self.carried_nspm = self._most_nspm = self._record_nspm
        self.lag_s = lag_ticks(capability, self._tick_s) * self._tick_s
        self._damping = capability.own_damping_nspm
        self._friction_n = capability.own_friction_n
        self._count_m = capability.resolution_m
        self._most_step_m = most_step_m = min(capability.speed_mps, 4.0) * self._tick_s
        self._free_j = 0.5 * capability.apparent_mass_kg * REACH_MPS * REACH_MPS
        self._per_joule = 1.0 / (FADE * most_step_m)
        self.reserve_j = self._free_j + (1.0 + FADE) * capability.peak_force_n * most_step_m
        self._fade_end_j = self._free_j + FADE * capability.peak_force_n * most_step_m

    def book(self, worked_j: float, given_j: float) -> None:
        """Set the hand's work and the line's net gift, both since the beginning."""
        self.balance_j = balance = worked_j + given_j + self._own_j - self._cut_j
        if balance < self.least_j:
            self.least_j = balance

    def end_frame(self, start_m: Sequence[float], end_m: Sequence[float], frame_s: float, stored_j: float) -> None:
        """Credit the device's own damping for a frame, and cut the balance off."""
        if self._damping or self._friction_n:
            path_m = max(0.0, dist(start_m, end_m) - self._count_m)
            own_j = path_m * (self._damping * path_m / frame_s + self._friction_n)
            self._own_j += own_j
            self.balance_j += own_j
        excess = self.balance_j - stored_j - self.reserve_j
        if excess > 0.0:
            self._cut_j += excess
            self.balance_j -= excess

    @property
    def spare_j(self) -> float:
        """Energy that the line may be sent in a frame."""
        return self.balance_j + self._free_j if self.ramped is False else inf

    def forgive(self) -> None:
        """While the force is ramped the line is moved by a hand that feels less of it: what that takes is not asked back."""
        lacking = -self._free_j - self.balance_j
        if lacking > 0.0:
            self._cut_j -= lacking
            self.balance_j += lacking

    def limit(self, force_n: Sequence[float]) -> Sequence[float]:
        """The force that the balance pays for, in the direction of `force_n`: it fades as the reserve is used."""
        left_j = self.balance_j + self._fade_end_j
        size = hypot(*force_n) if len(force_n) > 1 else abs(force_n[0])
        if size * FADE * self._most_step_m <= left_j:
            return force_n
        self.controlled += 1
        scale = max(0.0, left_j) * self._per_joule / size
        return [scale * force for force in force_n]

    def guard(self, force_n: tuple[float, ...]) -> tuple[float, ...]:
        """The same for the force as ramps and slopes left it, without fading: the bound itself."""
        left_j = max(0.0, self.balance_j + self.reserve_j)
        most_n = left_j / self._most_step_m
        size = hypot(*force_n) if len(force_n) > 1 else abs(force_n[0])
        if size <= most_n:
            return force_n
        most_n = max(most_n, 2.0 * sqrt(self._damping * left_j / self._tick_s))
        if size <= most_n:
            return force_n
        self.controlled += 1
        scale = most_n / size
        return tuple([scale * force for force in force_n])

    @property
    def resting(self) -> bool:
        """Whether the force is let go because it oscillated, or sat at its limit."""
        return self._rest_left > 0

    @property
    def goes_on(self) -> bool:
        """Whether letting go has not helped."""
        return len(self._rests) > MOST_RESTS

    def elapse(self) -> None:
        """One tick has passed, with force or without."""
        self._tick += 1
        if self._rest_left:
            self._rest_left -= 1

    def rearm(self) -> None:
        """Forget what led to a fault; the impedance that was found stays."""
        self._rests.clear()
        self._rest_left = 0
        self.detector.forget()

    def trouble(self) -> str:
        """Begin a rest, and return why: "oscillation", "limit"; "" where there is no reason to."""
        detector = self.detector
        found = "oscillation" if detector.oscillates else "limit" if detector.at_limit else ""
        if found:
            self.oscillates = True
            self._rest_left = self._rest_ticks
            self._rests = [tick for tick in self._rests if self._tick - tick < self._goes_on_ticks] + [self._tick]
            detector.forget()
        return found

    def watch(
        self, force_n: Sequence[float], limited: bool, local: Sequence[float], mean_mps: Sequence[float]
    ) -> None:
        """See the force that goes to the motors, once a tick, and adapt the impedance."""
        self.ticks += 1
        self.limited += limited
        self.most_fast = max(self.most_fast, len(self.detector._fast))
        carried, record = self.carried_nspm, self._record_nspm
        if self.detector.add(force_n, limited, local, mean_mps):
            self._most_nspm = min(self._most_nspm, max(LEAST * record, BELOW * carried))
            self.carried_nspm = max(LEAST * record, DOWN * carried)
            self.fed += 1
        elif carried < record:
            self._most_nspm = min(record, self._trust * self._most_nspm)
            self.carried_nspm = min(self._most_nspm, self._up * carried)

    def account(self) -> DeviceAccount:
        """What to say of it at the end."""
        ticks = max(1, self.ticks)
        return DeviceAccount(
            oscillates=self.oscillates,
            at_limit=self.limited / ticks,
            controlled=self.controlled / ticks,
            leak_j=max(0.0, -self.least_j),
            margin_j=self.least_j + self.reserve_j,
        )
