"""How many frames a receiver waits before it plays one: a fixed depth, or one that follows the jitter it measures.

    frame n is played at take t = n + o; it is there in time if its lateness x = (take at which it first is there) - n is
    not above the offset o. A tick that plays no frame raises o by one, a frame that is passed over lowers it by one;
    nothing is played twice. The depth is o less the least x: frames held beyond what the quickest way asks for.

`LineReceiver` tells every frame's first arrival, and asks once a take what to do. No clock: takes are counted.

What "auto" looks for is the o that makes the cost least:

    J(o) = o + W late(o) / on time(o)      in frames; late(o): the share of the arrivals with x > o

W frames of delay are as bad as losing every second frame. Sources and choices: docs/decisions/0010-playout.md.
"""

from math import inf
from typing import Literal

PLAY = 0
REPEAT = 1  # let this take pass without a frame
SKIP = -1  # pass over one frame, and play the next one

LATE_RUN = 16  # takes at which all that came was too late, before a fixed playout waits
REALIGN_WINDOW = 128  # fresh datagrams that must agree before a fixed playout moves by one frame

LEAST_WEIGHT = 4.0  # frames
WEIGHT_S = 0.5  # W: so much delay costs as much as a late frame for every frame that is in time
MEMORY_S = 30.0  # an arrival counts 1/e of a new one after so long
START_S = 1.0 / 32.0  # of frames in hand that playing begins with at most
QUIET_S = 4.0  # no depth is kept that nothing has asked for in so long
RUN_S = 1.0 / 16.0  # so long nothing but late frames, though they come: the way is another one now
LEAST_RUN = 4  # takes of that
HYSTERESIS = (
    0.35  # frames of cost by which a shallower depth must be better; a deeper one costs nothing to try in a gap
)
DOUBT = 3.0  # arrivals that a frame counts for which is not there when it is due
SPACING = 16  # takes from one frame that is passed over to the next: what it carried is repaid meanwhile
GAP_WAIT = 64  # takes that a frame which is not there anyhow is waited for, to pass over that one
DEEPEST = 256  # frames
MOST_BINS = 3 * DEEPEST  # latenesses that are kept apart: what comes at one offset has 2 DEEPEST + 1 at most
_LARGEST = 4.0  # of a weight, before all are scaled down
_FORGOTTEN = 0.02  # of a new arrival: an old one that weighs less is dropped


def weight_frames(frame_s: float) -> float:
    """W in frames."""
    return max(LEAST_WEIGHT, WEIGHT_S / frame_s)


def cost(frames: float, late: float, on_time: float, weight: float) -> float:
    """J [frames] of a delay at which so many frames are late and so many are in time."""
    return frames + weight * late / on_time if on_time > 0.0 else inf


class FixedJitterBuffer:
    """D frames behind the newest one; follows drifting clocks by one frame a window."""

    learns = False

    def __init__(self, frames: int) -> None:
        self.frames = frames
        self.repeated = self.skipped = 0
        self._seen = 0
        self._low = self._high = 0
        self._run = 0  # takes with newer frames, none of which came in time

    def begin(self, in_hand: int) -> int:
        """How many frames behind the newest one playing begins; in_hand: so many older ones are there."""
        return self.frames

    def arrived(self, lead: int) -> None:
        """Not asked for: a fixed depth learns nothing of single frames."""

    def decide(self, lead: int, here: bool, fresh: bool) -> int:
        """When all of a window came earlier, or later, than the playout assumes, move one frame.

        Where a whole run came too late to be played at all, one at each take until some are in time again.

        lead: newest frame heard of less the one that is due; here: whether that one is there; fresh: whether a newer frame
        than any before has come since the last call.
        """
        if not fresh:
            return PLAY
        self._run = self._run + 1 if lead < 0 else 0
        if self._run > LATE_RUN:
            self.repeated += 1
            return REPEAT
        if not self._seen:
            self._low = self._high = lead
        elif lead < self._low:
            self._low = lead
        elif lead > self._high:
            self._high = lead
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
        """Mean, least and most frames held: D, whatever has drifted."""
        return float(self.frames), self.frames, self.frames


