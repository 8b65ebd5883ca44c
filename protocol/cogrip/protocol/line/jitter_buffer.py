"""The jitter buffer: how many frames a receiver waits before it plays one, fixed or adapted to the jitter.

Frame n is played at pop t = n + o. It is in time if its lateness x = (pop at which it first is there) - n is not above the
offset o. A pop that plays no frame (repeat) raises o by one, a frame that is passed over (skip) lowers it by one; nothing is
played twice. The playout delay is o less the least x: frames held beyond the fastest path. There is no clock: pops are
counted.

`LineReceiver` reports every frame's first arrival, and asks once a pop what to do. "auto" looks for the o of least cost

    J(o) = o + W late(o) / on time(o)      [frames]; late(o): weight of the arrivals with x > o

W frames of delay are as bad as losing every second frame. Sources and choices: docs/decisions/0010-playout.md, SPEC.md 5.5,
5.6.
"""

from math import inf
from typing import Literal

Move = Literal[-1, 0, 1]
PLAY: Move = 0
REPEAT: Move = 1  # let this pop pass without a frame
SKIP: Move = -1  # pass over one frame, and play the next one

LATE_RUN = 16  # pops at which all that came was too late, before a fixed jitter buffer waits
REALIGN_WINDOW = 128  # fresh datagrams that must agree before a fixed jitter buffer moves by one frame

LEAST_WEIGHT = 4.0  # frames
WEIGHT_S = 0.5  # W: a delay that costs as much as one late frame for every frame in time
MEMORY_S = 30.0  # an arrival counts 1/e of a new one after this time
START_S = 1.0 / 32.0  # playing begins with at most this many seconds of frames in hand
QUIET_S = 4.0  # no delay is kept that nothing has needed for this time
RUN_S = 1.0 / 16.0  # nothing but late frames for this time: the path has changed
LEAST_RUN = 4  # pops of that
HYSTERESIS = 0.35  # frames of cost by which a shorter delay must be better; a longer one costs nothing to try in a gap
DOUBT = 3.0  # arrivals that a frame counts for which is not there when it is due
SPACING = 16  # pops from one skip to the next: what a skipped frame carried is compensated meanwhile
GAP_WAIT = 64  # pops of waiting for a gap, in which a skip costs no frame
DEEPEST = 256  # frames
MOST_BINS = 3 * DEEPEST  # latenesses that are kept apart: what comes at one offset has 2 DEEPEST + 1 at most
_LARGEST = 4.0  # of a weight, before all are scaled down
_FORGOTTEN = 0.02  # of a new arrival: an old one that weighs less is dropped


def weight_frames(frame_s: float) -> float:
    """Return W in frames."""
    return max(LEAST_WEIGHT, WEIGHT_S / frame_s)


def cost(frames: float, late: float, on_time: float, weight: float) -> float:
    """Return J [frames] of a delay at which this weight of frames is late and this weight in time."""
    return frames + weight * late / on_time if on_time > 0.0 else inf


class FixedJitterBuffer:
    """D frames behind the newest one; follows drifting clocks by one frame a window (SPEC.md 5.5)."""

    adapts = False

    def __init__(self, frames: int) -> None:
        self.frames = frames
        self.repeated = self.skipped = 0
        self._seen = 0  # leads in this window
        self._low = self._high = 0  # least and largest of them
        self._run = 0  # pops with newer frames, none of which came in time

    def begin(self, in_hand: int) -> int:
        """Return how many frames behind the newest one playing begins. in_hand: older frames that are there."""
        return self.frames

    def arrived(self, lead: int) -> None:
        """Ignore an arrival: a fixed delay learns nothing of single frames."""

    def decide(self, lead: int, present: bool, fresh: bool) -> Move:
        """Return the move of this pop: one frame where a whole window came earlier, or later, than D.

        Where a run of more than LATE_RUN pops brought only late frames, repeat at each pop until one is in time again.

        lead     newest frame received less the one that is due
        present  the frame that is due is there
        fresh    a newer frame than any before has come since the last call
        """
        if not fresh:
            return PLAY
        self._run = self._run + 1 if lead < 0 else 0
        if self._run > LATE_RUN:
            self.repeated += 1
            return REPEAT
        if not self._seen:
            self._low = self._high = lead
        self._low, self._high = min(lead, self._low), max(lead, self._high)
        self._seen += 1
        if self._seen < REALIGN_WINDOW:
            return PLAY
        self._seen = 0
        if self._low > self.frames:
            self.skipped += 1
            return SKIP
        if self._high < self.frames:
            self.repeated += 1
            return REPEAT
        return PLAY

    def depths(self) -> tuple[float, int, int]:
        """Return mean, least and largest playout delay [frames]: D, whatever has drifted."""
        return float(self.frames), self.frames, self.frames


