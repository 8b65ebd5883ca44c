"""Port of the scheme with local models: a wave port whose client also reports its proxy.

In a scene the line takes hold of a tool only now and then, each time where the proxy was then (`worlds.local_scene`). Waves
that were made before the client knew of it would move the tool again by what it has moved already: they are absorbed, as are
those that come while it is clear, and their position deficit is written off. They are known by the clock reading that they
echo.
"""

from math import dist

from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES
from cogrip.protocol.line.energy_sums import CompensatedSum
from cogrip.protocol.line.received_waves import ReceivedWaves
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.clock import MessageClock
from cogrip.server.ports.seat_limits import FASTER, SeatLimits
from cogrip.server.ports.wave_port import WavePort


class LocalPort(WavePort):
    """proxy: of the newest frame [m], in the hand's own frame, as fast as the device's record allows; None before the first.

    Clear or engaged are the places of a tool. What its hand turns it by is the line's all the time.
    """

    def __init__(self, seat: SeatSettings, limits: SeatLimits, power_left: float = 1.0) -> None:
        super().__init__(seat, limits, power_left)
        self._frame_s = seat.rates.frame_s
        self._reach_m = FASTER * limits.speed_mps * self._frame_s  # in a frame
        self._reported: Row | None = None
        self._absorbed = CompensatedSum()
        self._always = not seat.object.traits.scene  # engaged
        self._engaged: Row = ()  # as told last
        self._told: Row = ()  # the engagement that was told last
        self._told_ns = 0  # when it was told first
        self._unaware = -1  # newest frame that was made before the client knew of it

    def set_limits(self, limits: SeatLimits) -> None:
        super().set_limits(limits)
        self._reach_m = FASTER * limits.speed_mps * self._frame_s

    def take_in(self, datagram: ReceivedWaves, now_ns: int) -> bool:
        axes, places, states = self.axes, min(self.axes, PLACES), datagram.states
        if states < places:
            return False
        newest = self._receiver.newest
        datagram.states = states - places
        taken = super().take_in(datagram, now_ns)
        datagram.states = states
        if not taken:
            return False
        if self._reported is None or self._receiver.newest > newest:
            self._reported = datagram.state_from(states - places, states)
        if datagram.echo_ns < self._told_ns:
            self._unaware = max(self._unaware, datagram.first + datagram.numbers // axes - 1)
        return True

    def pop(self, frames: int) -> Row:
        before, reported = self.proxy or self._reported, self._reported
        if before is not None and reported is not None:
            away, reach = dist(before, reported), frames * self._reach_m
            part = reach / away if away > reach else 1.0
            self.proxy = reported if part == 1.0 else toward(before, reported, part)
        wave, receiver = super().pop(frames), self._receiver
        if self._always or (self._engaged and receiver.acknowledged > self._unaware + 1):
            return wave
        absorbed, turning = wave[:PLACES], wave[PLACES:]
        self._absorbed.add(add_floats([value * value for value in absorbed]) * self._half_frame_s)
        self.absorbed_j = self._absorbed.value
        deficit = receiver.deficit[:PLACES]
        if any(deficit):
            receiver.write_off([*deficit, *(0.0,) * len(turning)])
        return (0.0,) * len(absorbed) + turning

    def message(self, session: int, clock: MessageClock, now_ns: int, object_state: Row, port_j: float) -> bytes:
        self._engaged = engaged = object_state[2 * self.axes :]
        if engaged and engaged != self._told:
            self._told, self._told_ns = engaged, now_ns
        return super().message(session, clock, now_ns, object_state, port_j)


def toward(start: Row, end: Row, part: float) -> Row:
    """Return the place at this part of a straight path."""
    return tuple([a + part * (b - a) for a, b in zip(start, end, strict=True)])
