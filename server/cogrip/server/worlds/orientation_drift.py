"""Drift of tools' orientations from those of their hands, and the rates that take them back (theory 8.5).

A wave line carries angular velocity. Sums of it agree at both ends but for the line's own stretch e, the angle by which the
tool has travelled farther than the hand: a spring's, that has to stay. Orientations do not follow from sums, as rotations do
not commute: R_tool drifts away from exp(e) R_hand. Each frame asks for SHARE of the difference back.

    delta = log(R_tool (exp(e) R_hand)^-1)          correction rate = -SHARE delta / T
"""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from cogrip.machine.rows import Vector
from cogrip.protocol.axes import PLACES
from cogrip.protocol.laws.rotations import Quaternion, between, exp, product

Array = NDArray[np.float64]

SHARE = 1.0 / 16.0
NONE: Vector = (0.0, 0.0, 0.0)


SAVED = 13  # numbers of a saved state


class OrientationDrift:
    """Drift of one tool. `set_hand` before a step whose row is known to be of that pose, then `step`.

    correction_radps  rate to be added in the next step, in the world's frame
    drift_rad         delta, as last known
    """

    def __init__(self, frame_s: float) -> None:
        self._frame_s = frame_s
        self.begin()

    def begin(self) -> None:
        """Begin with a tool that has just been taken, where the hand has it."""
        self._hand: tuple[Sequence[float], Sequence[float]] | None = None
        self._ahead: Vector | None = None  # travelled by the tool less the hand, at the first report
        self._travelled = NONE
        self.correction_radps = self.drift_rad = NONE

    def save(self) -> tuple[float, ...]:
        """Return the state between two steps."""
        known = 0.0 if self._ahead is None else 1.0
        return (known, *(self._ahead or NONE), *self._travelled, *self.correction_radps, *self.drift_rad)

    def restore(self, saved: Sequence[float]) -> None:
        """Continue from a saved state."""
        ahead, self._travelled, self.correction_radps, self.drift_rad = (
            (saved[at], saved[at + 1], saved[at + 2]) for at in (1, 4, 7, 10)
        )
        self._hand, self._ahead = None, ahead if saved[0] else None

    def set_hand(self, rotation_rad: Sequence[float], travelled_rad: Sequence[float]) -> None:
        """Set rotation vector and travelled angle of the hand at the end of the frame that is stepped next."""
        self._hand = rotation_rad, travelled_rad

    def step(self, turned: Quaternion, rates_radps: Sequence[float]) -> None:
        """Account for a step: the tool's rotation from its start, and its mean rates [rad/s] without the correction."""
        here, period = self._travelled, self._frame_s
        self._travelled = (
            here[0] + period * rates_radps[0],
            here[1] + period * rates_radps[1],
            here[2] + period * rates_radps[2],
        )
        self.correction_radps = NONE
        if self._hand is None:
            return
        rotation, travelled = self._hand
        self._hand = None
        ahead = _less(self._travelled, travelled)
        if self._ahead is None:
            self._ahead = ahead
        stretch = _less(ahead, self._ahead)
        self.drift_rad = drift = between(product(exp(stretch), exp(rotation)), turned)
        rate = -SHARE / period
        self.correction_radps = rate * drift[0], rate * drift[1], rate * drift[2]


class DriftCorrection:
    """Correction of all tools in a world whose orientation is driven. Rows are of six axes, shape (n, 6), in the world's frame.

    driven     numbers of the seats that turn their tools
    drift      of each of these tools, by number of its seat
    brought_j  energy that corrections have brought in so far, which a ledger has paid: a measure on which no step depends
    """

    def __init__(self, driven: Iterable[int], frame_s: float) -> None:
        self.driven = list(driven)
        self.drift = {user: OrientationDrift(frame_s) for user in self.driven}
        self._half_frame_s = 0.5 * frame_s
        self.brought_j = 0.0

    def begin(self, user: int) -> None:
        """Begin with a tool that has just been taken, where the hand has it, or that has been let go."""
        if user in self.drift:
            self.drift[user].begin()

    def set_hand(self, user: int, rotation_rad: Sequence[float], travelled_rad: Sequence[float]) -> None:
        """See `OrientationDrift.set_hand`."""
        if user in self.drift:
            self.drift[user].set_hand(rotation_rad, travelled_rad)

    def corrected(self, u: Array, impedance: Array, level_j: float) -> Array:
        """Return the waves with what turns tools back to their hands, as far as a ledger at this level pays for it.

        impedance: of each axis, shape (n, 6).
        """
        out = u.copy()
        for user, drift in self.drift.items():
            out[user, PLACES:] += np.array(drift.correction_radps) * np.sqrt(0.5 * impedance[user, PLACES:])
        cost_j = self._half_frame_s * float(np.add.reduce(out * out - u * u, axis=None))
        if cost_j > max(0.0, level_j):
            return u
        self.brought_j += cost_j
        return out

    def watch(self, turned: Sequence[Quaternion], rates: Array, added: Array, impedance: Array) -> None:
        """Account for a step.

        turned  orientation of each driven tool in its hand's frame
        rates   mean rates of all axes [m/s, rad/s], shape (n, 6)
        added   part of the waves that is correction and came from no hand [sqrt(W)], shape (n, 6)
        """
        for (user, drift), pose in zip(self.drift.items(), turned, strict=True):
            of_hand = rates[user, PLACES:] - added[user, PLACES:] / np.sqrt(
                2.0 * impedance[user, PLACES:]
            )  # sqrt(2b) w = u + v
            drift.step(pose, of_hand.tolist())

    @property
    def saved_numbers(self) -> int:
        """Return the length of a saved state."""
        return SAVED * len(self.driven)

    def save(self) -> tuple[float, ...]:
        """Return the state between two frames."""
        return tuple([number for drift in self.drift.values() for number in drift.save()])

    def restore(self, saved: Sequence[float]) -> None:
        """Continue from a saved state."""
        for place, drift in enumerate(self.drift.values()):
            drift.restore(saved[SAVED * place : SAVED * (place + 1)])


def _less(a: Sequence[float], b: Sequence[float]) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]
