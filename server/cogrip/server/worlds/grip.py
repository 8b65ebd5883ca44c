"""A free object that people grip from all sides: implicit midpoint with the wave ports solved in the same step.

State and step are in plain floats, in a `GripStep`; the arrays that a `World` has are copies of it. Passive for any of its
numbers (theory section 3.3); the balance there holds to machine precision at every step.
"""

from array import array
from collections.abc import Sequence
from math import prod
from typing import ClassVar

import numpy as np

from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Row
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.settable import LENT_J
from cogrip.server.worlds.accounts import Accounts
from cogrip.server.worlds.grip_step import GripStep
from cogrip.server.worlds.world import Array, World, dot
from cogrip.server.worlds.world_step import WorldStep


class StepState:
    """Attribute of a world that is an array of its step's state, read-only. shape: of a world's users and axes."""

    def __init__(self, name: str, shape: str) -> None:
        self._name, self._shape = name, shape

    def __get__(self, world: "GripWorld", owner: type) -> Array:
        step = world.moving
        shape = {"a": (step.axes,), "n": (step.users,), "na": (step.users, step.axes), "n1": (step.users, 1)}
        found = np.array(getattr(step, self._name)[: prod(shape[self._shape])]).reshape(shape[self._shape])
        found.setflags(write=False)
        return found

    def __set__(self, world: "GripWorld", value: Array) -> None:
        setattr(world.moving, self._name, array("d", np.ravel(value).tolist()))
        world.moving.moved()
        if self._shape == "n1":
            world.moving.settled = False


class StepNumber:
    """Attribute of a world that is a number of its step."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __get__(self, world: "GripWorld", owner: type) -> float:
        number: float = getattr(world.moving, self._name)
        return number

    def __set__(self, world: "GripWorld", value: float) -> None:
        setattr(world.moving, self._name, value)


class GripWorld(World):
    """A free object that people grip from all sides. Its arrays are to be read, or set as a whole.

    `stretch` is that of each person's spring, shape (n, a). A spring with stiffness adaptation saves what its damper takes, and
    what it releases itself where it grows softer, to grow stiffer with.
    """

    kept: ClassVar[tuple[str, ...]] = ("stretch", "_paid_j", "_excess_j", "_growing")
    can_adapt_stiffness = can_change_object = True

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        first = seats[0]
        axes = max(seat.object.axes for seat in seats)
        self.moving = GripStep(self, len(seats), axes, first.rates.frame_s)
        super().__init__(seats)
        self.moving.b, self.moving.c = array("d", self.impedance[:, 0]), array("d", self.wave_gain[:, 0])
        self.moving.adapts, self.moving.saving = array("d", self.adapts_stiffness), bool(self.adapts_stiffness.any())
        self.accounts = GripAccounts(self)

    @property
    def energy_j(self) -> float:
        stretch, velocity = self.stretch, self.velocity
        stored = 0.5 * (dot(self.stiffness * stretch, stretch) + self.mass_kg * dot(velocity, velocity))
        return stored + add_floats(self._paid_j)

    def as_step(self) -> WorldStep:
        # One that is derived from this class may do any of it in its own way, and is asked.
        return self.moving if type(self) is GripWorld else WorldStep(self)

    @property
    def _paid_j(self) -> list[float]:
        return list(self.moving.paid)

    @_paid_j.setter
    def _paid_j(self, paid: Sequence[float]) -> None:
        self.moving.paid = array("d", paid)

    @property
    def _excess_j(self) -> list[float]:
        return list(self.moving.excess)

    @_excess_j.setter
    def _excess_j(self, excess: Sequence[float]) -> None:
        self.moving.excess = array("d", excess)

    def impedance_changed(self, user: int) -> None:
        super().impedance_changed(user)
        self.moving.b[user], self.moving.c[user] = float(self.impedance[user, 0]), float(self.wave_gain[user, 0])
        self.moving.settled = False

    def set_target_stiffness(self, user: int, stiffness_npm: float) -> None:
        self.moving.target[user] = stiffness_npm
        self.moving.growing = True

    def lend(self, user: int) -> None:
        self.moving.loan[user], self.moving.adapts[user] = LENT_J, 1.0
        self.moving.saving = True

    def set_damping(self, user: int, damping_nspm: float) -> None:
        self.target_damping[user] = damping_nspm
        if self.holding[user]:
            self.moving.B[user] = damping_nspm
            self.moving.settled = False

    def join(self, user: int, position_m: Array) -> None:
        self.offset[user] = position_m - self.position
        self.moving.offsets.clear()
        self.moving.put(user, float(self.target_damping[user, 0]))
        self.holding[user] = True

    def leave(self, user: int) -> None:
        self.holding[user] = False
        self.moving.take_away(user)

    def step(self, inputs: Array) -> Array:
        return np.array(self.moving.advance([tuple(row) for row in inputs.tolist()]))

    def restore(self, saved: Row) -> None:
        super().restore(saved)
        self.moving.held = array("d", self.holding.tolist())
        self.moving.offsets.clear()

    def proxy(self, user: int) -> Array:
        return np.array(self.proxy_of(user))

    def proxy_of(self, user: int) -> Row:
        return self.moving.proxy_of(user)

    def force_of(self, user: int) -> Row:
        return self.moving.force_of(user)

    def motion(self) -> Row:
        return self.moving.motion()

    def port_work_j(self) -> Sequence[float]:
        return self.moving.port_work_j()

    @property
    def left_workspace(self) -> bool:
        return self.moving.left_workspace()

    @property
    def out_of_reach(self) -> bool:
        return self.moving.out_of_reach()

    def start_ledger(self, user: int) -> None:
        self.moving.start_ledger(user)

    position, velocity, external_force = StepState("place", "a"), StepState("speed", "a"), StepState("external", "a")
    force, stretch = StepState("force", "na"), StepState("stretch", "na")
    stiffness, damping, target_stiffness = StepState("K", "n1"), StepState("B", "n1"), StepState("target", "n1")
    port_work = StepState("work", "n")
    mass_kg, object_damping, balance_error_j = StepNumber("mass_kg"), StepNumber("damping"), StepNumber("error_j")
    _growing = StepNumber("growing")


class GripAccounts(Accounts):
    """Accounts in plain floats."""

    def __init__(self, world: GripWorld) -> None:
        super().__init__(world)
        self._moving = world.moving

    def stiffness(self, user: int) -> float:
        return self._moving.K[user]
