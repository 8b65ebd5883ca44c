"""The client's end of time-domain passivity control (Hannaford and Ryu 2002; Ryu, Artigas and Preusche 2010).

The hand's motion goes up, force comes down, and a passivity observer and controller keep the energy that comes out to the hand
below what has gone in at the object.

Symbols, per axis: F force on the hand in a tick [N], y its mean velocity in the tick [m/s], T tick [s], b `impedance_nspm`.
Energies in J, per axis:

    in    what the hand has put in, sum of max(0, F y T), less what is kept: sent to the server
    out   what it has taken out, sum of max(0, -F y T)
    S     what has gone in at the object, by the server's report
    kept  of the hand's own energy, up to a reserve: pays for what the controller foresaw wrongly
    W     = S + kept - out, what may still come out; `down_margin_j` is the least of it

Observed is the force that the device gave, after all limits, and the displacement that it was given over: exact.
Controlled is the coming tick, of which there is only a guess: what the hand takes beyond it comes from what is kept.
docs/decisions/0011-methods.md has the equations, and what each constant is for.
"""

from collections.abc import Sequence
from math import inf

from cogrip.client.coupling.interface import LatestStateCoupling, PortEnergy
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Row
from cogrip.protocol.laws.passivity_control import CHARGE_UP_J, LENT_J
from cogrip.protocol.line.energy_reserve import EnergyReserve
from cogrip.protocol.line.energy_sums import CompensatedSum, rounding_fraction
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.handle import Handle
from cogrip.protocol.wire.messages import Power, encode

CHARGE_SHARE = 0.5  # damper by which a hand puts in energy that the server lacks, as a fraction of b
RESERVE_J = 4e-3  # least reserve kept of the hand's energy; more where a larger force may go astray by more
KEPT_SHARE = 0.5  # fraction of the hand's energy that is kept until the reserve is full
ASTRAY_MPS = 0.5  # error of the velocity that is guessed for the coming tick
HORIZON_S = 8.0 / 1024.0  # time over which the energy left is spread, so that a force that runs out of energy fades
SOFT_NPS = 410.0  # largest slope of the force while the controller holds it


