"""What a line's receiver plays while frames are missing, and how it pays back what they carried ([playout] concealment).

Symbols, per axis: a a frame's wave, x what is played in place of one that is missing, p what is added to a or x; w = x + p
or a + p is played [sqrt(W)]; debt sum sent - sum played [sqrt(W)], bank sum sent^2 - sum played^2 [W], as far as they are
known (SPEC 5.4). `LineReceiver` keeps the books and bounds every answer by them: no strategy can make energy.

    zero      x = 0 and p = 0: what is lost is lost
    repaid    x = 0; p a sixteenth of the debt, at most REPAY_LIMIT
    tank      x is the last wave fading out, lent by bank and tank; p as above, but leaves some bank for the next gap
    elastic   the last wave fades, more slowly. A frame after a gap is gone over to from what was played, as a spring with a
              damper does: p' = SMOOTHING (target - p), with the debt as the spring. A stock is laid by in the bank for the
              next gap, and the client's end yields (`WaveCoupling`)

Which is best, and with which numbers: docs/decisions/0003-gaps.md.
"""

from collections.abc import Callable, Sequence
from math import sqrt
from typing import Literal, Protocol

Concealed = Literal["zero", "repaid", "tank", "elastic"]
Row = Sequence[float]

COMPENSATION_FRACTION = 1.0 / 16.0  # of the debt, in one frame
COMPENSATION_LIMIT = 0.02  # sqrt(W) in one frame
FADE = 0.85  # of the last wave, from frame to frame, in a gap, of `tank`
RESERVE = 8.0  # frames like the last one that repayment leaves in the bank for the next gap

BASE_HZ = 128.0  # the frame rate at which the shares below hold; at others they are so much in the same time
LINGER = 0.93  # of the last wave, from frame to frame, in a gap
SMOOTHING = 1.0 / 12.0  # of what p is away from its target, in one frame
PAYING = 1.0 / 64.0  # of the debt, in one frame
GAINING = 1.0 / 16.0  # of the debt, in one frame, where paying takes energy out of a wave
FASTEST = 0.1  # sqrt(W): p where paying costs energy
LEAST_SHARE = 0.4  # of sqrt(b), at an end whose wave is missing
WHOLE = 0.99  # a quality above this is 1
STOCK = 8.0  # frames of BASE_HZ like the largest of late that are kept in the bank for the next gap: a fade takes 7.4
SKIM = 0.2  # of a wave, as long as there is less than that
FORGETTING = 1.0 / 128.0  # of the largest wave of late, in one frame


class Concealment(Protocol):
    """One receiver's way through gaps."""

    quality: float  # how much of the wave played now is known, 1 to 0
    least_share: float  # of sqrt(b) that an end keeps at quality 0

    def fill(self, last: Row, room: Row, late: Row | None = None, silent: bool = True) -> list[float]:
        """x: in place of a frame that is not there. last: what was played before; |x| is at most `room`.

        late: the newest wave there is, where that has come now and too late.
        silent: no newer frame than the missing one is known.
        """

    def pay(self, row: Row, deficit: Row, reserve: Row, last: Row, gap: bool) -> list[float]:
        """p: to add to the row, which stands for a missing frame in a `gap`. (w + p)^2 - w^2 is kept within `reserve`."""


class Zero:
    """A matched termination, and no more."""

    quality = least_share = 1.0

    def __init__(self, axes: int, frame_s: float) -> None:
        self._zero = [0.0] * axes

    def fill(self, last: Row, room: Row, late: Row | None = None, silent: bool = True) -> list[float]:
        return self._zero

    def pay(self, row: Row, deficit: Row, reserve: Row, last: Row, gap: bool) -> list[float]:
        return self._zero


class Compensated(Zero):
    """Theory 3.5."""

    def pay(self, row: Row, deficit: Row, reserve: Row, last: Row, gap: bool) -> list[float]:
        return [max(-COMPENSATION_LIMIT, min(COMPENSATION_LIMIT, COMPENSATION_FRACTION * short)) for short in deficit]


