"""Contact rendered by the client itself, at the device rate (`coupling.kind = "local"`; theory section 7.7).

Symbols, along one axis: x hand, p surface [m], v_p its velocity [m/s], s direction in which this person pushes (+1, -1),
d = s (x - p) depth, K, B spring and damper, U = K max(d, 0)^2 / 2 energy of the spring [J], T_c tick [s].

    F = s max(0, K d + B s (xdot - v_p))  where d > 0, else 0

A surface that is fixed (`LocalWall`) has no line behind it: delay, jitter and loss change nothing that the hand feels. Where it
is to be elsewhere, because the wall has moved or the hand is found inside it, it goes there as far as that costs no more than
the contact has dissipated (an energy gate: passive set-position modulation, Lee and Huang, IEEE T-RO 2010):

    each tick E += F (x_{k+1} - x_k) - (U_{k+1} - U_k), at most MOST_SAVED_J      p+ nearest to its goal with U(p+) - U(p) <= E

While the force is ramped by a gain g the spring holds g U: that is the U of E. g grows without anybody's work, so a surface of
whatever kind yields then: it goes with the hand as far as keeps E >= -LENT_J (`ContactGate`). After a fault nothing is paid.

A face of a free object (`LocalFaces`) is a copy of a part m of its mass, which only the contact pushes; behind it is the wave
line, of impedance b, returning wave w. A tick of the copy is an implicit midpoint, exact in energy for any m, b, T_c:

    m (v' - v) / T_c = F - F_line      F_line = b v_p - sqrt(2b) w      v_p = (v + v') / 2      u = sqrt(2b) v_p - w
"""

from collections.abc import Sequence
from math import inf, sqrt
from operator import mul

from cogrip.client.coupling.interface import Coupling, Row, spring_j, stretch_m
from cogrip.client.coupling.wave_coupling import WaveCoupling
from cogrip.client.hand.velocity import largest_impedance
from cogrip.devices.device import MOST_SLOPE_NPS, Capability
from cogrip.machine.addition import add_floats
from cogrip.protocol.axes import PLACES
from cogrip.protocol.line.energy_sums import CompensatedSum
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.clock import Clock
from cogrip.protocol.wire.handle import Handle

MOST_SAVED_J = 1e-3  # largest E
LENT_J = 1e-4
"""Depth below 0 to which E may fall while the force is ramped: a touch loads the spring before any force has worked."""
MOST_STEP_N = 0.5  # largest change of the force in a tick by a surface that moves
AT_SLOPE = 0.9  # A force that rises by this part of the slope limit is held by it: motors also round forces.
RETURN_S = 0.05  # time constant with which a face that nobody touches goes to where the object is


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


