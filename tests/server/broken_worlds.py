"""A sound world, and worlds that break one promise each: what the conformance suite and the guard are tried on."""

from collections.abc import Sequence
from contextlib import suppress
from typing import Any, ClassVar

import numpy as np

from cogrip.machine.rows import Row
from cogrip.protocol.laws.rotations import exp, log, product
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.worlds.tool_world import ToolWorld
from cogrip.server.worlds.world import Array


def seats(count: int = 2, axes: int = 2) -> list[SeatSettings]:
    users = [{"name": f"user{number}"} for number in range(count)]
    settings = resolve({"object": {"kind": "springs", "axes": axes}, "users": users})
    return [seat_settings(settings, number) for number in range(count)]


class Springs(ToolWorld):
    """Masses on springs, one for each seat: sound."""

    kept = ("place", "speed")
    npm: float | Array = 200.0
    friction_nspm: float | Array = 0.0

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        super().__init__(seats)
        self.inertia = self.mass_kg
        self.place, self.speed = np.zeros_like(self.force), np.zeros_like(self.force)

    @property
    def tools(self) -> Array:
        return self.place

    def energies_j(self) -> Array:
        return 0.5 * (self.inertia * self.speed**2 + self.npm * self.place**2)

    @property
    def energy_j(self) -> float:
        return float(self.energies_j().sum())

    def move(self, force_n: Array, damping_nspm: Array) -> None:
        inertia = 2.0 * self.inertia / self.frame_s
        resistance = inertia + damping_nspm + self.friction_nspm + 0.5 * self.frame_s * self.npm
        mean = (inertia * self.speed + force_n - self.npm * self.place) / resistance
        self.place, self.speed = self.moved(self.frame_s * mean), 2.0 * mean - self.speed

    def moved(self, by: Array) -> Array:
        return self.place + by


class InPlace(Springs):
    """Steps its arrays in place, as a beginner would: sound, as the base copies what it needs."""

    def move(self, force_n: Array, damping_nspm: Array) -> None:
        place, speed = self.place, self.speed
        super().move(force_n, damping_nspm)
        place[:], speed[:] = self.place, self.speed
        self.place, self.speed = place, speed


class Tumbling(Springs):
    """Bodies on springs that turn as they are turned, against friction: sound. Their inertia is the same about every axis."""

    axes_allowed = (6,)
    npm = np.repeat((200.0, 0.0), 3)
    inertia_kgm2, friction_nms = 4e-4, 1e-3
    friction_nspm = np.repeat((0.0, friction_nms), 3)

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        super().__init__(seats)
        each = np.ones((1, 3))
        self.inertia = np.concatenate((self.mass_kg * each, self.inertia_kgm2 * each), axis=1)

    def moved(self, by: Array) -> Array:
        """Return the poses that are reached by displacements and rotation vectors."""
        place = super().moved(by)
        place[:, 3:] = [log(product(exp(turn[3:]), exp(pose[3:]))) for turn, pose in zip(by, self.place, strict=True)]
        return place


class AddsRotationVectors(Tumbling):
    """Takes the sum of two rotation vectors for the rotation by one and then the other."""

    def moved(self, by: Array) -> Array:
        return self.place + by


class ForgetsRotation(Tumbling):
    @property
    def energy_j(self) -> float:
        return float(self.energies_j()[:, :3].sum())


class CreatesSlowly(Springs):
    """Moves a millionth faster after each frame, which friction at a hand hides."""

    def move(self, force_n: Array, damping_nspm: Array) -> None:
        super().move(force_n, damping_nspm)
        self.speed = self.speed * 1.00003


class CreatesFarOut(Springs):
    """Loses a part of its potential energy's count beyond 2 cm: a spring that softens, without paying for it."""

    def move(self, force_n: Array, damping_nspm: Array) -> None:
        super().move(force_n, damping_nspm)
        self.speed = self.speed * (1.0 + 0.001 * (np.abs(self.place) > 0.02))


class CreatesAlone(Springs):
    """Makes energy while nobody holds it."""

    def move(self, force_n: Array, damping_nspm: Array) -> None:
        super().move(force_n, damping_nspm)
        if not self.holding.any():
            self.speed = self.speed + 1e-4


class ExplicitEuler(Springs):
    """Steps by the explicit Euler rule, which makes energy in every swing."""

    def move(self, force_n: Array, damping_nspm: Array) -> None:
        push = force_n - damping_nspm * self.speed - self.npm * self.place
        self.place = self.place + self.frame_s * self.speed
        self.speed = self.speed + self.frame_s / self.mass_kg * push


class HidesEnergy(Springs):
    """Counts no energy, and so seems to make what it gives back."""

    energy_j = 0.0  # type: ignore[assignment]


