"""The jitter buffer: how long a receiver waits before it plays a frame, fixed or adapted to the jitter.

Time is counted in device ticks, M of them in a frame (`steps`); a server can move by whole frames only. Frame n is played
at tick n M + o. It is in time if its lateness x = (tick at which it has arrived) - n M is not above the offset o. A missing
frame is concealed; no frame is played twice. The playout delay is o less the least x: the time for which the fastest frames
wait. No clock is read: ticks are counted.

`LineReceiver` reports every frame's first arrival, and asks at every border what to do. "auto" takes for o the quantile of x
of the last WINDOW frames at which the late rate is `playout.late`. A sender that knows `spare` delays its frames by it, so that
rounding o to a server's whole frames costs no delay. Sources and choices: docs/decisions/0010-playout.md, SPEC.md 5.5, 5.6.
"""

from bisect import bisect_left, bisect_right, insort
from collections import deque

from cogrip.protocol.settings.delays import DEEPEST, Frames

LATE_RUN = 16  # most borders in a row with only late frames before a fixed jitter buffer waits
REALIGN_WINDOW = 128  # fresh datagrams that must agree before a fixed jitter buffer moves by one frame

WINDOW = 1024  # number of newest frames whose lateness counts
HALF_QUIET = 256  # number of frames: a delay that none of so many, to twice as many, has needed is given up
START_S = 1.0 / 32.0  # longest time of frames in hand with which playing begins
SPACING = 16  # least number of frames from one skip to the next: meanwhile the deficit of the skip is compensated
QUIET = 64  # number of frames for which the offset must be too large before a frame that has arrived is cut short
TOLERANCE = 2.0
"""Factor on the late rate of the settings. While fewer frames are late, a receiver of whole frames does not wait: its
sender shifts."""


class JitterBuffer:
    """Base of both kinds.

    adapts             the playout delay depends on arrivals
    repeated, skipped  borders at which nothing new was played, or a frame was cut short or passed over
    """

    def __init__(self, adapts: bool) -> None:
        self.adapts = adapts
        self.repeated = self.skipped = 0

    def begin(self, in_hand: int, early: int = 0, phase: int = 0) -> int:
        """Return how many frames behind the newest one playing begins. in_hand: older frames that have arrived."""
        raise NotImplementedError

    def arrived(self, lead: int, early: int = 0, phase: int = 0) -> None:
        """Record the arrival of a frame that has not arrived before.

        lead   its number less that of the frame that is due next
        early  steps from its arrival to the next border
        phase  steps by which its sender has shifted its frames so far, later is positive
        """

    def spare(self) -> int:
        """Return by how many steps the sender may send later; negative: should send sooner."""
        return 0

    def decide(self, lead: int, present: bool, fresh: bool) -> int:
        """Return by how many steps o moves at this border.

        lead     newest frame received less the one that is due
        present  the frame that is due is there
        fresh    a newer frame than any before has come since the last call
        """
        raise NotImplementedError

    def delay(self) -> float:
        """Return the playout delay now [frames]."""
        raise NotImplementedError

    def depths(self) -> tuple[float, float, float]:
        """Return mean, least and largest playout delay at a border [frames]."""
        raise NotImplementedError


class FixedJitterBuffer(JitterBuffer):
    """D frames behind the newest one; follows drifting clocks by one frame a window (SPEC.md 5.5)."""

    def __init__(self, frames: int, steps: int) -> None:
        super().__init__(False)
        self.frames = frames
        self.steps = steps
        self._seen = 0  # leads in this window
        self._low = self._high = 0  # least and largest of them
        self._run = 0  # borders with newer frames, none of which came in time

    def begin(self, in_hand: int, early: int = 0, phase: int = 0) -> int:
        return self.frames

    def decide(self, lead: int, present: bool, fresh: bool) -> int:
        """Return by how many steps o moves: by a frame where a whole window came earlier, or later, than D.

        Where a run of more than LATE_RUN borders brought only late frames, wait at each until one is in time again.
        """
        if not fresh:
            return 0
        self._run = self._run + 1 if lead < 0 else 0
        if self._run > LATE_RUN:
            self.repeated += 1
            return self.steps
        if not self._seen:
            self._low = self._high = lead
        if lead < self._low:
            self._low = lead
        if lead > self._high:
            self._high = lead
        self._seen += 1
        if self._seen < REALIGN_WINDOW:
            return 0
        self._seen = 0
        if self._low > self.frames:
            self.skipped += 1
            return -self.steps
        if self._high < self.frames:
            self.repeated += 1
            return self.steps
        return 0

    def delay(self) -> float:
        return self.frames

    def depths(self) -> tuple[float, int, int]:
        """Return mean, least and largest playout delay [frames]: D, whatever has drifted."""
        return float(self.frames), self.frames, self.frames