class PassivityControl(LatestStateCoupling):
    """Observer of the energy at the hand, and controller of the force by what it has observed."""

    def __init__(self, seat: SeatSettings) -> None:
        axes, rates = seat.object.axes, seat.rates
        super().__init__(seat)
        self._tick_s = tick_s = rates.tick_s
        self._frame_s = rates.frame_s
        self._most_damping = seat.coupling.impedance_nspm
        self._charging = CHARGE_SHARE * self._most_damping
        self._astray_m = ASTRAY_MPS * tick_s
        self._horizon = max(1.0, HORIZON_S / tick_s)  # ticks
        self._soft_n = SOFT_NPS * tick_s
        self._lent = LENT_J / axes
        self._in = [CompensatedSum() for _ in range(axes)]
        self._left = [CompensatedSum() for _ in range(axes)]  # W
        self._reserve = [RESERVE_J] * axes
        self._received: Sequence[float] = (0.0,) * axes  # S
        self._taken: Sequence[float] = (0.0,) * axes  # energy that has come out at the object, as reported
        self._wanted: Sequence[float] = (0.0,) * axes  # the server's force
        self._given = [0.0] * axes  # force of the last tick, less the damper that pays a deficit
        self._held = [False] * axes  # the controller held it
        self._last: Sequence[float] = (0.0,) * axes  # y of the last tick
        self._moved = [0.0] * axes  # displacement of the proxy since frame 0 [m]
        self._border = [0.0] * axes  # the same at the last frame border
        self._speed: tuple[float, ...] = (0.0,) * axes  # mean of the last frame
        self._frame = 0
        self._loop: float | None = None
        self.energy = PortEnergy()
        self._rounding = rounding_fraction(rates.ticks_per_frame)
        self._slack_j = 0.0  # what rounding alone can put W out by
        self.down_reserve = EnergyReserve(rates.network_hz)  # W, the least of all axes
        self.controlled = 0  # ticks and axes in which the controller held the force

    @property
    def port_j(self) -> float:
        return self.energy.port_j()

    @property
    def left_j(self) -> tuple[float, ...]:
        """W of each axis."""
        return tuple([left.value for left in self._left])

    def given_j(self) -> float:
        """Energy that has gone in at the object, less what was sent as gone in here."""
        return add_floats(self._received) - add_floats([energy.value for energy in self._in])

    def elapse(self, mean_velocity_mps: Sequence[float], velocity_mps: Sequence[float], hold: float = 1.0) -> None:
        """Enter a tick. With hold < 1 the proxy comes to a stop, and claims no energy on the way."""
        tick_s, moved, force = self._tick_s, self._moved, self.applied_n
        self._last = mean_velocity_mps
        for axis, speed in enumerate(mean_velocity_mps):
            step = speed * tick_s
            energy = force[axis] * step
            if hold != 1.0:
                step *= hold
                energy = min(0.0, energy)
            moved[axis] += step
            if energy > 0.0:
                self._put_in(axis, energy)
            elif energy < 0.0:
                self._take_out(axis, -energy)

    def _put_in(self, axis: int, energy_j: float) -> None:
        """Enter energy from the hand. A part is kept until the reserve is full; a deficit is paid first."""
        self.energy.made_now_j += energy_j
        left = self._left[axis].value
        reserve = self._reserve[axis]
        if left < reserve:
            deficit = max(0.0, -left)
            kept = min(energy_j, deficit + min(reserve - left - deficit, KEPT_SHARE * max(0.0, energy_j - deficit)))
            self._left[axis].add(kept)
            energy_j -= kept
        self._in[axis].add(energy_j)

    def _take_out(self, axis: int, energy_j: float) -> None:
        """Enter energy to the hand."""
        self.energy.used_now_j += energy_j
        self._left[axis].add(-energy_j)
        margin = self._left[axis].value + self._slack_j
        if self.down_margin_j is None or margin < self.down_margin_j:
            self.down_margin_j = margin
        if margin < self.down_reserve.least_j:
            self.down_reserve.least_j = margin

    def end_frame(self, spare_j: float = inf) -> int:
        self.energy.end_frame()
        self._number += 1
        rate = 1.0 / self._frame_s
        self._speed = tuple([(now - then) * rate for now, then in zip(self._moved, self._border, strict=True)])
        self._border = self._moved.copy()
        return self.frame_ticks

    def start_frame(self) -> int:
        """Go by the newest force and energy from now on, by the last ones where none came."""
        self._frame += 1
        before = self._receiver.acknowledged
        if self._receiver.pop() and self._receiver.latest is not None:
            self._update(self._receiver.latest, before)
        self.down_reserve.elapse()
        self.down_reserve.update(min(self.left_j) + self._slack_j)
        return self.frame_ticks

    def _update(self, newest: Power, before: int) -> None:
        """Go by a message. before: number of the one before it."""
        if newest.number != before:  # what was missed comes at once: softly
            self._held = [True] * len(self._held)
        for axis, (now, then) in enumerate(zip(newest.entered_j, self._received, strict=True)):
            self._left[axis].add(now - then)
        self._wanted, self._received, self._taken = newest.force_n, newest.entered_j, newest.taken_j
        self._slack_j = self._rounding * (self.energy.used_j + add_floats(newest.entered_j))
        self._reserve = [max(RESERVE_J, abs(force) * self._astray_m) for force in newest.force_n]
        self.object_state = newest.position_m + newest.velocity_mps
        if newest.acknowledged:
            self._loop = float(self._frame - newest.acknowledged)

    def force(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> Sequence[float]:
        """Return the server's force and the charging damper, as far as W pays for them, and a damper that pays a deficit."""
        tick_s = self._tick_s
        charging, most = min(self._charging, self.carried_nspm), min(self._most_damping, self.carried_nspm)
        self.reduced = most < self._most_damping
        force, local = [], []
        for axis, speed in enumerate(velocity_mps):
            damper = 0.0
            law = self._wanted[axis]
            there = self._in[axis].value - self._taken[axis]  # what the server may still take
            if there < CHARGE_UP_J:
                damper = charging * (1.0 - max(0.0, there) / CHARGE_UP_J)
                law += damper * speed
            given = self._control(axis, law, speed)
            left = self._left[axis].value
            if left < 0.0:
                square = speed * speed * tick_s
                paying = most if most * square <= -left else -left / square
                damper += paying
                given += paying * speed
            local.append(damper * speed)
            force.append(given)
        self.local_n = local
        return force

    def _control(self, axis: int, law: float, speed: float) -> float:
        """Return the part of the force `law` that may be given, with a limited slope."""
        left, given, last = self._left[axis].value, self._given[axis], self._last[axis]
        guess = speed if law * (speed - last) < 0.0 else last  # the one that takes more out
        taken = -law * guess * self._tick_s  # in the coming tick
        paid = max(0.0, left - self._reserve[axis]) / self._horizon
        held = taken > paid
        wish = law * (paid / taken) if held else law
        if held or self._held[axis]:
            step = wish - given
            if abs(step) > self._soft_n:
                wish = given + (self._soft_n if step > 0.0 else -self._soft_n)
                held = True
        self._held[axis] = held
        bound = max(0.0, left + self._lent) / self._astray_m  # what is left pays for, over what the guess may miss
        if abs(wish) > bound:
            wish = bound if wish > 0.0 else -bound
            held = True
        self._given[axis] = wish
        self.controlled += held
        return wish

    def message(
        self, session: int, clock: MessageClock, now_ns: int, origin_m: Row, position_m: Row, velocity_mps: Sequence[float],
        handle: Handle | None = None,
    ) -> bytes:  # fmt: skip
        """Return the message of the frame that ended.

        Its position_m is the sum of the displacements entered: it stands still where nobody holds. Its taken_j is such
        that `received` - taken_j is what may still be taken of what the server sends.
        """
        place = tuple([start + moved for start, moved in zip(origin_m, self._border, strict=True)])
        axes = zip(self._received, self._reserve, self._left, strict=True)
        taken = tuple([max(0.0, got + reserve - left.value) for got, reserve, left in axes])
        entered = tuple([energy.value for energy in self._in])
        return encode(Power(
            session, self._number, place, self._speed, tuple(self.applied_n), entered, taken, self.port_j,
            self._receiver.acknowledged, clock.stamp(now_ns), handle,
        ))  # fmt: skip

    def receive(self, message: Power) -> bool:
        if not message.of_axes(len(self._in)):
            return False
        return self._receiver.receive(message)

    def loop_frames(self) -> float | None:
        return self._loop