class LocalCoupling(WaveCoupling):
    """Contact here, the wave line behind it.

    proxy_m  where the hand is without the depth of contact, shape (places,)
    """

    def __init__(self, seat: SeatSettings) -> None:
        super().__init__(seat)
        self._side = seat.side_sign
        self._asked_npm, self._asked_nspm = seat.coupling.stiffness_npm, seat.coupling.damping_nspm
        self._lag_s, self._peak_n, self._record_nspm = 0.0, inf, inf  # of the device
        self._stiffness, self._damping = self._asked_npm, self._asked_nspm  # K and B as they are rendered now
        self._carried, self._carries_less = -1.0, False  # `carried_nspm` they are for; whether it leaves less of them
        self._watched = 1.0  # factor on a contact's force that makes it what the device port watches
        self._hand_j = CompensatedSum()  # work of the hand
        self._position: Row | None = None  # of the hand at this tick
        self.gate = ContactGate()
        self.proxy_m: Row = (0.0,) * min(seat.object.axes, PLACES)

    def fit(self, record: Capability, lag_s: float) -> None:
        super().fit(record, lag_s)
        self._lag_s, self._peak_n, self._carried = lag_s, record.peak_force_n, -1.0
        self._record_nspm = largest_impedance(record, self._tick_s).impedance_nspm

    def go_on_from(self, before: Coupling) -> None:
        super().go_on_from(before)
        if isinstance(before, LocalCoupling):
            self.proxy_m, self.gate, self.ramp_gain = before.proxy_m, before.gate, before.ramp_gain

    def entered_j(self) -> float:
        return self._hand_j.value

    def gap(self) -> bool:
        return False  # the force is made here

    def elapse(self, mean_velocity_mps: Sequence[float], velocity_mps: Sequence[float], hold: float = 1.0) -> None:
        applied = self.applied_n
        self._hand_j.add(add_floats(map(mul, applied, mean_velocity_mps)) * self._tick_s)
        self._move(applied, mean_velocity_mps)

    def elapse_absent(self) -> None:
        zero = (0.0,) * len(self.sent)
        if self._position is not None:
            self._release()
        self._move(zero, zero)

    def _release(self) -> None:
        """Leave what the hand has touched."""
        self._position = None
        self.gate.begin(0.0)

    def _leave_line(self) -> None:
        """Enter a tick in which nothing is sent, and what comes is absorbed."""
        super().elapse_absent()

    def _enter_line(self, velocity_mps: Sequence[float]) -> None:
        """Enter a tick of the line, whose port has moved at this mean velocity."""
        super().elapse(velocity_mps, velocity_mps)

    def _move(self, applied_n: Sequence[float], mean_velocity_mps: Sequence[float]) -> None:
        """Enter a tick of what is behind the contact, and of the line."""
        raise NotImplementedError

    def set_latency(self, ticks: int) -> None:
        """The line begins behind the contact: its own ticks are never late."""

    def _spring_j(self, depth_m: float) -> float:
        """Return g U."""
        return self.ramp_gain * spring_j(self._stiffness, depth_m, self._peak_n)

    def _kept_m(self, depth_m: float) -> float:
        """Return the depth that a contact may keep: less where it has not been paid for, none where there is no force."""
        stored, gain = self._spring_j(depth_m), self.ramp_gain
        kept = self.gate.settle(stored, gain < 1.0)
        if gain == 0.0:
            return 0.0
        return depth_m if kept == stored else stretch_m(self._stiffness, kept / gain, self._peak_n)

    def _carry(self) -> float:
        """Set the stiffness to what the device carries; return the damping that it does.

        Where the device port takes from the damper, the spring is reduced with it: a spring that keeps its stiffness while
        its damper goes rings the more. The port watches the contact as it would be with all of both (`DevicePort.watch`).
        """
        carried = self.carried_nspm
        if carried == self._carried:  # as mostly
            self.reduced = self._carries_less
            return self._damping
        self._carried, whole = carried, min(self._asked_nspm, self._record_nspm)
        self._damping = min(whole, carried)
        kept = self._damping / whole if whole else 1.0
        self._stiffness = min(kept * self._asked_npm, carried / self._lag_s if self._lag_s else inf)
        self.reduced = self._carries_less = self._stiffness < self._asked_npm or self._damping < self._asked_nspm
        left = min(kept, self._stiffness / self._asked_npm) if self._asked_npm else kept
        self._watched = min(1.0, carried / self._record_nspm / left) if self._record_nspm < inf and left else 1.0
        return self._damping

    def message(
        self, session: int, clock: Clock, now_ns: int, origin_m: Row, position_m: Row, velocity_mps: Sequence[float],
        handle: Handle | None = None,
    ) -> bytes:  # fmt: skip
        place = position_m + self.proxy_m
        return super().message(session, clock, now_ns, origin_m, place, velocity_mps, handle)