class AdaptiveJitterBuffer:
    """Follows how late frames come: deeper in gaps, where waiting costs no frame; shallower where that is sure to pay."""

    learns = True

    def __init__(self, frame_s: float) -> None:
        self.repeated = self.skipped = 0
        self._weight = weight_frames(frame_s)
        self._growth = 1.0 + frame_s / MEMORY_S
        self._run_takes = max(LEAST_RUN, round(RUN_S / frame_s))
        self._quiet_takes = max(2 * SPACING, round(0.5 * QUIET_S / frame_s))

        self._most_at_first = round(START_S / frame_s)
        self._offset = 0  # o; that of the first frame played is 0
        self._target = 0
        self._bins: dict[int, float] = {}  # lateness x -> weight of the arrivals
        self._new = 1.0  # weight of an arrival now
        self._run = 0  # takes in a row at which nothing but late frames came
        self._silent = 0  # takes since something newer came
        self._rest = 0  # takes until another frame may be passed over
        self._wait = GAP_WAIT
        self._part = 0  # takes of this half of the quiet time
        self._most_now = self._most_before = 0  # largest x in this half, and in the one before
        self._least_now = self._least_before = 0  # smallest

        self.frames = 0  # held at the last take
        self._takes = self._depth_sum = self._deepest = 0
        self._shallowest = DEEPEST

    def begin(self, in_hand: int) -> int:
        """How many frames behind the newest one playing begins; in_hand: so many older ones are there.

        Some of these are played: to leave them out would make them late, and if they are too many they are soon passed over.
        """
        lead = min(in_hand, self._most_at_first)
        self._bins[-lead] = self._new  # the newest alone says something of the way
        self._most_now = self._most_before = self._least_now = self._least_before = -lead
        return lead

    def arrived(self, lead: int) -> None:
        """A frame is there for the first time. lead: its number less that of the frame that is due next."""
        x = max(-DEEPEST, min(DEEPEST, -lead)) + self._offset
        new = self._new = self._new * self._growth
        bins = self._bins
        bins[x] = bins.get(x, 0.0) + new
        if x > self._most_now:
            self._most_now = x
        if new > _LARGEST:
            self._scale()
        if len(bins) > MOST_BINS:  # a sender that has been everywhere: nothing comes from beyond DEEPEST
            near = self._offset - DEEPEST, self._offset + DEEPEST
            self._bins = {x: share for x, share in self._bins.items() if near[0] <= x <= near[1]}

    def decide(self, lead: int, here: bool, fresh: bool) -> int:
        """What to do at this take; lead, here, fresh as for a fixed depth."""
        if fresh:
            self._silent = 0
            self._part += 1
            x = self._offset - lead  # of the newest frame: no other one's is less
            if self._part >= self._quiet_takes:
                self._part = 0
                self._most_before, self._most_now = self._most_now, x
                self._least_before, self._least_now = self._least_now, x
            elif x < self._least_now:
                self._least_now = x
        else:
            self._silent += 1
        self._rest -= 1
        move = self._shallower() if here else self._in_a_gap(lead, fresh)
        if move == REPEAT:
            self.repeated += 1
        elif move == SKIP:
            self.skipped += 1
            self._rest = SPACING
        self._offset += move
        depth = self.frames = max(0, self._offset - self._least)
        self._takes += 1
        self._depth_sum += depth
        if depth > self._deepest:
            self._deepest = depth
        if depth < self._shallowest:
            self._shallowest = depth
        return move

    def depths(self) -> tuple[float, int, int]:
        """Mean, least and most frames held at a take."""
        return self._depth_sum / max(1, self._takes), min(self._shallowest, self._deepest), self._deepest

    @property
    def _least(self) -> int:
        """Of late: the x of the quickest."""
        now, before = self._least_now, self._least_before
        return now if now < before else before

    def _shallower(self) -> int:
        """The frame that is due is there: pass over it if no gap has come in time to do it in."""
        self._run = 0
        if not self._takes % SPACING:
            self._aim(0.0)
            most = max(self._most_now, self._most_before)
            if most < self._target:  # long enough for what J minds to have come again: the way has become shorter
                self._target = most
                self._bins = {x: share for x, share in self._bins.items() if x <= most} or {most: self._new}
            if self._target >= self._offset:
                self._wait = GAP_WAIT
        if self._target >= self._offset:
            return PLAY
        self._wait -= 1
        return SKIP if self._wait < 0 and self._rest <= 0 else PLAY

    def _in_a_gap(self, lead: int, fresh: bool) -> int:
        """The frame that is due is not there: to wait for it, or to do without it, costs no further frame."""
        if self._silent >= self._run_takes:
            return PLAY  # an outage: those frames are lost, not late
        if fresh and lead < 0:
            self._run += 1
            if self._run >= self._run_takes - lead:
                self._forget(-lead)
        self._aim(DOUBT * self._new)
        if self._target > self._offset:
            return REPEAT
        return SKIP if self._target < self._offset and lead > 0 and self._rest <= 0 else PLAY

    def _aim(self, pending: float) -> None:
        """Set the target: where J is least, if it is less there by the hysteresis.

        pending: weight of a frame that is not there yet and may come at the next take.
        """
        offset, weight = self._offset, self._weight
        bins = self._bins
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

    def _forget(self, frames: int) -> None:
        """The way has become longer by `frames`: what was known before counts so little that this run decides."""
        late = sum(share for x, share in self._bins.items() if x > self._offset)
        on_time = sum(self._bins.values()) - late
        most = late * self._weight / (frames + 1.0 + HYSTERESIS)
        if on_time > most:
            self._bins = {x: share if x > self._offset else share * most / on_time for x, share in self._bins.items()}

    def _scale(self) -> None:
        """Weights are relative: bring them back, and drop what is forgotten."""
        new = self._new
        self._bins = {x: share / new for x, share in self._bins.items() if share > _FORGOTTEN * new}
        self._new = 1.0


Frames = int | Literal["auto"]
Playout = FixedJitterBuffer | AdaptiveJitterBuffer


def make_jitter_buffer(frames: Frames, frame_s: float) -> Playout:
    """The playout of [playout] frames."""
    return AdaptiveJitterBuffer(frame_s) if frames == "auto" else FixedJitterBuffer(frames)
