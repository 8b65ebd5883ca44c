"""Port of time-domain passivity control: at the object comes out at most what has gone in at the hand.

Per axis, energies in J: F force of the coupling [N], w velocity of the proxy [m/s], T frame [s].

    received  what the client says has gone in there (its newest message)
    out       sum of max(0, F w T): taken out here
    in        sum of max(0, -F w T): gone in here, reported to the client
    W         received - out, what may still come out: the world's step keeps to it, and to E(0) = LENT_J beyond;
              `up_margin_j` is the least of it
"""

from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Row
from cogrip.protocol.laws.passivity_control import CHARGE_DOWN_J, LENT_J
from cogrip.protocol.line.energy_sums import CompensatedSum
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.messages import Power, encode
from cogrip.server.ports.seat_limits import LineEnergyLimiter, SeatLimits
from cogrip.server.ports.state_port import LatestStatePort


class PowerPort(LatestStatePort[Power]):
    """See `Port`. To the world goes the proxy's aim and the energy for it, back go force and energy.

    up_reserve is W, the least of all axes.
    """

    def __init__(self, seat: SeatSettings, limits: SeatLimits, power_left: float = 1.0) -> None:
        super().__init__(seat, limits)
        axes = self.axes
        self._frame_s = frame_s = seat.rates.frame_s
        self._energy = LineEnergyLimiter(frame_s, limits, power_left)
        self._lent = LENT_J / axes
        self._received = self._pace = self._still = (0.0,) * axes
        self._in = [CompensatedSum() for _ in range(axes)]
        self._out = [CompensatedSum() for _ in range(axes)]
        self._force = (0.0,) * axes

    def set_limits(self, limits: SeatLimits) -> None:
        super().set_limits(limits)
        self._energy.set_limits(limits)

    def receive(self, message: Power, now_ns: int) -> bool:
        return message.of_axes(self.axes) and self._accept(message)

    @property
    def neutral(self) -> Row:
        """No force, and a proxy that stands."""
        return (0.0,) * (2 * self.axes)

    def _origin(self, message: Power) -> Row:
        moved = [speed * self._frame_s for speed in message.velocity_mps]
        return tuple([place - step for place, step in zip(message.position_m, moved, strict=True)])

    def pop(self, frames: int) -> Row:
        """Return the proxy's aim [m], its velocity towards it [m/s], the energy that may come out [J], and how full the
        client's own energy reserve is, of 1: each for all axes."""
        newest = self._pop(frames)
        self.up_reserve.elapse(frames)
        assert newest is not None  # the seat is on the object since its first message
        self._received = newest.entered_j
        left = [got + self._lent - out.value for got, out in zip(newest.entered_j, self._out, strict=True)]
        there = [put.value - taken for put, taken in zip(self._in, newest.taken_j, strict=True)]
        filled = tuple([min(1.0, max(0.0, energy) / CHARGE_DOWN_J) for energy in there])
        self._pace = newest.velocity_mps if self._fresh else self._still
        return newest.position_m + self._pace + self._energy.limit(left) + filled

    def push(self, row: Row) -> None:
        """Send force [N] and velocity of the proxy [m/s], each for all axes."""
        axes, frame_s = self.axes, self._frame_s
        self._number += 1
        self._force = row[:axes]
        net = asked = 0.0
        for axis, (force, speed) in enumerate(zip(self._force, row[axes:], strict=True)):
            energy = force * speed * frame_s
            net += energy
            asked = max(asked, force * self._pace[axis] * frame_s)
            if energy > 0.0:
                self._out[axis].add(energy)
                received = self._received[axis]
                margin = received - self._out[axis].value + self._rounding * received
                if self.up_margin_j is None or margin < self.up_margin_j:
                    self.up_margin_j = margin
            elif energy < 0.0:
                self._in[axis].add(-energy)
        self.up_reserve.update(
            min([left + self._rounding * got for left, got in zip(self.left_j, self._received, strict=True)])
        )
        self._energy.book(net, asked)

    @property
    def made_j(self) -> float:
        return add_floats([energy.value for energy in self._in])

    @property
    def used_j(self) -> float:
        return add_floats([energy.value for energy in self._out])

    def rounding_j(self) -> float:
        return self._rounding * (add_floats(self._received) + self.made_j)

    @property
    def left_j(self) -> Row:
        """W of each axis."""
        return tuple([got - out.value for got, out in zip(self._received, self._out, strict=True)])

    @property
    def power_left(self) -> float:
        return self._energy.fullness

    @property
    def limited(self) -> dict[str, int]:
        return {**self._states.counts, **self._energy.counts}

    def message(self, session: int, clock: MessageClock, now_ns: int, object_state: Row, port_j: float) -> bytes:
        axes = self.axes
        entered, taken = [tuple([energy.value for energy in direction]) for direction in (self._in, self._out)]
        return encode(Power(
            session, self._number, object_state[:axes], object_state[axes:], self._force, entered, taken, port_j,
            self._receiver.acknowledged, clock.stamp(now_ns), edges=self.handle.taken,
        ))  # fmt: skip
