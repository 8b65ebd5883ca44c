"""The client's end of the baseline: virtual coupling, no waves (theory section 5; P Fig. 6).

F = K (x - x_o) + B (xdot - xdot_o) at the device rate: x, xdot place and velocity of the tool, x_o, xdot_o those of the
object as received last.
"""

from collections.abc import Sequence
from math import inf

from cogrip.client.coupling.interface import LatestStateCoupling
from cogrip.client.rows.delay_line import DelayLine
from cogrip.client.rows.springs import spring_j
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Row
from cogrip.protocol.line.energy_reserve import EnergyReserve
from cogrip.protocol.line.energy_sums import CompensatedSum
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.handle import Handle
from cogrip.protocol.wire.messages import State, encode


class VirtualCoupling(LatestStateCoupling):
    """A spring and a damper at the device rate, to the newest object state received."""

    def __init__(self, seat: SeatSettings) -> None:
        axes = seat.object.axes
        super().__init__(seat)
        self._stiffness = seat.coupling.stiffness_npm
        self._damping = seat.coupling.damping_nspm
        self._given_j = CompensatedSum()
        self._rendered_npm = self._stiffness
        self._rendered_nspm = self._damping
        self._stretch: list[float] | None = None  # hand to object at the tick that is held now [m]
        self._push = seat.side_sign if seat.one_sided else 0.0
        self._tick_s = seat.rates.tick_s
        self._last_force: Sequence[float] = (0.0,) * axes
        self._late: DelayLine[Sequence[float]] = DelayLine()  # forces
        self._port_j = CompensatedSum()
        self.down_margin_j: float | None = None
        self.down_reserve = EnergyReserve(seat.rates.network_hz)  # never seen: no ledger is kept of one direction

    @property
    def port_j(self) -> float:
        return self._port_j.value

    def given_j(self) -> float:
        """Energy that the object's motion put into the spring, and into the hand through the damper."""
        return self._given_j.value

    @property
    def stored_j(self) -> float:
        """Energy in the spring."""
        if self._stretch is None:
            return 0.0
        stiffness, peak = self._rendered_npm, self._peak_n
        return self.ramp_gain * add_floats([spring_j(stiffness, e, peak) for e in self._stretch])

    def set_latency(self, ticks: int) -> None:
        self._late.set_ticks(ticks, (0.0,) * len(self.sent))

    def elapse(self, mean_velocity_mps: Sequence[float], velocity_mps: Sequence[float], hold: float = 1.0) -> None:
        """Enter a tick. There is no wave that could release the object: `hold` changes nothing."""
        power = 0.0
        self._given_j.add(self._drag_w(mean_velocity_mps) * self._tick_s)
        for force, speed in zip(self._late.push(self._last_force), mean_velocity_mps, strict=True):
            power += force * speed
        self._port_j.add(power * self._tick_s)

    def elapse_absent(self) -> None:
        self._late.push(self._last_force)

    def _drag_w(self, velocity_mps: Sequence[float]) -> float:
        """Return the power that the object's velocity gives the hand through the damper [W]."""
        if self._stretch is None:
            return 0.0
        drag = zip(self._stretch, self.object_state[len(velocity_mps) :], velocity_mps, strict=True)
        return self.ramp_gain * self._rendered_nspm * add_floats([speed * own for e, speed, own in drag if e])

    def end_frame(self, spare_j: float = inf) -> int:
        self._number += 1
        return self.frame_ticks

    def start_frame(self) -> int:
        if self._receiver.pop() and self._receiver.latest:
            before, stretch = self.object_state, self._stretch
            self.object_state = state = self._receiver.latest.position_m + self._receiver.latest.velocity_mps
            if stretch is not None:
                self._given_j.add(-self.stored_j)
                self._stretch = [e and e + before[axis] - state[axis] for axis, e in enumerate(stretch)]
                self._given_j.add(self.stored_j)
        return self.frame_ticks

    def force(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> Sequence[float]:
        axes = len(position_m)
        if self._receiver.latest is None:
            return self._last_force
        state = self.object_state
        self._rendered_nspm = damping = min(self._damping, self.carried_nspm)
        self._rendered_npm = stiffness = min(self._stiffness, self.carried_nspm / self._lag_s if self._lag_s else inf)
        self.reduced = stiffness < self._stiffness or damping < self._damping
        self._stretch = stretch = [position_m[axis] - state[axis] for axis in range(axes)]
        relative = [velocity_mps[axis] - state[axes + axis] for axis in range(axes)]
        force = [stiffness * e + damping * v for e, v in zip(stretch, relative, strict=True)]
        self.local_n = [stiffness * position_m[axis] + damping * velocity_mps[axis] for axis in range(axes)]
        if self._push:
            inside = self._push * stretch[0] > 0.0
            force = [self._push * max(0.0, self._push * force[0]) if inside else 0.0] + [0.0] * (axes - 1)
            self._stretch = [stretch[0] if inside else 0.0] + [0.0] * (axes - 1)
        self._last_force = force
        return force

    def message(
        self, session: int, clock: MessageClock, now_ns: int, origin_m: Row, position_m: Row, velocity_mps: Sequence[float],
        handle: Handle | None = None,
    ) -> bytes:  # fmt: skip
        acknowledged = self._receiver.acknowledged
        return encode(State(
            session, self._number, position_m, tuple(velocity_mps), self.port_j, acknowledged, clock.stamp(now_ns), handle,
        ))  # fmt: skip

    def receive(self, message: State) -> bool:
        if not 2 * len(message.position_m) == 2 * len(message.velocity_mps) == len(self.object_state):
            return False
        return self._receiver.receive(message)
