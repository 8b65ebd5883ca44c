"""Packet loss concealment: waves for missing frames, and compensation of what these carried ([playout] concealment).

Symbols, per axis: a wave of a frame, x wave in place of a missing one, p compensation; w = x + p or a + p is played
[sqrt(W)]. The position deficit is sum sent - sum played [sqrt(W)], the energy reserve sum sent^2 - sum played^2 [W], both as
far as they are known (SPEC 5.4). `WaveLedger` bounds every x and p: no strategy can make more energy than the credit.

    zero      x = 0, p = 0: a matched termination
    repaid    x = 0; p is 1/16 of the deficit, at most COMPENSATION_LIMIT
    tank      x is the last wave fading out, paid by reserve and credit; p as above, but some reserve is kept for the next gap
    elastic   the last wave is held while the hand rests and fades more slowly while it moves; the first frame after the gap is
              cross-faded to, like a spring with a damper: p' = SMOOTHING (target - p), with the deficit as the spring. The
              client's end yields where the hand moves (`WaveCoupling`)

Comparison and numbers: docs/decisions/0003-gaps.md.
"""

from collections.abc import Callable, Sequence
from math import copysign, sqrt
from typing import Literal

Concealed = Literal["zero", "repaid", "tank", "elastic"]
Row = Sequence[float]

COMPENSATION_FRACTION = 1.0 / 16.0  # of the deficit, in one frame
COMPENSATION_LIMIT = 0.02  # sqrt(W) in one frame
FADE = 0.85  # of `tank`: factor from frame to frame in a gap
RESERVE_FRAMES = 8.0  # of `tank`: frames like the last one that compensation leaves in the reserve

# of `elastic`
BASE_HZ = 128.0  # frame rate at which the numbers below hold; at other rates they are converted to the same time
ELASTIC_FADE = 0.93  # factor from frame to frame in a gap
SMOOTHING = 1.0 / 12.0  # fraction of the way from p to its target, in one frame
DEFICIT_FRACTION = 1.0 / 64.0  # of the deficit, in one frame
DISSIPATION_FRACTION = 1.0 / 16.0  # of the deficit, in one frame, where p takes energy out of the wave
ELASTIC_LIMIT = 0.1  # sqrt(W), of a p that costs energy
LEAST_GAIN = 0.4  # of sqrt(b), at an end whose wave is missing
FULL_QUALITY = 0.99  # a quality above this is 1
REST_FRACTION = 1.0 / 8.0  # of the wave: a hand whose sqrt(2b) velocity is this much moves


class Concealment:
    """Strategy of one receiver; this one is a matched termination in a gap, without compensation (`zero`).

    quality     known fraction of the wave that is played now, 1 to 0
    least_gain  gain of sqrt(b) that an end keeps at quality 0
    """

    def __init__(self, axes: int, frame_s: float) -> None:
        self.quality = self.least_gain = 1.0
        self._zero = [0.0] * axes

    def fill(self, last: Row, limit: Row, answer: Row, late: Row | None = None, silent: bool = True) -> Row:
        """Return x for a missing frame, |x| <= limit.

        last    wave played before
        answer  wave that this end sent with it: last + answer is sqrt(2b) velocity
        late    newest wave of all, if it has come with this pop and too late
        silent  no frame newer than the missing one is known
        """
        return self._zero

    def compensate(self, row: Row, deficit: Row, reserve: Row, last: Row, gap: bool) -> Row:
        """Return p for the wave `row`, with (row + p)^2 - row^2 <= reserve. gap: `row` stands for a missing frame."""
        return self._zero


class Compensated(Concealment):
    """Matched termination in a gap, slow compensation (theory 3.5)."""

    def compensate(self, row: Row, deficit: Row, reserve: Row, last: Row, gap: bool) -> Row:
        return [max(-COMPENSATION_LIMIT, min(COMPENSATION_LIMIT, COMPENSATION_FRACTION * each)) for each in deficit]


class Tank(Compensated):
    """Fade of the last wave through a gap."""

    def fill(self, last: Row, limit: Row, answer: Row, late: Row | None = None, silent: bool = True) -> Row:
        return [max(-most, min(most, FADE * wave)) for wave, most in zip(last, limit, strict=True)]

    def compensate(self, row: Row, deficit: Row, reserve: Row, last: Row, gap: bool) -> Row:
        out = []
        wanted = Compensated.compensate(self, row, deficit, reserve, last, gap)
        for value, p, held, wave in zip(row, wanted, reserve, last, strict=True):
            reach = sqrt(value * value + max(0.0, held - RESERVE_FRAMES * wave * wave))
            out.append(max(-value - reach, min(reach - value, p)))
        return out