class CountsTwice(Springs):
    @property
    def energy_j(self) -> float:
        return super().energy_j + 0.5 * float((self.npm * self.place**2).sum())


class CountsFromAbove(Springs):
    """Counts energy from a place that it can fall below."""

    @property
    def energy_j(self) -> float:
        return super().energy_j - 0.5 * float(self.place.sum())


class HoldsMuch(Springs):
    """Is stretched at first: 40 J that people would get."""

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        super().__init__(seats)
        self.place = self.place + 0.31


class ForgetsSpeed(Springs):
    @classmethod
    def _saved_names(cls) -> list[str]:
        return [name for name in super()._saved_names() if name != "speed"]


class ForgetsCount(Springs):
    """Does not save a count that only matters every 64 frames."""

    frame = 0

    def move(self, force_n: Array, damping_nspm: Array) -> None:
        super().move(force_n, damping_nspm)
        self.frame += 1
        if self.frame % 64 == 0:
            self.speed = 0.5 * self.speed


class SharesState(Springs):
    """Keeps its speed in the class, for all rooms."""

    shared: ClassVar[dict[str, Array]] = {}

    @property
    def speed(self) -> Array:
        return self.shared["speed"]

    @speed.setter
    def speed(self, value: Array) -> None:
        self.shared["speed"] = value


class DrawsLots(Springs):
    """Moves a little by chance, without a seed."""

    def move(self, force_n: Array, damping_nspm: Array) -> None:
        super().move(force_n, damping_nspm)
        self.speed = self.speed * (1.0 - 1e-6 * np.random.rand())


class WritesIntoRows(Springs):
    """Uses the rows that it is given to work in."""

    def advance(self, rows: Sequence[Any]) -> Sequence[Sequence[float]]:
        answers = super().advance(rows)
        for row in rows:
            row[0] = 0.0
        return answers


class ReusesAnswers(Springs):
    """Returns the same list for every step."""

    answers: ClassVar[list[list[float]]] = []

    def advance(self, rows: Sequence[Row]) -> Sequence[Sequence[float]]:
        self.answers[:] = [list(row) for row in super().advance(rows)]
        return self.answers


class WritesIntoForce(Springs):
    """Adds weight to the force that it is given."""

    def move(self, force_n: Array, damping_nspm: Array) -> None:
        force_n[:, 0] -= 0.01
        super().move(force_n, damping_nspm)


class JumpsToTheHand(Springs):
    """Moves the mass to where the hand is, stretching its spring."""

    def join(self, user: int, position_m: Array) -> None:
        self.place[user] = position_m
        super().join(user, position_m)


class LeavesTheHand(Springs):
    """Lets the proxy begin at 0, wherever the hand is."""

    def join(self, user: int, position_m: Array) -> None:
        super().join(user, position_m)
        self.offset[user] = 0.0


class MovesOthers(Springs):
    """Makes everybody's frame that of the one who came last."""

    def join(self, user: int, position_m: Array) -> None:
        super().join(user, position_m)
        self.offset[:] = self.offset[user]


class HoldsForEver(Springs):
    def leave(self, user: int) -> None:
        """Do nothing."""


class AddsWaves(Springs):
    """Sends back a buzz that its proxy knows nothing of."""

    def advance(self, rows: Sequence[Row]) -> Sequence[Sequence[float]]:
        return [[value * 0.999 for value in row] for row in super().advance(rows)]


class TakesAnything(Springs):
    def restore(self, saved: Row) -> None:
        self.place = np.resize(np.array(saved or (0.0,)), self.place.shape)


class RestoresHalf(Springs):
    """Begins to restore before it has looked."""

    def restore(self, saved: Row) -> None:
        self.place = np.zeros_like(self.place)
        super().restore(saved)


class Diverges(Springs):
    """Divides by 0 where its mass passes 1 mm."""

    def move(self, force_n: Array, damping_nspm: Array) -> None:
        super().move(force_n, damping_nspm)
        if np.abs(self.place).max() > 0.001:
            self.place = self.place * np.nan


class Raises(Springs):
    """Raises where its mass passes 1 mm."""

    def move(self, force_n: Array, damping_nspm: Array) -> None:
        super().move(force_n, damping_nspm)
        if np.abs(self.place).max() > 0.001:
            raise KeyError("bead 7")


class Quits(Springs):
    def move(self, force_n: Array, damping_nspm: Array) -> None:
        raise SystemExit(3)


class Shapeless(Springs):
    """Answers with a wave too few."""

    def advance(self, rows: Sequence[Row]) -> Sequence[Sequence[float]]:
        return super().advance(rows)[:-1]


class Endless(Springs):
    """Never returns from a step, and catches what it can."""

    def move(self, force_n: Array, damping_nspm: Array) -> None:
        while True:
            with suppress(Exception):
                sum(range(100))
