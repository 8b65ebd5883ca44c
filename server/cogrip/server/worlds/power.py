"""Object between proxies that are led by velocity, each with no more energy than its person has sent (Ryu 2010).

The admittance form of the passivity controller, w = g - beta F, is solved in the same implicit step as the object. Per axis
and user, along the direction s = +-1 in which a face is pushed (s = 1 for a cube): K, B spring and damper, e stretch before
the step, g velocity that was asked for, v the object's, w the proxy's, W energy that may come out, T frame.

    grip, midpoint:         G = K T/2 + B      F = K e + G (w - v)              (theory 3.3 with w given: b -> infinity)
    push, implicit Euler:   G = K T + B        F = max(0, K e + G (w - v))      (theory 3.4)

With r = K e - G v and w = g - c F, F is p = (r + G g)/(1 + G c). If p g T <= W that is it. Else g is drawn back to g' with
F g' T = W: (1 + G c) F^2 - r F - G W/T = 0 has one root of p's sign between 0 and p, and w = (F - r)/G, which is
g - (beta + c) F with beta >= 0. F falls (weakly) as v grows, so m (v - v_o)/T + b_o v = sum s F(v) + F_ext (midpoint: 2 m)
has one root: Newton within bounds.

Each step's balance is that of theory 3.3 or 3.4, with F w T for the energy of a port: the world is passive at its ports for
any K, B, b_o, m_o and n, and what comes out of a channel is at most W, whatever was asked for.

Drift compensation (Chawda et al. 2014): what the controller, or a lost message, left between proxy and hand is asked for
beside the hand's own velocity, a share a frame: the same controller lets it through as far as the energy goes. Yielding,
c > 0, pays in for a client that has nothing left to take (the energy of a force F moves back with it: F c F T a step).
"""

from collections.abc import Sequence
from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Row
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.worlds.world import Array, HandWorld

DRIFT_SHARE = 0.125  # share of the way from proxy to hand that is asked for in one frame
DRIFT_MPS = 0.1  # largest speed that is asked for on the way from proxy to hand
GIVE_SHARE = 0.25  # share of 1/b with which a proxy yields to its force while its client has nothing to take
MOST_ITERATIONS = 60


class Led(NamedTuple):
    """Proxy of one user on one axis, along its own direction `side`."""

    rest: float  # K e
    gain: float  # G
    asked: float  # g
    power: float  # W / T
    give: float  # c
    side: float
    one_sided: bool

    def answer(self, velocity: float) -> tuple[float, float, float]:
        """Return F, w and dF/dv for the object's velocity along `side`."""
        gain, asked = self.gain, self.asked
        at_rest = self.rest - gain * velocity  # r
        yielding = 1.0 + gain * self.give
        free = (at_rest + gain * asked) / yielding  # p
        if self.one_sided and free <= 0.0:
            return 0.0, asked, 0.0
        if free * asked <= self.power:
            return free, asked - self.give * free, -gain / yielding
        sign = 1.0 if free > 0.0 else -1.0
        toward = sign * at_rest
        # never less than |r|, though squares of less than 1e-154 lose their digits
        root = max(abs(at_rest), sqrt(at_rest * at_rest + 4.0 * yielding * gain * self.power))
        if toward > 0.0:
            size = 0.5 * (toward + root) / yielding
        else:  # the same number, without cancellation
            size = 2.0 * gain * self.power / (root - toward) if root else 0.0
        slope = -0.5 * gain * (1.0 + toward / root) / yielding if root else 0.0
        # (F - r) / G, in the form that F w is exact in
        led = self.power / size - self.give * size if size else -toward / gain
        return sign * size, sign * led, slope