class AdaptiveJitterBuffer(JitterBuffer):
    """Sets o to the quantile of lateness: it grows in gaps, where waiting costs no frame, and shrinks one step at a time."""

    def __init__(self, late: float, frame_s: float, steps: int, quantum: int = 1) -> None:
        """late: rate of late frames; frame_s: period of a frame [s]; quantum: steps that o moves by, 1 or `steps`."""
        super().__init__(True)
        self._late, self._steps, self._quantum = late, steps, quantum
        self._waits_above = late * (TOLERANCE if quantum > 1 else 1.0)
        self._most_at_first = round(START_S / frame_s)

        furthest = DEEPEST * steps
        self._offset = 0  # o; that of the first frame played is 0
        self._phase = 0  # the sender's: it adds to the lateness of all that comes from now on
        self._recent: deque[int] = deque(maxlen=WINDOW)  # x less the phase at which it was sent
        self._sorted: list[int] = []
        self._half = 0  # frames of this half of the quiet time
        self._most_now = self._most_before = -furthest  # largest entry in this half, and in the one before
        self._since_skip = 0  # frames
        self._too_long = 0  # frames for which the offset has been too large

        self._borders = self._depth_sum = self._deepest = 0
        self._shallowest = DEEPEST * steps

    def begin(self, in_hand: int, early: int = 0, phase: int = 0) -> int:
        """Return how many frames behind the newest one playing begins.

        in_hand: older frames that have arrived; early, phase: of the newest, see `arrived`. Up to START_S of them are played,
        as they would count as late otherwise; if that is too much delay, some are soon skipped.
        """
        lead = min(in_hand, self._most_at_first)
        self.arrived(lead, early, phase)  # only the newest says something of the path
        return lead

    def arrived(self, lead: int, early: int = 0, phase: int = 0) -> None:
        self._phase = phase
        furthest = DEEPEST * self._steps
        ahead = max(-furthest, min(furthest, lead * self._steps + early))
        self._enter(self._offset - ahead - phase)

    def _enter(self, x: int) -> None:
        recent, ordered = self._recent, self._sorted
        if len(recent) == WINDOW:
            del ordered[bisect_left(ordered, recent[0])]
        recent.append(x)
        insort(ordered, x)
        self._half += 1
        if self._half > HALF_QUIET:
            self._half, self._most_before, self._most_now = 1, self._most_now, x
        elif x > self._most_now:
            self._most_now = x

    def _target(self) -> int:
        """Return the least o that keeps the late rate, at most what the last HALF_QUIET to 2 HALF_QUIET frames needed."""
        ordered = self._sorted
        most = max(self._most_now, self._most_before)
        return min(ordered[-1 - int(self._late * len(ordered))], most) + self._phase

    def spare(self) -> int:
        return self._offset - self._target() if self._recent else 0

    def decide(self, lead: int, present: bool, fresh: bool) -> int:
        """Return by how many steps o moves at this border.

        Above 0: a filling is played for so many steps before the frame that is due. Below 0: the frame, or its filling, is
        played for so many steps less; where that is a whole frame, it is skipped.
        """
        move = self._move(lead, present)
        if move > 0:
            self.repeated += 1
        elif move < 0:
            self.skipped += 1
            self._since_skip = 0
        self._offset += move
        depth = self._depth()
        self._borders += 1
        self._depth_sum += depth
        if depth > self._deepest:
            self._deepest = depth
        if depth < self._shallowest:
            self._shallowest = depth
        return move

    def _move(self, lead: int, present: bool) -> int:
        self._since_skip += 1
        excess, quantum = self._offset - self._target(), self._quantum
        if excess < 0 and not present:
            ordered = self._sorted
            late = len(ordered) - bisect_right(ordered, self._offset - self._phase)
            if late > self._waits_above * len(ordered):
                return min(self._steps, -(excess // quantum) * quantum)
        if excess < quantum:
            self._too_long = 0
            return 0
        self._too_long += 1
        if self._since_skip < SPACING or (present and self._too_long <= QUIET) or (not present and lead <= 0):
            return 0
        return -self._steps if excess >= 2 * self._steps else -quantum

    def _depth(self) -> int:
        return max(0, self._offset - self._sorted[0] - self._phase)

    def delay(self) -> float:
        return self._depth() / self._steps if self._recent else 0.0

    def depths(self) -> tuple[float, float, float]:
        steps = self._steps
        mean = self._depth_sum / max(1, self._borders)
        return mean / steps, min(self._shallowest, self._deepest) / steps, self._deepest / steps


def make_jitter_buffer(frames: Frames, frame_s: float, late: float, steps: int, quantum: int) -> JitterBuffer:
    """Return the jitter buffer of [playout] frames."""
    return AdaptiveJitterBuffer(late, frame_s, steps, quantum) if frames == "auto" else FixedJitterBuffer(frames, steps)
