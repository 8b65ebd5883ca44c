"""The object that people grip, in plain floats, beside the same equations in arrays: answers, and energy over hours."""

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from cogrip.machine.addition import add_floats
from cogrip.protocol.laws.waves import proxy_velocity, server_wave
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.worlds.grip import GripWorld
from cogrip.server.worlds.grip_step import MOST_SAVED_J, RAMP_S
from cogrip.server.worlds.world import Array, World, dot

from tests.server.object_worlds import FOLLOWING, drawn_seats, seats


class ArrayGrip(World):
    """The same object by its equations in arrays (theory 3.3, 3.7): sums are added in another order."""

    can_adapt_stiffness = True

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        super().__init__(seats)
        self.stretch = np.zeros_like(self.force)
        self._ledger = np.zeros(len(seats))  # energy that each user's spring may spend on growing stiffer [J]
        self._growing = False
        self._saving = bool(self.adapts_stiffness.any())

    def set_target_stiffness(self, user: int, stiffness_npm: float) -> None:
        self.target_stiffness[user] = stiffness_npm
        self._growing = True

    def join(self, user: int, position_m: Array) -> None:
        self.offset[user] = position_m - self.position
        self.stretch[user] = 0.0
        self.stiffness[user] = 0.0
        self.damping[user] = self.target_damping[user]
        self._ledger[user] = 0.0
        self.holding[user] = True
        self._growing = True

    def leave(self, user: int) -> None:
        self.holding[user] = False
        self.stretch[user] = self.stiffness[user] = self.damping[user] = self.force[user] = 0.0

    @property
    def energy_j(self) -> float:
        stretch, velocity = self.stretch, self.velocity
        stored = 0.5 * (dot(self.stiffness * stretch, stretch) + self.mass_kg * dot(velocity, velocity))
        return stored + float(self._ledger.sum())

    def proxy(self, user: int) -> Array:
        place: Array = self.position + self.stretch[user] + self.offset[user]
        return place

    def step(self, inputs: Array) -> Array:
        period, b, c = self.frame_s, self.impedance, self.wave_gain
        K, B, e, u = self.stiffness, self.damping, self.stretch, inputs
        inertia = 2.0 * self.mass_kg / period
        G = K * (0.5 * period) + B
        gain = 1.0 / (1.0 + G / b)
        alpha = (K * e + G * c * u) * gain
        beta = G * gain
        pull = inertia * self.velocity + alpha.sum(axis=0) + self.external_force
        mid = pull / (inertia + self.object_damping + beta.sum())
        force = alpha - beta * mid
        back: Array = server_wave(c, u, force)
        relative = proxy_velocity(b, c, u, force) - mid
        grown = e + period * relative
        velocity = 2.0 * mid - self.velocity

        stored_before = 0.5 * (dot(K * e, e) + self.mass_kg * dot(self.velocity, self.velocity))
        stored = 0.5 * (dot(K * grown, grown) + self.mass_kg * dot(velocity, velocity))
        port = (0.5 * period) * (u * u - back * back).sum(axis=1)
        lost = period * (dot(B * relative, relative) + self.object_damping * dot(mid, mid))
        supplied = add_floats(port.tolist()) + period * dot(self.external_force, mid)
        self.balance_error_j = max(self.balance_error_j, abs(supplied - (stored - stored_before) - lost))

        self._count_work(port)
        self.force = force
        self.stretch = grown
        self.position = self.position + period * mid
        self.velocity = velocity
        if self._growing or self._saving:
            self._ledger += period * (B * relative * relative).sum(axis=1)
        if self._growing:
            self._grow()
        if self._saving:
            np.minimum(self._ledger, MOST_SAVED_J, out=self._ledger, where=self.adapts_stiffness)
        return back

    def _grow(self) -> None:
        """Move K towards its target. To raise it costs dK e^2 / 2, which is paid from what the user's own damper has taken
        (theory section 3.7); to lower it takes as much from the spring, which the ledger keeps."""
        square = (self.stretch * self.stretch).sum(axis=1)
        wanted = np.minimum(
            self.target_stiffness[:, 0] * (self.frame_s / RAMP_S), self.target_stiffness[:, 0] - self.stiffness[:, 0]
        )
        affordable = np.divide(2.0 * self._ledger, square, out=np.full_like(square, np.inf), where=square > 0.0)
        step = np.where(self.holding, np.minimum(wanted, affordable), 0.0)
        self._ledger -= 0.5 * step * square
        self.stiffness[:, 0] += step
        self._growing = bool(np.any(self.holding & (self.stiffness[:, 0] != self.target_stiffness[:, 0])))


