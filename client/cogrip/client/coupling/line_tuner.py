"""Choice of impedance and filter while a line is in use: what suits the loop as measured, slowly (`line_tuning`).

A change of b holds from a frame on, and the next comes no sooner than a datagram repeats frames: so each datagram says all that
those in it need. The filter is this end's alone: its lag S changes from frame to frame, by GENTLE of S + T_n at most, as what
is in it is then so much less, or more, than the wave asks for. Until that is made up for, the force is off by RATE of it at
most.
"""

from cogrip.protocol.line.line_in_use import LoopFollower
from cogrip.protocol.line.loop_meter import LoopMeter
from cogrip.protocol.settings.line_tuning import Tuning, bounded, filter_lag_s
from cogrip.protocol.settings.seat import SeatSettings

LEAST_FRAMES = 8
GENTLE, RATE = 0.02, 0.08


class LineTuner:
    """Call `begin` before the first frame, then `end_frame` once a frame.

    now           what is in use
    carried_nspm  impedance that the device carries: its owner sets it
    """

    def __init__(self, seat: SeatSettings) -> None:
        self._seat, self._line, self._impedance_nspm = seat, seat.line, seat.coupling.impedance_nspm
        self._frame_s = seat.rates.frame_s
        self._frames = max(LEAST_FRAMES, seat.playout.redundancy)
        self._follower = LoopFollower(seat.loop_s, seat.line.prefer, self._frame_s, self._frames)
        self._waited = 0
        self.carried_nspm = self._impedance_nspm
        self.now = self._goal = self._suited()

    def _suited(self) -> Tuning:
        """Return what suits the loop that is gone by; what settings give as a number stays so."""
        line = self._line
        found = self._seat.tuning_on(self._follower.loop_s, self.carried_nspm)
        return Tuning(
            found.impedance_nspm if line.auto_impedance else self._impedance_nspm,
            found.filter_lag_s if line.auto_filter else filter_lag_s(line.wave_filter_hz),
        )

    def go_on_from(self, before: "LineTuner") -> None:
        """Begin with the loop that another line of the same seat went by."""
        self._follower = before._follower

    def begin(self) -> Tuning:
        """Return what the line begins with."""
        self.now = self._goal = self._suited()
        return self.now

    def end_frame(self, loops: LoopMeter) -> Tuning | None:
        """Return what holds from the next frame on, None for what has held."""
        b, lag_s = before = self.now
        self._waited += 1
        if self._waited >= self._frames:
            self._waited = 0
            self._follower.update(loops)
            self._goal = self._suited()
            if self._line.auto_impedance:
                b = bounded(_nearer(b, self._goal.impedance_nspm, b * (self._follower.factor - 1.0)))
        if lag_s != self._goal.filter_lag_s:
            lag_s = _nearer(lag_s, self._goal.filter_lag_s, min(GENTLE * (lag_s + self._frame_s), RATE * self._frame_s))
        if b == before.impedance_nspm and lag_s == before.filter_lag_s:
            return None
        self.now = Tuning(b, lag_s)
        return self.now


def _nearer(value: float, goal: float, most: float) -> float:
    return min(max(goal, value - most), value + most)