class AdaptiveJitterBuffer:
    """Follows the lateness of frames: longer in gaps, where waiting costs no frame; shorter where that is sure to pay."""

    adapts = True

    def __init__(self, frame_s: float) -> None:
        """frame_s: period T_n of a frame [s]."""
        self.repeated = self.skipped = 0
        self._weight = weight_frames(frame_s)
        self._growth = 1.0 + frame_s / MEMORY_S
        self._run_pops = max(LEAST_RUN, round(RUN_S / frame_s))
        self._quiet_pops = max(2 * SPACING, round(0.5 * QUIET_S / frame_s))
        self._most_at_first = round(START_S / frame_s)

        self._offset = 0  # o; that of the first frame played is 0
        self._target = 0
        self.bins: dict[int, float] = {}  # lateness x -> weight of the arrivals
        self._new = 1.0  # weight of an arrival now
        self._run = 0  # pops in a row at which nothing but late frames came
        self._silent = 0  # pops since something newer came
        self._skip_pause = 0  # pops until the next skip is allowed
        self._wait = GAP_WAIT
        self._half = 0  # pops of this half of the quiet time
        self._most_now = self._most_before = 0  # largest x in this half, and in the one before
        self._least_now = self._least_before = 0  # smallest

        self.frames = 0  # playout delay at the last pop
        self._pops = self._depth_sum = self._deepest = 0
        self._shallowest = DEEPEST

    def begin(self, in_hand: int) -> int:
        """Return how many frames behind the newest one playing begins. in_hand: older frames that are there.

        Some of these are played: to leave them out would make them late, and if they are too many they are soon skipped.
        """
        lead = min(in_hand, self._most_at_first)
        self.bins[-lead] = self._new  # only the newest says something of the path
        self._most_now = self._most_before = self._least_now = self._least_before = -lead
        return lead

    def arrived(self, lead: int) -> None:
        """Enter a frame that is there for the first time. lead: its number less that of the frame that is due next."""
        x = max(-DEEPEST, min(DEEPEST, -lead)) + self._offset
        new = self._new = self._new * self._growth
        bins = self.bins
        bins[x] = bins.get(x, 0.0) + new
        if x > self._most_now:
            self._most_now = x
        if new > _LARGEST:
            self._scale()
        if len(bins) > MOST_BINS:  # a sender that has been everywhere: nothing comes from beyond DEEPEST
            near = self._offset - DEEPEST, self._offset + DEEPEST
            self.bins = {x: weight for x, weight in self.bins.items() if near[0] <= x <= near[1]}

    def decide(self, lead: int, present: bool, fresh: bool) -> Move:
        """Return the move of this pop. Parameters as in `FixedJitterBuffer.decide`."""
        if fresh:
            self._silent = 0
            self._half += 1
            x = self._offset - lead  # of the newest frame: no other one's is less
            if self._half >= self._quiet_pops:
                self._half = 0
                self._most_before, self._most_now = self._most_now, x
                self._least_before, self._least_now = self._least_now, x
            elif x < self._least_now:
                self._least_now = x
        else:
            self._silent += 1
        self._skip_pause -= 1
        move = self._move_with_frame() if present else self._move_in_gap(lead, fresh)
        if move == REPEAT:
            self.repeated += 1
        elif move == SKIP:
            self.skipped += 1
            self._skip_pause = SPACING
        self._offset += move
        depth = self.frames = max(0, self._offset - self._least)
        self._pops += 1
        self._depth_sum += depth
        if depth > self._deepest:
            self._deepest = depth
        if depth < self._shallowest:
            self._shallowest = depth
        return move

    def depths(self) -> tuple[float, int, int]:
        """Return mean, least and largest playout delay at a pop [frames]."""
        return self._depth_sum / max(1, self._pops), min(self._shallowest, self._deepest), self._deepest

    @property
    def _least(self) -> int:
        """Recent x of the fastest frame."""
        now, before = self._least_now, self._least_before
        return now if now < before else before

    def _move_with_frame(self) -> Move:
        """Decide with the due frame there: skip it if no gap has come in time to do that in."""
        self._run = 0
        if not self._pops % SPACING:
            self._set_target(0.0)
            most = max(self._most_now, self._most_before)
            if most < self._target:  # long enough for what J counts to have come again: the path has become shorter
                self._target = most
                self.bins = {x: weight for x, weight in self.bins.items() if x <= most} or {most: self._new}
            if self._target >= self._offset:
                self._wait = GAP_WAIT
        if self._target >= self._offset:
            return PLAY
        self._wait -= 1
        return SKIP if self._wait < 0 and self._skip_pause <= 0 else PLAY

    def _move_in_gap(self, lead: int, fresh: bool) -> Move:
        """Decide without the due frame: to wait for it, or to go on without it, costs no further frame."""
        if self._silent >= self._run_pops:
            return PLAY  # an outage: those frames are lost, not late
        if fresh and lead < 0:
            self._run += 1
            if self._run >= self._run_pops - lead:
                self._discount(-lead)
        self._set_target(DOUBT * self._new)
        if self._target > self._offset:
            return REPEAT
        return SKIP if self._target < self._offset and lead > 0 and self._skip_pause <= 0 else PLAY

    def _set_target(self, pending: float) -> None:
        """Set the target to the x of least J, if J is less there by the hysteresis.

        pending: weight of a frame that is not there yet and may come at the next pop.
        """
        offset, weight = self._offset, self._weight
        bins = self.bins
        if pending:
            bins = {**bins, offset + 1: bins.get(offset + 1, 0.0) + pending}
        total = sum(bins.values())
        on_time = in_time_here = 0.0
        best, least = offset, inf
        for x in sorted(bins):  # between these J only grows
            on_time += bins[x]
            if x <= offset:
                in_time_here = on_time
            found = cost(x, total - on_time, on_time, weight)
            if found < least:
                best, least = x, found
        here = cost(offset, total - in_time_here, in_time_here, weight)
        better = here - least
        self._target = min(best, self._least + DEEPEST) if better > (0.0 if best > offset else HYSTERESIS) else offset

    def _discount(self, frames: int) -> None:
        """Let what came before a path that is longer by `frames` count so little that this run decides."""
        late = sum(weight for x, weight in self.bins.items() if x > self._offset)
        on_time = sum(self.bins.values()) - late
        most = late * self._weight / (frames + 1.0 + HYSTERESIS)
        if on_time > most:
            offset = self._offset
            self.bins = {x: weight if x > offset else weight * most / on_time for x, weight in self.bins.items()}

    def _scale(self) -> None:
        """Scale the weights, which are relative, so that a new one is 1, and drop what is forgotten."""
        new = self._new
        self.bins = {x: weight / new for x, weight in self.bins.items() if weight > _FORGOTTEN * new}
        self._new = 1.0


Frames = int | Literal["auto"]
JitterBuffer = FixedJitterBuffer | AdaptiveJitterBuffer


def make_jitter_buffer(frames: Frames, frame_s: float) -> JitterBuffer:
    """Return the jitter buffer of [playout] frames."""
    return AdaptiveJitterBuffer(frame_s) if frames == "auto" else FixedJitterBuffer(frames)