@pytest.mark.parametrize("follow", [False, True])
@given(st.integers(1, 9), st.integers(1, 3), st.integers(0, 2**32 - 1))
def test_people_are_stepped_by_the_equations(follow: bool, count: int, axes: int, seed: int) -> None:
    """They come, hold, and go at random moments, while their stiffness grows, as well as after, and where it follows."""
    random = np.random.default_rng(seed)
    people = drawn_seats(random, count, axes, **(FOLLOWING if follow else {}))
    many, few = ArrayGrip(people), GripWorld(people)

    def alike(one: ArrayLike, other: ArrayLike, least: float) -> None:
        """numpy's own assertion costs ten times more."""
        loose = 100.0 if follow else 1.0  # a spring that is paid for from a ledger keeps fewer digits
        assert (np.abs(np.subtract(one, other)) <= loose * (least + 1e-9 * np.abs(other))).all()

    def both(what: str, *given: object) -> None:
        for world in (many, few):
            getattr(world, what)(*given)

    for step in range(150):
        user = int(random.integers(count))
        if step % 25 == 0:
            both("join", user, random.uniform(-0.1, 0.1, axes))
        elif step % 40 == 39:
            both("leave", user)
        if step % 7 == 3:  # a person's client chooses another impedance
            both("set_impedance", user, 1.0 + step)
        if follow and step % 4 == 0:
            both("set_target_stiffness", user, people[user].rendered_npm * 10.0 ** random.uniform(-1.0, 1.0))
        many.external_force = few.external_force = random.uniform(-1.0, 1.0, axes)
        waves = random.uniform(-0.5, 0.5, (count, axes))
        rows = few.advance([tuple(row) for row in waves.tolist()])
        alike(rows, many.step(waves), 1e-11)
        for name in ("position", "velocity", "stretch", "damping", "port_work"):
            alike(getattr(few, name), getattr(many, name), 1e-10)
        alike(few.stiffness, many.stiffness, 0.0)
        alike(few.force, many.force, 1e-8)
        for number in range(count):
            alike(few.proxy(number), many.proxy(number), 1e-11)
            assert few.accounts.stiffness(number) == few.stiffness[number, 0]
    scale = 1.0 + float(np.abs(many.port_work).max())
    assert few.balance_error_j <= 1e-12 * scale + 10.0 * many.balance_error_j


def test_the_arrays_are_not_to_be_written_to() -> None:
    world = GripWorld(seats(2, axes=3))
    for name in ("position", "velocity", "stretch", "stiffness", "damping", "force", "port_work"):
        assert not getattr(world, name).flags.writeable, name
    world.position = np.array([0.1, 0.2, 0.3])
    assert world.motion() == (0.1, 0.2, 0.3, 0.0, 0.0, 0.0)


def test_the_work_of_hours_is_within_two_roundings_of_the_true_one() -> None:
    """Small steps beside a large sum: a plain one is out by up to half its last digit each time."""
    world, start = GripWorld(seats(2)), 1e7 / 3.0
    for user in range(2):
        world.join(user, np.zeros(1))
    world.port_work = np.array([start, -start])
    true, plain = [Fraction(start), Fraction(-start)], [start, -start]
    rows = [(0.4,), (0.3,)]
    for _ in range(2000):
        answers = world.advance(rows)
        for user, ((u,), (v,)) in enumerate(zip(rows, answers, strict=True)):
            work = (0.5 * world.frame_s) * (u * u - v * v)
            true[user] += Fraction(work)
            plain[user] += work
    for user, work in enumerate(world.port_work_j()):
        assert abs(Fraction(work) - true[user]) <= Fraction(2.0**-52) * Fraction(start) * 2
    out = max(abs(Fraction(sum_) - work) for sum_, work in zip(plain, true, strict=True))
    assert out > Fraction(2.0**-52) * Fraction(start) * 4, "else nothing is shown"
    world.start_ledger(1)
    assert list(world.port_work_j()) == [world.port_work[0], 0.0]