class PowerWorld(HandWorld):
    """Inputs, shape (n, 4a): where each proxy is to be [m] in its user's own frame, how it is to go there [m/s], what may come
    out on each axis in this step [J], and how much the client has to take, of 1. Back go force [N] and the proxy's velocity
    [m/s], shape (n, 2a).
    """

    kept = ("controlled",)
    inputs_per_axis = 4

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        super().__init__(seats)
        self._sides: list[float] = self.side.tolist()
        self._springs: list[tuple[float, float]] = []  # K, B of each user
        self.controlled = 0  # steps, users and axes in which the controller drew a proxy back

    def step(self, inputs: Array) -> Array:
        return np.array(self.advance(inputs.tolist()))

    def advance(self, rows: Sequence[Row]) -> Sequence[Sequence[float]]:
        axes, period = self.axes, self.frame_s
        place, speed, hands = self.position.tolist(), self.velocity.tolist(), self.hand.tolist()
        external, offsets = self.external_force.tolist(), self.offset.tolist()
        forces, impedances = self.force.tolist(), self.impedance[:, 0].tolist()
        self._springs = list(zip(self.stiffness[:, 0].tolist(), self.damping[:, 0].tolist(), strict=True))
        answers = [[0.0] * (2 * axes) for _ in rows]
        work = [0.0] * len(rows)
        gained = 0.0  # stored and lost, less what was supplied
        for axis in range(axes):
            touching = axis == 0 or not self.one_sided
            proxies = []
            for number in np.flatnonzero(self.holding).tolist():
                stretch = hands[number][axis] - place[axis]
                aim, pace, energy, filled = rows[number][axis::axes]
                drift = (aim - offsets[number][axis] - hands[number][axis]) / period - pace
                if self.one_sided and drift * forces[number][axis] > 0.0:
                    drift *= filled
                asked = pace + max(-DRIFT_MPS, min(DRIFT_MPS, DRIFT_SHARE * drift))
                give = GIVE_SHARE * (1.0 - filled) / impedances[number]
                proxies.append((number, stretch, self._led(number, touching, stretch, asked, energy, give)))
            before, pull = speed[axis], external[axis]
            velocity = 0.0 if self.fixed else self._velocity([led for _, _, led in proxies], before, pull)
            for number, stretch, led in proxies:
                size, along, _ = led.answer(led.side * velocity)
                self.controlled += along != led.asked - led.give * size
                force, proxy_velocity = led.side * size, led.side * along
                answers[number][axis], answers[number][axes + axis] = force, proxy_velocity
                work[number] += force * proxy_velocity * period
                hands[number][axis] += period * proxy_velocity
                if touching:
                    gained += self._kept(number, led.side, stretch, proxy_velocity - velocity)
            if not self.fixed:
                place[axis] += period * velocity
                speed[axis] = velocity if self.one_sided else 2.0 * velocity - before
                gained += 0.5 * self.mass_kg * (speed[axis] * speed[axis] - before * before)
                gained += period * velocity * (self.object_damping * velocity - pull)
        error = gained - add_floats(work)
        self.balance_error_j = max(self.balance_error_j, error if self.one_sided else abs(error))
        self._count_work(np.array(work))
        self.force, self.hand = np.array([answer[:axes] for answer in answers]), np.array(hands)
        self.position, self.velocity = np.array(place), np.array(speed)
        return answers

    def _led(self, number: int, touching: bool, stretch: float, asked: float, energy: float, give: float) -> Led:
        stiffness, damping = self._springs[number] if touching else (0.0, 0.0)
        side = self._sides[number] if self.one_sided else 1.0
        gain = stiffness * self.frame_s * (1.0 if self.one_sided else 0.5) + damping
        return Led(
            stiffness * side * stretch, gain, side * asked, max(0.0, energy) / self.frame_s, give, side, self.one_sided
        )

    def _kept(self, number: int, side: float, stretch: float, relative: float) -> float:
        """Return the energy that spring and damper of one user took in the step [J]."""
        stiffness, damping = self._springs[number]
        period = self.frame_s
        after = stretch + period * relative
        if not self.one_sided:
            return 0.5 * stiffness * (after * after - stretch * stretch) + period * damping * relative * relative
        was, now = max(0.0, side * stretch), max(0.0, side * after)
        return 0.5 * stiffness * (now * now - was * was)

    def _velocity(self, proxies: Sequence[Led], before: float, pull: float) -> float:
        """Return the object's (midpoint) velocity, by Newton within bounds. The residual rises by at least the object's own
        slope, so the root lies between the Newton steps of the object alone and of that with every spring in full.
        """
        inertia = self.mass_kg / self.frame_s * (1.0 if self.one_sided else 2.0)
        own = inertia + self.object_damping
        impulse = inertia * before + pull
        velocity = impulse / own
        low, high = -inf, inf
        for _ in range(MOST_ITERATIONS):
            excess, slope = own * velocity - impulse, own
            for led in proxies:
                force, _, fall = led.answer(led.side * velocity)
                excess -= led.side * force
                slope -= fall
            if excess > 0.0:
                high = velocity
            elif excess < 0.0:
                low = velocity
            else:
                break
            step = velocity - excess / slope
            if not low < step < high:  # not before both are known
                step = 0.5 * (low + high)
            if not low < step < high:  # no number is left between them
                break
            velocity = step
        return velocity
