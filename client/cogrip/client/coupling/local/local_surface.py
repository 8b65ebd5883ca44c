"""Surfaces that a client renders itself, along the first axis: a wall, and a face of a free object (theory section 7.7).

Symbols, along one axis: x hand, p surface [m], v_p its velocity [m/s], s direction in which this person pushes (+1, -1),
d = s (x - p) depth, K, B spring and damper, U = K max(d, 0)^2 / 2 energy of the spring [J], T_c tick [s].

    F = s max(0, K d + B s (xdot - v_p))  where d > 0, else 0

A surface that is fixed (`Wall`) has no line behind it: delay, jitter and loss change nothing that the hand feels. Where it
is to be elsewhere, because the wall has moved or the hand is found inside it, it goes there as far as that costs no more than
the contact has dissipated (`contact_spring`).

A face of a free object (`Face`) is a copy of a part m of its mass, which only the contact pushes; behind it is the wave
line, of impedance b, returning wave w. A tick of the copy is an implicit midpoint, exact in energy for any m, b, T_c:

    m (v' - v) / T_c = F - F_line      F_line = b v_p - sqrt(2b) w      v_p = (v + v') / 2      u = sqrt(2b) v_p - w
"""

from collections.abc import Sequence
from math import inf

from cogrip.client.coupling.local.local_contact import Contact, LocalCoupling
from cogrip.devices.device import MOST_SLOPE_NPS, Capability
from cogrip.protocol.line.energy_sums import CompensatedSum
from cogrip.protocol.settings.seat import SeatSettings

AT_SLOPE = 0.9  # A force that rises by this part of the slope limit is held by it: motors also round forces.
RETURN_S = 0.05  # time constant with which a face that nobody touches goes to where the object is