class Tank(Compensated):
    """The last wave fades out through a gap."""

    def fill(self, last: Row, room: Row, late: Row | None = None, silent: bool = True) -> list[float]:
        return [max(-most, min(most, FADE * wave)) for wave, most in zip(last, room, strict=True)]

    def pay(self, row: Row, deficit: Row, reserve: Row, last: Row, gap: bool) -> list[float]:
        out = []
        for value, short, held, wave in zip(row, deficit, reserve, last, strict=True):
            spare = max(0.0, held - RESERVE * wave * wave)
            pay = max(-COMPENSATION_LIMIT, min(COMPENSATION_LIMIT, COMPENSATION_FRACTION * short))
            reach = sqrt(value * value + spare)
            out.append(max(-value - reach, min(reach - value, pay)))
        return out


class Elastic:
    """A buffer with energy for its bound: it gives way in a gap, and comes back without a jump."""

    def __init__(self, axes: int, frame_s: float) -> None:
        frames = frame_s * BASE_HZ
        self.quality = 1.0
        self.least_share = LEAST_SHARE
        self._fade = LINGER**frames
        self._reserve = STOCK / frames
        self._smoothing = 1.0 - (1.0 - SMOOTHING) ** frames
        self._paying = min(1.0, PAYING * frames)
        self._gaining = min(1.0, GAINING * frames)
        self._added = [0.0] * axes  # p of the last frame
        self._keeping = (1.0 - FORGETTING) ** frames
        self._top = [0.0] * axes  # largest square of late
        self._low = [True] * axes  # the stock is being laid by
        self._apart = False  # the last frame was none

    def fill(self, last: Row, room: Row, late: Row | None = None, silent: bool = True) -> list[float]:
        out = []
        share = 1.0
        steady = [self._fade * (wave - added) for wave, added in zip(last, self._added, strict=True)]
        for value, most in zip(late or steady, room, strict=True):
            size = abs(value)
            if size > most:
                share = min(share, most / size)
                value = most if value > 0.0 else -most
            out.append(value)
        if late is not None:  # what comes, if too late, says that there is somebody: no reason to yield
            self._recover()
        elif silent:
            self.quality *= self._fade * share
        return out

    def _recover(self) -> None:
        if self.quality < 1.0:
            self.quality += self._smoothing * (1.0 - self.quality)
            if self.quality > WHOLE:
                self.quality = 1.0

    def pay(self, row: Row, deficit: Row, reserve: Row, last: Row, gap: bool) -> list[float]:
        smoothing, added = self._smoothing, self._added
        braking = 0.5 * smoothing
        join = self._apart and not gap
        self._apart = gap
        for axis, value in enumerate(row):
            short, have = deficit[axis], reserve[axis]
            square = value * value
            self._top[axis] = top = max(square, self._top[axis] * self._keeping)
            least = self._reserve * top
            low = self._low[axis] = have < (least if self._low[axis] else 0.5 * least)
            if (
                gap
            ):  # what its end takes for played in it (`LineReceiver.write_off`) is not asked back before it is over
                target = 0.0
            elif low:
                target = -SKIM * value
            else:
                target = max(-FASTEST, min(FASTEST, self._paying * short))
                reach = sqrt(square + braking * max(0.0, have - least))  # so that p can go back as slowly as it came
                target = max(-value - reach, min(reach - value, target))
            if short * value < 0.0 and not gap:  # it takes energy out of this wave: as fast as that can be
                most = min(abs(value), self._gaining * abs(short))
                if most > abs(target):
                    target = most if short > 0.0 else -most
            pay = last[axis] - value if join else added[axis]
            pay += smoothing * (target - pay)
            reach = sqrt(square + have)
            pay = max(-value - reach, min(reach - value, pay))
            added[axis] = pay
        if not gap:
            self._recover()
        return added


CONCEALMENTS: dict[str, Callable[[int, float], Concealment]] = {
    "zero": Zero,
    "repaid": Compensated,
    "tank": Tank,
    "elastic": Elastic,
}