class LocalFace(LocalCoupling):
    """Base of what is touched along the first axis: one surface. `surface_m` is p, None until the object's place is known."""

    def __init__(self, seat: SeatSettings) -> None:
        super().__init__(seat)
        self.surface_m: float | None = None
        self._speed = 0.0  # v_p
        self._law_n = self._behind_n = 0.0  # F at the last tick, along s; how far the motors are behind it
        self._held_n, self._slope_n = (
            0.0,
            inf,
        )  # force that they held in the last tick, along s; what it rises by at most

    def go_on_from(self, before: Coupling) -> None:
        """Keep the surface where it is: what the hand presses on does not vanish under it."""
        super().go_on_from(before)
        self.surface_m = before.surface_m if isinstance(before, LocalFace) else None

    @property
    def stored_j(self) -> float:
        return self._spring_j(self._depth())

    def fit(self, record: Capability, lag_s: float) -> None:
        super().fit(record, lag_s)
        self._slope_n = min(record.slew_nps, MOST_SLOPE_NPS) * self._tick_s

    def elapse(self, mean_velocity_mps: Sequence[float], velocity_mps: Sequence[float], hold: float = 1.0) -> None:
        before_n, self._held_n = self._held_n, self._side * self.applied_n[0]
        self._behind_n = 0.0
        if self._held_n - before_n > AT_SLOPE * self._slope_n and self.ramp_gain == 1.0:
            cut_n = self._side * self.cut_n[0] if self.cut_n is not None else 0.0
            self._behind_n = max(0.0, self._law_n - self._held_n - cut_n)
        super().elapse(mean_velocity_mps, velocity_mps, hold)

    def _depth(self) -> float:
        """Return max(d, 0)."""
        if self._position is None or self.surface_m is None:
            return 0.0
        return max(0.0, self._side * (self._position[0] - self.surface_m))

    def force(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> list[float]:
        side, zero = self._side, [0.0] * len(position_m)
        damping = self._carry()
        self._position = tuple(position_m)
        self._yield(position_m[0])
        if not self._behind_n:
            self._place(position_m[0])
        depth = self._depth()
        self.proxy_m = (position_m[0] - side * depth, *position_m[1:])
        law = 0.0
        if depth > 0.0:
            law = max(0.0, self._stiffness * depth + damping * side * (velocity_mps[0] - self._speed))
        self._law_n = law
        self.local_n = [self._watched * side * law, *zero[1:]]
        return [side * law, *zero[1:]]

    def _yield(self, hand_m: float) -> None:
        """Let the surface go with the hand where the depth has not been paid for, or the motors cannot follow the law.

        A force that rises by the slope limit is behind its law, and would go on to rise as the hand is pushed out: the hand
        would be thrown. So the surface yields by what the motors are behind.
        """
        depth = self._depth()
        if self._behind_n and self._stiffness:
            depth = max(0.0, depth - self._behind_n / self._stiffness)
            self.surface_m = hand_m - self._side * depth
        if (kept := self._kept_m(depth)) < depth:
            self.surface_m = hand_m - self._side * kept

    def _place(self, hand_m: float) -> None:
        """Put the surface where it should be, as far as energy allows."""
        raise NotImplementedError


class LocalWall(LocalFace):
    """A wall that nobody moves."""

    @property
    def pressed(self) -> tuple[float, Sequence[float]]:
        """Depth in the wall where it should be: one that has yielded is softer."""
        hand = self.object_state[0] if self._position is None else self._position[0]
        return self._side * (hand - self.object_state[0]), (self._side, *(0.0,) * (len(self.sent) - 1))

    def given_j(self) -> float:
        return 0.0

    def pending_j(self) -> float:
        return 0.0

    def end_frame(self, spare_j: float = inf) -> int:
        """Send back what came, and no more: nothing of the line is the contact's."""
        return super().end_frame(self.energy.used_now_j)

    def _move(self, applied_n: Sequence[float], mean_velocity_mps: Sequence[float]) -> None:
        self.gate.saved_j += applied_n[0] * mean_velocity_mps[0] * self._tick_s
        zero = (0.0,) * len(applied_n)
        self._enter_line(zero)

    def _place(self, hand_m: float) -> None:
        """A wall that nobody has spoken of is where walls are: in the middle."""
        side, target = self._side, self.object_state[0]
        if self.surface_m is None:
            self.surface_m = hand_m
        depth, wanted = self._depth(), side * (hand_m - target)
        if depth == wanted or depth == 0.0 >= wanted:
            self.surface_m = target
            return
        goal = max(wanted, 0.0)
        grown = self.gate.grown(depth, goal, self._stiffness)
        if grown != depth or not depth:
            self.surface_m = target if grown == goal else hand_m - side * grown
        self.gate.move(self._spring_j(self._depth()))


class LocalFaces(LocalFace):
    """A face of a free object: a copy of a part of its mass.

    worked_j  work of the contact on the copy
    lined_j   energy that went from the copy into the line, tick by tick
    """

    def __init__(self, seat: SeatSettings) -> None:
        super().__init__(seat)
        self._mass = seat.copy_kg
        self._worked, self._lined = CompensatedSum(), CompensatedSum()

    def given_j(self) -> float:
        """Energy that copy and line gave the contact: what the copy puts into the line is the line's own to send."""
        return super().given_j() + self._lined.value - self._worked.value

    def _move(self, applied_n: Sequence[float], mean_velocity_mps: Sequence[float]) -> None:
        gain = self.down.gain
        b, root, tick_s = gain * gain * self._b, gain * self._root, self._tick_s
        force, wave, zero = applied_n[0], self.returning[0], (0.0,) * (len(applied_n) - 1)
        inertia = 2.0 * self._mass / tick_s
        mid = (inertia * self._speed + force + root * wave) / (inertia + b)
        self._speed = 2.0 * mid - self._speed
        if self.surface_m is not None:
            self.surface_m += tick_s * mid
        self._worked.add(force * mid * tick_s)
        self.gate.saved_j += force * (mean_velocity_mps[0] - mid) * tick_s
        self._lined.add((b * mid - root * wave) * mid * tick_s)
        row = (mid, *zero)
        self._enter_line(row)

    def _place(self, hand_m: float) -> None:
        """Let a face that nobody touches go to where the object is: a spring that stores nothing makes nothing."""
        if self.newest < 0:
            return
        side, target = self._side, self.object_state[0]
        if self.surface_m is None:
            self.surface_m = hand_m if side * (hand_m - target) > 0.0 else target
        if self._depth() > 0.0:
            return
        wanted = self.surface_m + (target - self.surface_m) * self._tick_s / RETURN_S
        self.surface_m = max(wanted, hand_m) if side > 0.0 else min(wanted, hand_m)