class Surface(Contact):
    """A surface that is touched along the first axis. `surface_m` is p, None until the object's place is known."""

    def __init__(self, seat: SeatSettings, line: LocalCoupling) -> None:
        super().__init__(seat, line)
        self._side = seat.side_sign
        self.surface_m: float | None = None
        self._speed = 0.0  # v_p
        self._law_n = self._behind_n = 0.0  # F at the last tick, along s; how far the motors are behind it
        self._held_n, self._slope_n = (
            0.0,
            inf,
        )  # force that they held in the last tick, along s; what it rises by at most

    def go_on_from(self, before: Contact) -> None:
        super().go_on_from(before)
        self.surface_m = before.surface_m if isinstance(before, Surface) else None

    @property
    def stored_j(self) -> float:
        return self.spring.stored_j(self._depth(), self._line.ramp_gain)

    def fit(self, record: Capability, lag_s: float) -> None:
        super().fit(record, lag_s)
        self._slope_n = min(record.slew_nps, MOST_SLOPE_NPS) * self._tick_s

    def elapse(self, applied_n: Sequence[float], mean_velocity_mps: Sequence[float]) -> None:
        line = self._line
        before_n, self._held_n = self._held_n, self._side * applied_n[0]
        self._behind_n = 0.0
        if self._held_n - before_n > AT_SLOPE * self._slope_n and line.ramp_gain == 1.0:
            cut_n = self._side * line.cut_n[0] if line.cut_n is not None else 0.0
            self._behind_n = max(0.0, self._law_n - self._held_n - cut_n)
        self._move(applied_n, mean_velocity_mps)

    def _depth(self) -> float:
        """Return max(d, 0)."""
        if self.position_m is None or self.surface_m is None:
            return 0.0
        return max(0.0, self._side * (self.position_m[0] - self.surface_m))

    def force(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> list[float]:
        side, zero, spring, line = self._side, [0.0] * len(position_m), self.spring, self._line
        spring.carry(line.carried_nspm)
        line.reduced = spring.reduced
        self.position_m = tuple(position_m)
        self._yield(position_m[0])
        if not self._behind_n:
            self._place(position_m[0])
        depth = self._depth()
        self.proxy_m = (position_m[0] - side * depth, *position_m[1:])
        law = 0.0
        if depth > 0.0:
            law = max(0.0, spring.stiffness * depth + spring.damping * side * (velocity_mps[0] - self._speed))
        self._law_n = law
        line.local_n = [spring.watched * side * law, *zero[1:]]
        return [side * law, *zero[1:]]

    def _yield(self, hand_m: float) -> None:
        """Let the surface go with the hand where the depth has not been paid for, or the motors cannot follow the law.

        A force that rises by the slope limit is behind its law, and would go on to rise as the hand is pushed out: the hand
        would be thrown. So the surface yields by what the motors are behind.
        """
        depth = self._depth()
        if self._behind_n and self.spring.stiffness:
            depth = max(0.0, depth - self._behind_n / self.spring.stiffness)
            self.surface_m = hand_m - self._side * depth
        if (kept := self.spring.kept_m(depth, self._line.ramp_gain)) < depth:
            self.surface_m = hand_m - self._side * kept

    def _move(self, applied_n: Sequence[float], mean_velocity_mps: Sequence[float]) -> None:
        """Enter a tick of what is behind the surface, and of the line."""
        raise NotImplementedError

    def _place(self, hand_m: float) -> None:
        """Put the surface where it should be, as far as energy allows."""
        raise NotImplementedError


class Wall(Surface):
    """A wall that nobody moves."""

    @property
    def pressed(self) -> tuple[float, Sequence[float]]:
        """Depth in the wall where it should be: one that has yielded is softer."""
        middle = self._line.object_state[0]
        hand = middle if self.position_m is None else self.position_m[0]
        return self._side * (hand - middle), (self._side, *(0.0,) * (len(self._line.sent) - 1))

    def given_j(self, line_j: float) -> float:
        return 0.0

    def pending_j(self, line_j: float) -> float:
        return 0.0

    def spare_j(self, spare_j: float) -> float:
        """Send back what came, and no more: nothing of the line is the contact's."""
        return self._line.energy.used_now_j

    def _move(self, applied_n: Sequence[float], mean_velocity_mps: Sequence[float]) -> None:
        self.spring.gate.saved_j += applied_n[0] * mean_velocity_mps[0] * self._tick_s
        self._line.enter_line((0.0,) * len(applied_n))

    def _place(self, hand_m: float) -> None:
        """A wall that nobody has spoken of is where walls are: in the middle."""
        side, target = self._side, self._line.object_state[0]
        if self.surface_m is None:
            self.surface_m = hand_m
        depth, wanted = self._depth(), side * (hand_m - target)
        if depth == wanted or depth == 0.0 >= wanted:
            self.surface_m = target
            return
        goal = max(wanted, 0.0)
        gate = self.spring.gate
        grown = gate.grown(depth, goal, self.spring.stiffness)
        if grown != depth or not depth:
            self.surface_m = target if grown == goal else hand_m - side * grown
        gate.move(self.stored_j)


class Face(Surface):
    """A face of a free object: a copy of a part of its mass.

    worked_j  work of the contact on the copy
    lined_j   energy that went from the copy into the line, tick by tick
    """

    def __init__(self, seat: SeatSettings, line: LocalCoupling) -> None:
        super().__init__(seat, line)
        self._mass = seat.copy_kg
        self._worked, self._lined = CompensatedSum(), CompensatedSum()

    def given_j(self, line_j: float) -> float:
        """Energy that copy and line gave the contact: what the copy puts into the line is the line's own to send."""
        return line_j + self._lined.value - self._worked.value

    def _move(self, applied_n: Sequence[float], mean_velocity_mps: Sequence[float]) -> None:
        line, gain = self._line, self._line.down.gain
        b, root, tick_s = gain * gain * line.b, gain * line.root, self._tick_s
        force, wave, zero = applied_n[0], line.returning[0], (0.0,) * (len(applied_n) - 1)
        inertia = 2.0 * self._mass / tick_s
        mid = (inertia * self._speed + force + root * wave) / (inertia + b)
        self._speed = 2.0 * mid - self._speed
        if self.surface_m is not None:
            self.surface_m += tick_s * mid
        self._worked.add(force * mid * tick_s)
        self.spring.gate.saved_j += force * (mean_velocity_mps[0] - mid) * tick_s
        self._lined.add((b * mid - root * wave) * mid * tick_s)
        line.enter_line((mid, *zero))

    def _place(self, hand_m: float) -> None:
        """Let a face that nobody touches go to where the object is: a spring that stores nothing makes nothing."""
        if self._line.newest < 0:
            return
        side, target = self._side, self._line.object_state[0]
        if self.surface_m is None:
            self.surface_m = hand_m if side * (hand_m - target) > 0.0 else target
        if self._depth() > 0.0:
            return
        wanted = self.surface_m + (target - self.surface_m) * self._tick_s / RETURN_S
        self.surface_m = max(wanted, hand_m) if side > 0.0 else min(wanted, hand_m)
