"""Choice of impedance and filter while a line is in use: what suits the loop as measured, slowly (`line_tuning`).

A change holds from a frame on, and the next comes no sooner than a datagram repeats frames: then each says all that those in it
need.
"""

from cogrip.protocol.line_tuning import LoopFollower, Tuning, bounded, filter_lag_s, tuning
from cogrip.protocol.loop_meter import LoopMeter
from cogrip.protocol.settings import SeatSettings

LEAST_FRAMES = 8


class LineTuner:
    """Call `end_frame` once a frame. carried_nspm: impedance that the device carries; its owner sets it."""

    def __init__(self, seat: SeatSettings) -> None:
        self._line, self._impedance_nspm = seat.line, seat.coupling.impedance_nspm
        self.carried_nspm = self._impedance_nspm
        self._frames = max(LEAST_FRAMES, seat.playout.redundancy)
        self._follower = LoopFollower(seat.loop_s, seat.rates.frame_s, self._frames)
        self._waited = 0
        self._now: Tuning | None = None

    def tuning(self) -> Tuning:
        """Return what suits the loop that is gone by now; what settings give as a number stays so."""
        line = self._line
        found = tuning(self._follower.loop_s, line.prefer, self.carried_nspm)
        before = self._now.impedance_nspm if self._now is not None else found.impedance_nspm
        most = self._follower.factor
        b = bounded(min(max(found.impedance_nspm, before / most), before * most))
        lag_s = found.filter_lag_s if line.auto_filter else filter_lag_s(line.wave_filter_hz)
        self._now = Tuning(b if line.auto_impedance else self._impedance_nspm, lag_s)
        return self._now

    def end_frame(self, loops: LoopMeter) -> Tuning | None:
        """Return what holds from the next frame on, None for what has held."""
        self._waited += 1
        if self._waited < self._frames:
            return None
        self._waited, before = 0, self._now
        self._follower.update(loops)
        now = self.tuning()
        return None if now == before else now
