"""Port of the scheme with local models: a wave port whose client also reports its proxy."""

from math import dist, inf

from msgspec.structs import replace

from cogrip.protocol.messages import Waves
from cogrip.protocol.settings import SeatSettings
from cogrip.server.port import Row
from cogrip.server.seat_limits import FASTER, SeatLimits
from cogrip.server.wave_port import WavePort


class LocalPort(WavePort):
    """proxy: of the newest frame [m], in the hand's own frame, as fast as the device's record allows; None before the first."""

    def __init__(self, seat: SeatSettings, limits: SeatLimits, power_left: float = 1.0) -> None:
        super().__init__(seat, limits, power_left)
        self._reach_m = FASTER * limits.speed_mps * seat.rates.frame_s  # in a frame
        self._reported: Row | None = None

    def receive(self, message: Waves, now_ns: int) -> bool:
        axes = self.axes
        if len(message.state) != 3 * axes:
            return False
        newest = self._receiver.newest
        if not super().receive(replace(message, state=message.state[: 2 * axes]), now_ns):
            return False
        if self._reported is None or self._receiver.newest > newest:
            self._reported = message.state[2 * axes :]
        return True

    def pop(self, frames: int) -> Row:
        before, reported = self.proxy or self._reported, self._reported
        if before is not None and reported is not None:
            away, reach = dist(before, reported), frames * self._reach_m
            part = reach / away if away > reach < inf else 1.0
            self.proxy = reported if part == 1.0 else toward(before, reported, part)
        return super().pop(frames)


def toward(start: Row, end: Row, part: float) -> Row:
    """Return the place at this part of a straight way."""
    return tuple([a + part * (b - a) for a, b in zip(start, end, strict=True)])
