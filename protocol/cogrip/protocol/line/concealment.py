"""Packet loss concealment: waves for missing frames, and compensation of what these carried ([playout] concealment).

Symbols, per axis [sqrt(W)]: a wave of a frame that came, x wave in place of a missing frame, p compensation. The receiver
plays w = a + p, or w = x + p in a gap. The position deficit is sum sent - sum played [sqrt(W)], the energy reserve is
sum sent^2 - sum played^2 [W], both as far as they are known (SPEC 5.4). `WaveLedger` bounds every x and p, so that no strategy
makes more energy than the energy credit (`playout.tank_mj`).

    zero      x = 0, p = 0: a matched termination
    repaid    x = 0; p is 1/16 of the deficit, at most COMPENSATION_LIMIT
    tank      x is the last wave, fading out, within reserve and credit; p as above, but leaves a part of the reserve for the
              next gap
    elastic   x is the last wave: held while the hand is still, fading slowly while it moves. After the gap the played wave is
              cross-faded from x to the waves that come: p' = p + SMOOTHING (target - p), where the target is a fraction of the
              deficit. Meanwhile the client's end renders a lower impedance to a hand that moves (`WaveCoupling`)

Comparison and numbers: docs/decisions/0003-gaps.md.
"""

from collections.abc import Callable, Sequence

from cogrip.protocol.laws.square_root import square_root
from cogrip.protocol.line.energy_ledger import WaveLedger
from cogrip.protocol.line.energy_sums import NOTHING

PerAxis = Sequence[float]  # one value for each axis

COMPENSATION_FRACTION = 1.0 / 16.0  # fraction of the deficit that `repaid` and `tank` play in one frame
COMPENSATION_LIMIT = 0.02  # largest p of `repaid` and `tank` in one frame [sqrt(W)]
FADE = 0.85  # A wave fades by this factor a frame: under `tank` in any gap, under `elastic` after HELD_S of it.
RESERVE_FRAMES = 8.0  # frames like the last one for which compensation of `tank` leaves enough reserve

HELD_S = 0.25
"""Longest part of a gap through which `elastic` holds the wave of a hand at rest. Then the wave fades by FADE: whoever is
silent for longer is gone."""
GAP_S = 0.125  # length of the gap through which `held_force` is held: three of the mean bursts of a wireless network

# Constants of `elastic`:
BASE_HZ = 128.0  # frame rate at which the numbers below hold; at other rates they are converted to the same time
ELASTIC_FADE = 0.93  # factor on the wave of a hand that moves, from frame to frame in a gap
LAST_FADE = 0.75  # factor on x from frame to frame once the credit left pays for no more than such a fade to the end
SMOOTHING = 1.0 / 12.0  # fraction of the difference between p and its target that p moves in one frame
DEFICIT_FRACTION = 1.0 / 32.0  # target of p, as a fraction of the deficit
DISSIPATION_FRACTION = 1.0 / 8.0  # target of p where it lowers the energy of the wave, as a fraction of the deficit
ELASTIC_LIMIT = 0.1  # largest p where it raises the energy of the wave [sqrt(W)]
YIELDING_GAIN = 0.4  # factor on sqrt(b) of the yielding end at line_quality 0
FULL_QUALITY = 0.99  # line_quality above which it is set to 1
MOVING_FRACTION = 1.0 / 8.0  # ratio of sqrt(2b) velocity to the wave above which a hand has stillness 0