class Elastic(Concealment):
    """Hold or slow fade, and cross-fade: the end yields in a gap to a hand that moves, and comes back without a jump."""

    def __init__(self, axes: int, frame_s: float) -> None:
        super().__init__(axes, frame_s)
        frames = frame_s * BASE_HZ
        self.least_gain = LEAST_GAIN
        self._fade = ELASTIC_FADE**frames
        self._smoothing = 1.0 - (1.0 - SMOOTHING) ** frames
        self._deficit_fraction = min(1.0, DEFICIT_FRACTION * frames)
        self._dissipation_fraction = min(1.0, DISSIPATION_FRACTION * frames)
        self._added = [0.0] * axes  # p of the last frame
        self._part = sqrt(1.0 - self._fade * self._fade)  # of the limit: what is left pays for a fade to its end
        self._rest = 1.0  # of the hand: 1 at rest, 0 moving
        self._was_gap = False

    def fill(self, last: Row, limit: Row, answer: Row, late: Row | None = None, silent: bool = True) -> Row:
        self._rest = self._resting(last, answer)
        fade = self._fade + (1.0 - self._fade) * self._rest
        if late is not None:  # the other end is there: no reason to yield
            self._recover()
        elif silent:
            self.quality *= fade
        steady = [fade * (wave - added) for wave, added in zip(last, self._added, strict=True)]
        reach = [self._part * most for most in limit]
        return [max(-most, min(most, x)) for x, most in zip(late or steady, reach, strict=True)]

    def _resting(self, last: Row, answer: Row) -> float:
        """Return how much the hand rests. In a gap one that rested still does where it only follows its own load."""
        square = sum([wave * wave for wave in last])
        if not square:
            return 0.0
        speed = [wave + sent for wave, sent in zip(last, answer, strict=True)]
        if self._was_gap:
            along = sum([wave * each for wave, each in zip(last, speed, strict=True)])
            return min(self._rest, max(0.0, 1.0 - along / square))
        return max(0.0, 1.0 - sqrt(sum([each * each for each in speed]) / square) / REST_FRACTION)

    def _recover(self) -> None:
        quality = self.quality + self._smoothing * (1.0 - self.quality)
        self.quality = quality if quality <= FULL_QUALITY else 1.0

    def compensate(self, row: Row, deficit: Row, reserve: Row, last: Row, gap: bool) -> Row:
        smoothing, fraction, dissipation = self._smoothing, self._deficit_fraction, self._dissipation_fraction
        after_gap = self._was_gap and not gap
        self._was_gap = gap
        added: list[float] = []
        for axis in range(len(row)):
            value, missing, held, before = row[axis], deficit[axis], reserve[axis], self._added[axis]
            target, square = 0.0, value * value
            if not gap:  # what the end writes off in a gap (`LineReceiver.write_off`) is not compensated before its end
                reach = sqrt(square + 0.25 * smoothing * held)  # so that p can go back as slowly as it came
                target = _within(fraction * missing, -ELASTIC_LIMIT, ELASTIC_LIMIT)
                target = _within(target, -value - reach, reach - value)
                if missing * value < 0.0:  # p takes energy out of this wave: as fast as possible
                    most = min(abs(value), dissipation * abs(missing))
                    target = copysign(max(most, abs(target)), missing)
            p = last[axis] - value if after_gap else before
            p += smoothing * (target - p)
            reach = sqrt(square + held)
            added.append(_within(p, -value - reach, reach - value))
        self._added = added
        if not gap:
            self._recover()
        return added


def _within(value: float, least: float, most: float) -> float:
    """Return max(least, min(most, value)), in half the time."""
    if value >= most:
        value = most
    return least if value <= least else value


def held_force(impedance_nspm: float, credit_j: float, frame_s: float, axes: int) -> float:
    """Return the force [N] on one axis that `elastic` holds in full in the first missing frame (theory 3.5)."""
    fade = ELASTIC_FADE ** (frame_s * BASE_HZ)
    return sqrt(4.0 * impedance_nspm * (1.0 - fade * fade) * credit_j / (frame_s * axes))


Maker = Callable[[int, float], Concealment]
CONCEALMENTS: dict[str, Maker] = {"zero": Concealment, "repaid": Compensated, "tank": Tank, "elastic": Elastic}
