"""`GripWorld` for few people: the same step in plain floats, three times as fast as numpy.

Equations and energy ledger are those of `grip.py` (theory sections 3.3 and 3.7), term by term. Sums are added in another order,
so that the two agree but for the last bits; a room has one of the two from beginning to end, and in every replay.
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
    """Constants of one user's step: G = K T / 2 + B, drive = G c, gain = 1 / (1 + G / b), beta = G gain."""

    K: float
    B: float
    b: float
    c: float
    drive: float
    gain: float
    beta: float


class ListState:
    """Attribute of a world that holds a list as a read-only array. column: shape (n, 1), and the ports change with it."""

    def __init__(self, name: str, *, column: bool = False) -> None:
        self._name = name
        self._column = column

    def __get__(self, world: "SmallGripWorld", owner: type) -> Array:
        array = np.array(getattr(world, self._name))
        array.setflags(write=False)
        return array[:, None] if self._column else array

    def __set__(self, world: "SmallGripWorld", value: Array) -> None:
        setattr(world, self._name, (value[:, 0] if self._column else value).tolist())
        if self._column:
            world.ports_changed()


class SmallGripWorld(GripWorld):
    """State in lists; the arrays of `GripWorld` are views of them, to be read or set as a whole."""

    kept = ("_paid_j", "_excess_j")
    _place: list[float]
    _speed: list[float]
    _external: list[float]
    _work: list[float]
    _force: Rows
    _stretch: Rows
    _K: list[float]
    _B: list[float]

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        self._ports: list[Port] = []
        super().__init__(seats)
        self._paid_j = [0.0] * len(seats)  # the ledger
        self._excess_j = [0.0] * len(seats)  # of `_work` over the exact sum
        self._follows: list[bool] = self.follows.tolist()

    @property
    def energy_j(self) -> float:
        return super().energy_j + sum(self._paid_j)

    def ports_changed(self) -> None:
        """Let the next step compute the ports' constants anew."""
        self._ports = []

    def impedance_changed(self, user: int) -> None:
        super().impedance_changed(user)
        self.ports_changed()

    def _update_ports(self) -> list[Port]:
        """Return the constants of stiffness and damping, which have changed."""
        impedances, wave_gains = self.impedance[:, 0].tolist(), self.wave_gain[:, 0].tolist()
        for K, B, b, c in zip(self._K, self._B, impedances, wave_gains, strict=True):
            G = K * (0.5 * self.frame_s) + B
            gain = 1.0 / (1.0 + G / b)
            self._ports.append(Port(K, B, b, c, G * c, gain, G * gain))
        self._beta = sum([port.beta for port in self._ports])
        return self._ports

    def join(self, user: int, position_m: Array) -> None:
        self.offset[user] = position_m - self._place
        self._stretch[user] = [0.0] * self.axes
        self._K[user], self._B[user] = 0.0, float(self.target_damping[user, 0])
        self._paid_j[user] = 0.0
        self.holding[user] = True
        self._growing = True
        self._ports = []

    def leave(self, user: int) -> None:
        self.holding[user] = False
        self._stretch[user], self._force[user] = [0.0] * self.axes, [0.0] * self.axes
        self._K[user] = self._B[user] = 0.0
        self._ports = []

    def step(self, inputs: Array) -> Array:
        return np.array(self.advance(inputs.tolist()))

    def advance(self, rows: Sequence[Row]) -> Sequence[Sequence[float]]:
        period, ports = self.frame_s, self._ports or self._update_ports()
        inertia = 2.0 * self.mass_kg / period
        weight = inertia + self.object_damping + self._beta
        stretch, speed, place = self._stretch, self._speed, self._place
        mids = []
        gained = lost = supplied = 0.0  # of object and springs [J / 2, W, W]
        for axis, external in enumerate(self._external):
            was = speed[axis]
            pull = inertia * was + external
            for u, e, port in zip(rows, stretch, ports, strict=True):
                pull += (port.K * e[axis] + port.drive * u[axis]) * port.gain
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
        for number, (u, e, (K, B, b, c, drive, gain, beta)) in enumerate(zip(rows, stretch, ports, strict=True)):
            force, answer = self._force[number], []
            squares = relatives = springs = 0.0
            for axis, mid in enumerate(mids):
                wave, was = u[axis], e[axis]
                force[axis] = f = (K * was + drive * wave) * gain - beta * mid
                back = wave - c * f  # `server_wave` and `proxy_velocity` inline: a call costs 6 % of the step
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
        """Move K towards its target, as `_grow` does."""
        self._growing = False
        for user, (e, target) in enumerate(zip(self._stretch, self.target_stiffness[:, 0].tolist(), strict=True)):
            if not self.holding[user]:
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

    position = ListState("_place")
    velocity = ListState("_speed")
    external_force = ListState("_external")
    port_work = ListState("_work")
    force = ListState("_force")
    stretch = ListState("_stretch")
    stiffness = ListState("_K", column=True)
    damping = ListState("_B", column=True)