class Concealment:
    """Strategy of one receiver. This base class is `zero`: a matched termination in a gap, without compensation.

    added          p of the last frame, of each axis
    line_quality   1 while every wave comes, falling to 0 while waves are missing
    yielding_gain  factor on sqrt(b) of the yielding end (`WaveCoupling`) at line_quality 0; 1: the end does not yield
    """

    def __init__(self, axes: int, frame_s: float) -> None:
        self.line_quality = self.yielding_gain = 1.0
        self.added = list(NOTHING)
        self._axes, self._zero = axes, [0.0] * axes

    def fill(
        self, last: PerAxis, limit: PerAxis, answer: PerAxis, late: PerAxis | None = None, silent: bool = True,
        part: float = 1.0,
    ) -> PerAxis:  # fmt: skip
        """Return x for a missing frame, with |x| <= limit.

        last    wave that was played one frame before
        limit   largest |x| that the energy ledger allows, per axis
        answer  wave that this end sent with `last`: last + answer = sqrt(2b) velocity
        late    newest wave of all, where it came with this pop, too late to be played in its own frame
        silent  whether no frame newer than the missing one has come
        part    of a frame, for which x is to be played: it fades by that part of a frame's fade
        """
        return self._zero

    def compensate(self, row: PerAxis, ledger: WaveLedger, last: PerAxis, gap: bool) -> None:
        """Set `added` to p for a wave, with (row + p)^2 - row^2 <= energy reserve.

        row      a, or x in a gap
        ledger   has position deficit and energy reserve (`WaveLedger.measure`)
        last     wave that was played one frame before
        gap      whether `row` stands in place of a missing frame
        """


class DeficitCompensation(Concealment):
    """`repaid`: a matched termination in a gap, then slow deficit compensation (theory 3.5)."""

    def compensate(self, row: PerAxis, ledger: WaveLedger, last: PerAxis, gap: bool) -> None:
        for axis in range(self._axes):
            wanted = COMPENSATION_FRACTION * ledger.deficits[axis]
            self.added[axis] = clamped(wanted, -COMPENSATION_LIMIT, COMPENSATION_LIMIT)


class FadingConcealment(DeficitCompensation):
    """`tank`: the last wave fades out through a gap, within energy reserve and credit."""

    def fill(
        self, last: PerAxis, limit: PerAxis, answer: PerAxis, late: PerAxis | None = None, silent: bool = True,
        part: float = 1.0,
    ) -> PerAxis:  # fmt: skip
        fade = 1.0 - part * (1.0 - FADE)
        return [max(-most, min(most, fade * wave)) for wave, most in zip(last, limit, strict=True)]

    def compensate(self, row: PerAxis, ledger: WaveLedger, last: PerAxis, gap: bool) -> None:
        DeficitCompensation.compensate(self, row, ledger, last, gap)
        for axis in range(self._axes):
            value, wave = row[axis], last[axis]
            reach = square_root(value * value + max(0.0, ledger.reserves[axis] - RESERVE_FRAMES * wave * wave))
            self.added[axis] = clamped(self.added[axis], -value - reach, reach - value)


