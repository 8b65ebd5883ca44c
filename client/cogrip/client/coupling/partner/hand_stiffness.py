"""Stiffness of one's own hand, estimated on line from how it gives way to its partners (theory 5b.1).

Symbols, per axis: x, v, a position, velocity and acceleration of the hand, F force of the client on it, m, d, c mass, damping
and friction of its device, b_e HAND_NSPM, k stiffness, e intention, z how far partners have moved their intentions. Lengths
in m, forces in N. In each frame, of the frame's means,

    g = F + m a + d v + c sign(v) + b_e v        e = x + g / k        D y = y_n - 2 y_{n-L} + y_{n-2L}

D takes out what goes on evenly, as most of an intention does. A hand's own moves change x and g as well, and would pass for
compliance; what the partners moved, later by the whole loop, is not of this hand's making. So z is the instrument (two-stage
least squares): of D g only the part that D z explains counts, summed over axes and frames

    M = S(Dz Dg)^2 / S(Dz^2)    u = -S(Dz Dg) S(Dz Dx) / S(Dz^2)    w = 1 / (2 L r)    1/k = (p/k_0 + w u) / (p + w M)

r is the mean square of D e where partners move, S(Dz^2 De^2) / S(Dz^2), so w M is information on 1/k, and p what is taken to
be known of k_0 before. Sums are scaled down where w M is above MOST_KNOWN p: with nothing to learn from nothing is forgotten.
"""

from collections import deque
from collections.abc import Sequence
from math import exp, log
from typing import NamedTuple

from cogrip.devices.device import Capability
from cogrip.machine.addition import add_products
from cogrip.protocol.laws.partner_model import HAND_NSPM

HAND_NPM = 150.0  # k_0, of a hand of which nothing is known
LEAST_NPM, MOST_NPM = 10.0, 400.0  # range of estimates: a stiffness told too high is what makes a loop of two unstable
SPAN_S = 0.094  # L in seconds
PRIOR_M_PER_N = 0.005  # standard deviation of 1/k before anything is known: p is 1 / PRIOR_M_PER_N^2
MOST_KNOWN = 400.0  # most information, in that before
ROUGH_M = 0.0005  # least root mean square of D e that a hand is taken to have
FOLLOW_S = 0.3  # time constant with which what is told follows the estimate
SLIDE_MPS = 0.005  # speed at which the friction of a device is half there
INSTRUMENT_S = 0.05  # time constant of z: a hand is moved later than its partner means to


class DeviceDrag(NamedTuple):
    """Mass, damping and friction of a device: what it takes of the hand's force [kg, N s/m, N]."""

    mass_kg: float
    damping_nspm: float
    friction_n: float

    @classmethod
    def of(cls, record: Capability) -> "DeviceDrag":
        """Return that of a device's record."""
        return cls(record.apparent_mass_kg, record.own_damping_nspm, record.own_friction_n)

    def force(self, velocity_mps: float) -> float:
        """Return damping and friction at a velocity [N]."""
        return self.damping_nspm * velocity_mps + self.friction_n * velocity_mps / (abs(velocity_mps) + SLIDE_MPS)


class HandStiffness:
    """Estimate of one hand's stiffness, alike on all axes.

    stiffness_npm  k as it is told
    known          part of what is known that has been learnt, from 0 to 1
    """

    def __init__(self, axes: int, tick_s: float, frame_s: float, drag: DeviceDrag) -> None:
        self._axes, self._tick_s, self._frame_s = axes, tick_s, frame_s
        self._span = max(1, round(SPAN_S / frame_s))
        self._drag = drag
        self.stiffness_npm = HAND_NPM
        self.known = 0.0
        self._zg = self._zx = self._zz = 0.0
        self._zr = 0.0
        self.begin()

    def begin(self) -> None:
        """Begin with another stretch of motion: nothing is compared across a gap. What is known stays."""
        zero = [0.0] * self._axes
        self._sums: list[list[float]] | None = None
        self._ticks, self._begun_mps = 0, zero
        self._moved, self._instrument = list(zero), list(zero)
        self._frames: deque[tuple[list[float], list[float], list[float]]] = deque(maxlen=2 * self._span + 1)

    def enter(self, position_m: Sequence[float], velocity_mps: Sequence[float], force_n: Sequence[float]) -> None:
        """Enter a tick of the frame under way."""
        if self._sums is None:
            self._sums = [[0.0] * self._axes for _ in range(3)]
            self._begun_mps, self._ticks = list(velocity_mps), 0
        places, forces, speeds = self._sums
        for axis, x in enumerate(position_m):
            places[axis] += x
            forces[axis] += force_n[axis]
            speeds[axis] += velocity_mps[axis]
        self._ticks += 1
        self._newest_mps = velocity_mps

    def stir(self, axis: int, moved_m: float) -> None:
        """Enter how far partners have moved an object that nobody else holds, by moving their intentions."""
        self._moved[axis] += moved_m

    def end_frame(self) -> None:
        """End the frame, and learn from it."""
        sums, ticks = self._sums, self._ticks
        if sums is None or not ticks:
            if self._frames:
                self.begin()
            return
        self._sums = None
        places, forces, speeds = sums
        pole = min(1.0, self._frame_s / INSTRUMENT_S)
        row: tuple[list[float], list[float], list[float]] = ([], [], [])
        for axis in range(self._axes):
            gained = (self._newest_mps[axis] - self._begun_mps[axis]) / (max(1, ticks - 1) * self._tick_s)
            row[0].append(places[axis] / ticks)
            speed = speeds[axis] / ticks
            force = forces[axis] / ticks + self._drag.force(speed) + HAND_NSPM * speed
            row[1].append(self._drag.mass_kg * gained + force)
            self._instrument[axis] += pole * (self._moved[axis] - self._instrument[axis])
            row[2].append(self._instrument[axis])
        self._frames.append(row)
        if len(self._frames) == 2 * self._span + 1:
            self._learn()

    def _learn(self) -> None:
        first, middle, last = self._frames[0], self._frames[self._span], self._frames[-1]
        x, g, z = (
            [a - 2.0 * b + c for a, b, c in zip(first[part], middle[part], last[part], strict=True)]
            for part in range(3)
        )
        own = [at + each / self.stiffness_npm for at, each in zip(x, g, strict=True)]
        square = add_products(z, z)
        self._zz += square
        self._zr += square * (add_products(own, own) + ROUGH_M * ROUGH_M)
        self._zg += add_products(z, g)
        self._zx += add_products(z, x)
        if self._zz <= 0.0:
            return
        weight = PRIOR_M_PER_N**2 * self._zz / (2.0 * self._span * self._zr)  # w / p
        information = weight * self._zg * self._zg / self._zz
        if information > MOST_KNOWN:
            part = MOST_KNOWN / information
            self._zz, self._zr = part * self._zz, part * self._zr
            self._zg, self._zx = part * self._zg, part * self._zx
            information = MOST_KNOWN
        self.known = information / (1.0 + information)
        compliance = (1.0 / HAND_NPM - weight * self._zg * self._zx / self._zz) / (1.0 + information)
        wanted = 1.0 / min(1.0 / LEAST_NPM, max(1.0 / MOST_NPM, compliance))
        self.stiffness_npm *= exp(self._frame_s / FOLLOW_S * log(wanted / self.stiffness_npm))
