"""`GripWorld` for few people: the same step in plain floats, for which numpy takes three times as long.

Equations and books are those of `grip.py` (theory sections 3.3 and 3.7), term by term. Sums may be added up in another order,
so that the two agree to the last bits; a room has the same of the two from beginning to end, and in every replay.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cogrip.protocol.settings import SeatSettings
from cogrip.server.worlds.grip import RAMP_S, GripWorld
from cogrip.server.worlds.world import MOST_SAVED_J, Array, Row

MOST = 18  # people times axes, up to which this is faster: rooms of six in three axes

Rows = list[list[float]]


class Port(NamedTuple):
    """One user's constants of a step: G = K T / 2 + B, gain = G c, share = 1 / (1 + G / b), beta = G share."""

    K: float
    B: float
    b: float
    c: float
    gain: float
    share: float
    beta: float


class SmallGripWorld(GripWorld):
    """State is in lists; what `GripWorld` has as arrays is made of them when asked for, to be read or set as a whole."""

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        self._ports: list[Port] = []
        super().__init__(seats)
        self._paid_j = [0.0] * len(seats)  # the ledger
        self._excess_j = [0.0] * len(seats)  # of `_work` over the true sum
        self._follows: list[bool] = self.follows.tolist()

    def _weigh(self) -> list[Port]:
        """What follows from stiffness and damping, which have changed."""
        impedances, gains = self.impedance[:, 0].tolist(), self.wave_gain[:, 0].tolist()
        for K, B, b, c in zip(self._K, self._B, impedances, gains, strict=True):
            G = K * (0.5 * self.frame_s) + B
            share = 1.0 / (1.0 + G / b)
            self._ports.append(Port(K, B, b, c, G * c, share, G * share))
        self._beta = sum([port.beta for port in self._ports])
        return self._ports

    def join(self, user: int, position_m: Array) -> None:
        self.offset[user] = position_m - self._place
        self._stretch[user] = [0.0] * self.axes
        self._K[user], self._B[user] = 0.0, float(self.target_damping[user, 0])
        self._paid_j[user] = 0.0
        self.roster[user] = True
        self._growing = True
        self._ports = []

    def leave(self, user: int) -> None:
        self.roster[user] = False
        self._stretch[user], self._force[user] = [0.0] * self.axes, [0.0] * self.axes
        self._K[user] = self._B[user] = 0.0
        self._ports = []

    def step(self, inputs: Array) -> Array:
        return np.array(self.advance(inputs.tolist()))

    def advance(self, rows: Sequence[Row]) -> Sequence[Sequence[float]]:
        period, ports = self.frame_s, self._ports or self._weigh()
        inertia = 2.0 * self.mass_kg / period
        weight = inertia + self.object_damping + self._beta
        stretch, speed, place = self._stretch, self._speed, self._place
        mids = []
        gained = lost = supplied = 0.0  # of object and springs [J / 2, W, W]
        for axis, external in enumerate(self._external):
            was = speed[axis]
            pull = inertia * was + external
            for u, e, port in zip(rows, stretch, ports, strict=True):
                pull += (port.K * e[axis] + port.gain * u[axis]) * port.share
            mid = pull / weight
            mids.append(mid)
            speed[axis] = now = 2.0 * mid - was
            place[axis] += period * mid
            gained += self.mass_kg * (now * now - was * was)
            lost += self.object_damping * mid * mid
            supplied += external * mid
        came = 0.0
        answers = []
        taken = []  # by each user's damper [W]
        for number, (u, e, (K, B, b, c, gain, share, beta)) in enumerate(zip(rows, stretch, ports, strict=True)):
            force, answer = self._force[number], []
            squares = relatives = springs = 0.0
            for axis, mid in enumerate(mids):
                wave, was = u[axis], e[axis]
                force[axis] = f = (K * was + gain * wave) * share - beta * mid
                back = wave - c * f  # `server_wave` and `proxy_velocity` inline, for the same reason
                answer.append(back)
                relative = c * wave - f / b - mid
                e[axis] = now = was + period * relative
                squares += wave * wave - back * back
                relatives += relative * relative
                springs += now * now - was * was
            work = (0.5 * period) * squares
            came += work
            before = self._work[number]  # `add_compensated` inline: calls cost 6 % of this step
            work -= self._excess_j[number]
            self._work[number] = total = before + work
            self._excess_j[number] = (total - before) - work
            gained += K * springs
            lost += B * relatives
            answers.append(answer)
            taken.append(B * relatives)
        self.balance_error_j = max(self.balance_error_j, abs(came + period * supplied - 0.5 * gained - period * lost))
        if self._growing or self._saving:
            self._save(taken)
        if self._growing:
            self._grow_now()
        if self._saving:
            for user, follows in enumerate(self._follows):
                if follows and self._paid_j[user] > MOST_SAVED_J:
                    self._paid_j[user] = MOST_SAVED_J
        return answers

    def _save(self, taken_w: Sequence[float]) -> None:
        for user, power in enumerate(taken_w):
            self._paid_j[user] += self.frame_s * power

    def _grow_now(self) -> None:
        """As `_grow`: move K towards its target, paid from what the user's own damper has taken."""
        self._growing = False
        for user, (e, target) in enumerate(zip(self._stretch, self.target_stiffness[:, 0].tolist(), strict=True)):
            if not self.roster[user]:
                continue
            square = sum([value * value for value in e])
            step = min(target * (self.frame_s / RAMP_S), target - self._K[user])
            if square > 0.0:
                step = min(step, 2.0 * self._paid_j[user] / square)
            self._paid_j[user] -= 0.5 * step * square
            self._K[user] += step
            self._growing = self._growing or self._K[user] != target
        self._ports = []

    def proxy(self, user: int) -> Array:
        return np.array(self.proxy_of(user))

    def proxy_of(self, user: int) -> Row:
        offset = self.offset[user].tolist()
        return tuple([x + e + away for x, e, away in zip(self._place, self._stretch[user], offset, strict=True)])

    def stiffness_of(self, user: int) -> float:
        return self._K[user]

    def force_of(self, user: int) -> Row:
        return tuple(self._force[user])

    def motion(self) -> Row:
        return (*self._place, *self._speed)

    def worked(self) -> Sequence[float]:
        return self._work

    def start_ledger(self, user: int) -> None:
        self._work[user] = self._excess_j[user] = 0.0

    @property
    def position(self) -> Array:
        return _shown(self._place)

    @position.setter
    def position(self, value: Array) -> None:
        self._place = value.tolist()

    @property
    def velocity(self) -> Array:
        return _shown(self._speed)

    @velocity.setter
    def velocity(self, value: Array) -> None:
        self._speed = value.tolist()

    @property
    def external_force(self) -> Array:
        return _shown(self._external)

    @external_force.setter
    def external_force(self, value: Array) -> None:
        self._external = value.tolist()

    @property
    def port_work(self) -> Array:
        return _shown(self._work)

    @port_work.setter
    def port_work(self, value: Array) -> None:
        self._work: list[float] = value.tolist()

    @property
    def force(self) -> Array:
        return _shown(self._force)

    @force.setter
    def force(self, value: Array) -> None:
        self._force = value.tolist()

    @property
    def stretch(self) -> Array:
        return _shown(self._stretch)

    @stretch.setter
    def stretch(self, value: Array) -> None:
        self._stretch: Rows = value.tolist()

    @property
    def stiffness(self) -> Array:
        return _shown([[K] for K in self._K])

    @stiffness.setter
    def stiffness(self, value: Array) -> None:
        self._K: list[float] = value[:, 0].tolist()
        self._ports = []

    @property
    def damping(self) -> Array:
        return _shown([[B] for B in self._B])

    @damping.setter
    def damping(self, value: Array) -> None:
        self._B: list[float] = value[:, 0].tolist()
        self._ports = []


def _shown(values: Sequence[float] | Rows) -> Array:
    """Not to be written to: nothing would come of it."""
    array = np.array(values)
    array.setflags(write=False)
    return array