class ElasticConcealment(Concealment):
    """`elastic`: hold or slow fade in a gap, and a cross-fade after it, so that the played wave does not jump.

    _stillness       of the hand: 1 while it is still, 0 while it moves
    _gap_frames      of the gap under way
    _gone            factor from frame to frame after HELD_S of a gap
    _limit_fraction  of the limit of x, in one frame: what is left pays for a fade by LAST_FADE until its end
    """

    def __init__(self, axes: int, frame_s: float) -> None:
        super().__init__(axes, frame_s)
        frames = frame_s * BASE_HZ
        self.yielding_gain = YIELDING_GAIN
        self._fade, self._gone = ELASTIC_FADE**frames, FADE**frames
        self._smoothing = 1.0 - (1.0 - SMOOTHING) ** frames
        self._deficit_fraction = min(1.0, DEFICIT_FRACTION * frames)
        self._dissipation_fraction = min(1.0, DISSIPATION_FRACTION * frames)
        self._limit_fraction = square_root(1.0 - LAST_FADE ** (2.0 * frames))
        self._stillness = 1.0
        self._was_gap = False
        self._gap_frames, self._held_frames = 0, round(HELD_S / frame_s)

    def fill(
        self, last: PerAxis, limit: PerAxis, answer: PerAxis, late: PerAxis | None = None, silent: bool = True,
        part: float = 1.0,
    ) -> PerAxis:  # fmt: skip
        self._gap_frames = self._gap_frames + 1 if self._was_gap else 1
        self._stillness = self._stillness_of(last, answer)
        fade = self._fade + (1.0 - self._fade) * self._stillness
        if self._gap_frames > self._held_frames:
            fade = self._gone
        fade = 1.0 - part * (1.0 - fade)
        if late is not None:  # the other end still sends
            self._recover()
        elif silent:
            self.line_quality *= fade
        steady = [fade * (last[axis] - self.added[axis]) for axis in range(self._axes)]
        reach = [self._limit_fraction * most for most in limit]
        return [max(-most, min(most, x)) for x, most in zip(late or steady, reach, strict=True)]

    def _stillness_of(self, last: PerAxis, answer: PerAxis) -> float:
        """Return 1 for a hand that is still, 0 for one that moves, and values between.

        In a gap the stillness from before it is kept for a hand that only gives way to the played wave.
        """
        square = along = speed_square = 0.0
        for axis in range(len(last)):
            wave = last[axis]
            speed = wave + answer[axis]
            square += wave * wave
            along += wave * speed
            speed_square += speed * speed
        if not square:
            return 0.0
        if self._was_gap:
            return min(self._stillness, max(0.0, 1.0 - along / square))
        return max(0.0, 1.0 - square_root(speed_square / square) / MOVING_FRACTION)

    def _recover(self) -> None:
        quality = self.line_quality + self._smoothing * (1.0 - self.line_quality)
        self.line_quality = quality if quality <= FULL_QUALITY else 1.0

    def compensate(self, row: PerAxis, ledger: WaveLedger, last: PerAxis, gap: bool) -> None:
        smoothing, fraction, dissipation = self._smoothing, self._deficit_fraction, self._dissipation_fraction
        deficits, reserves, added = ledger.deficits, ledger.reserves, self.added
        after_gap = self._was_gap and not gap
        self._was_gap = gap
        for axis in range(self._axes):
            value, axis_deficit, reserve_w, before = row[axis], deficits[axis], reserves[axis], added[axis]
            target, square = 0.0, value * value
            if (
                not gap
            ):  # else p fades: while a gap lasts, the yielding end may write deficit off (`LineReceiver.write_off`)
                reach = square_root(
                    square + 0.25 * smoothing * reserve_w
                )  # leaves energy for p to decay as slowly as it grew
                target = clamped(fraction * axis_deficit, -ELASTIC_LIMIT, ELASTIC_LIMIT)
                target = clamped(target, -value - reach, reach - value)
                if axis_deficit * value < 0.0:  # p lowers the energy of this wave, so that it needs no reserve
                    size = max(min(abs(value), dissipation * abs(axis_deficit)), abs(target))
                    target = size if axis_deficit > 0.0 else -size
            p = last[axis] - value if after_gap else before
            p += smoothing * (target - p)
            reach = square_root(square + reserve_w)
            added[axis] = clamped(p, -value - reach, reach - value)
        if not gap:
            self._recover()


def clamped(value: float, least: float, most: float) -> float:
    """Return max(least, min(most, value)), in half the time."""
    if value >= most:
        value = most
    return least if value <= least else value


def held_force(impedance_nspm: float, credit_j: float, frame_s: float, axes: int) -> float:
    """Return the force [N] on one axis that `elastic` holds for a hand at rest through a gap of GAP_S (theory 3.5)."""
    last = LAST_FADE ** (2.0 * frame_s * BASE_HZ)
    frames = max(1.0, GAP_S / frame_s) + last / (1.0 - last)  # those of the gap, and what a fade after them takes
    return square_root(4.0 * impedance_nspm * credit_j / (frame_s * axes * frames))


Maker = Callable[[int, float], Concealment]
CONCEALMENTS: dict[str, Maker] = {
    "zero": Concealment,
    "repaid": DeficitCompensation,
    "tank": FadingConcealment,
    "elastic": ElasticConcealment,
}
