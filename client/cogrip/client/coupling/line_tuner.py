"""Choice of impedance and filter while a line is in use: what suits the loop as measured, slowly (`line_tuning`).

A change of b holds from a frame on, and the next comes no sooner than a datagram repeats frames: so each datagram says all that
those in it need. The filter is this end's alone: its lag S changes from frame to frame, by GENTLE of S + T_n at most, as what
is in it is then so much less, or more, than the wave asks for. Until that is made up for, the force is off by RATE of it at
most.
"""

from cogrip.protocol.line.line_in_use import LoopFollower
from cogrip.protocol.line.loop_meter import LoopMeter
from cogrip.protocol.settings.hand import HandChange
from cogrip.protocol.settings.line_tuning import Tuning, bounded, corner_hz, filter_lag_s
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
        self._changed = False  # since the line began, by the administrator
        self.carried_nspm = self._impedance_nspm
        self.now = self._goal = self._suited()

    def _suited(self) -> Tuning:
        """Return what suits the loop that is gone by; what settings give as a number stays so."""
        line, fixed_nspm = self._line, self._impedance_nspm
        if self._changed:
            fixed_nspm = min(fixed_nspm, self.carried_nspm)
        found = self._seat.tuning_on(self._follower.loop_s, self.carried_nspm)
        return Tuning(
            found.impedance_nspm if line.auto_impedance else fixed_nspm,
            found.filter_lag_s if line.auto_filter else filter_lag_s(line.wave_filter_hz),
        )

    def change(self, seat: SeatSettings) -> None:
        """Go by these settings from now on; a number is taken as far as the device carries it."""
        self._seat, self._line, self._changed = seat, seat.line, True
        self._impedance_nspm = seat.coupling.impedance_nspm
        before = self._follower
        self._follower = LoopFollower(before.loop_s, seat.line.prefer, self._frame_s, self._frames)
        self._goal = self._suited()

    def held(self) -> HandChange:
        """Return what holds of what was changed; nothing where nothing was."""
        if not self._changed:
            return HandChange()
        line, goal = self._line, self._suited()
        corner = round(corner_hz(goal.filter_lag_s), 9)
        return HandChange(
            impedance_nspm="auto" if line.auto_impedance else bounded(goal.impedance_nspm),
            wave_filter_hz="auto" if line.auto_filter else corner,
            prefer=line.prefer,
        )

    def go_on_from(self, before: "LineTuner") -> None:
        """Begin with the loop that another line of the same seat went by, and with what was changed there."""
        self._follower, self._changed = before._follower, before._changed

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
            if b != self._goal.impedance_nspm:
                b = bounded(_nearer(b, self._goal.impedance_nspm, b * (self._follower.factor - 1.0)))
        if lag_s != self._goal.filter_lag_s:
            lag_s = _nearer(lag_s, self._goal.filter_lag_s, min(GENTLE * (lag_s + self._frame_s), RATE * self._frame_s))
        if b == before.impedance_nspm and lag_s == before.filter_lag_s:
            return None
        self.now = Tuning(b, lag_s)
        return self.now


def _nearer(value: float, goal: float, most: float) -> float:
    return min(max(goal, value - most), value + most)
