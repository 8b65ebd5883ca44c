"""`GripWorld` for few people: the same step in plain floats (`small_step.py`), three times as fast as numpy.

Equations and energy ledger are those of `grip.py` (theory sections 3.3 and 3.7), term by term. Sums are added in another order,
so that the two agree but for the last bits; a room has one of the two from beginning to end, and in every replay.
"""

from collections.abc import Sequence

import numpy as np

from cogrip.machine.addition import add_floats
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.worlds.accounts import Accounts
from cogrip.server.worlds.grip import GripWorld
from cogrip.server.worlds.small_step import MOST as MOST
from cogrip.server.worlds.small_step import GripStep
from cogrip.server.worlds.world import MOST_SAVED_J, Array, Row
from cogrip.server.worlds.world_step import WorldStep


class StepState:
    """Attribute of a world that is an array of its step's state, read-only. shape: of a world's users and axes."""

    def __init__(self, name: str, shape: str) -> None:
        self._name, self._shape = name, shape

    def __get__(self, world: "SmallGripWorld", owner: type) -> Array:
        step = world.moving
        shape = {"a": (step.axes,), "n": (step.users,), "na": (step.users, step.axes), "n1": (step.users, 1)}[
            self._shape
        ]
        array = np.array(getattr(step, self._name)[: int(np.prod(shape))]).reshape(shape)
        array.setflags(write=False)
        return array

    def __set__(self, world: "SmallGripWorld", value: Array) -> None:
        state = np.zeros(MOST)
        state[: np.size(value)] = np.ravel(value)
        setattr(world.moving, self._name, state.tolist())
        world.moving.moved()
        if self._shape == "n1":
            world.moving.settled = False


class SmallGripWorld(GripWorld):
    """State in `moving`; the arrays of `GripWorld` are views of it, to be read or set as a whole."""

    kept = ("_paid_j", "_excess_j")

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        first = seats[0]
        axes = max(seat.object.axes for seat in seats)
        given = first.object
        self.moving = GripStep(self, len(seats), axes, first.rates.frame_s, given.mass_kg, given.damping_nspm)
        super().__init__(seats)
        self._adapts_stiffness: list[bool] = self.adapts_stiffness.tolist()
        self._offsets: dict[int, list[float]] = {}  # of users, in plain floats
        self.accounts = SmallAccounts(self)

    @property
    def energy_j(self) -> float:
        return super().energy_j + add_floats(self._paid_j)

    def as_step(self) -> WorldStep:
        return self.moving

    @property
    def _growing(self) -> bool:
        return self.moving.growing

    @_growing.setter
    def _growing(self, growing: bool) -> None:
        self.moving.growing = growing

    @property
    def _saving(self) -> bool:
        return self.moving.saving

    @_saving.setter
    def _saving(self, saving: bool) -> None:
        self.moving.saving = saving

    @property
    def _paid_j(self) -> list[float]:
        return self.moving.paid[: self.moving.users]

    @_paid_j.setter
    def _paid_j(self, paid: Sequence[float]) -> None:
        self.moving.paid = [*paid, *(0.0,) * (MOST - len(paid))]

    @property
    def _excess_j(self) -> list[float]:
        return self.moving.excess[: self.moving.users]

    @_excess_j.setter
    def _excess_j(self, excess: Sequence[float]) -> None:
        self.moving.excess = [*excess, *(0.0,) * (MOST - len(excess))]

    def ports_changed(self) -> None:
        """Let the next step compute the ports' constants anew."""
        self.moving.settled = False

    def impedance_changed(self, user: int) -> None:
        super().impedance_changed(user)
        self.ports_changed()

    def _settle(self) -> None:
        """Compute the constants of stiffness, damping and impedance, which have changed."""
        rest = (0.0,) * (MOST - self.moving.users)
        self.moving.b, self.moving.c = [*self.impedance[:, 0].tolist(), *rest], [*self.wave_gain[:, 0].tolist(), *rest]
        self.moving.settle()

    def join(self, user: int, position_m: Array) -> None:
        self.offset[user] = position_m - self.position
        self._offsets.clear()
        self.moving.put(user, float(self.target_damping[user, 0]))
        self.holding[user] = True
        self._growing = True

    def leave(self, user: int) -> None:
        self.holding[user] = False
        self.moving.take_away(user)

    def step(self, inputs: Array) -> Array:
        return np.array(self.advance([tuple(row) for row in inputs.tolist()]))

    def advance(self, rows: Sequence[Row]) -> Sequence[Sequence[float]]:
        if not self.moving.settled:
            self._settle()
        answers = self.moving.step(rows)
        if self._growing or self._saving:
            self.moving.save()
        if self._growing:
            self._grow_now()
        if self._saving:
            paid = self._paid_j
            self._paid_j = [
                min(each, MOST_SAVED_J) if follows else each
                for each, follows in zip(paid, self._adapts_stiffness, strict=True)
            ]
        return answers

    def _grow_now(self) -> None:
        self._growing = False
        for user, target in enumerate(self.target_stiffness[:, 0].tolist()):
            if self.holding[user]:
                self.moving.grow(user, target)
                self._growing = self._growing or self.moving.K[user] != target

    def restore(self, saved: Row) -> None:
        super().restore(saved)
        self._offsets.clear()

    def proxy(self, user: int) -> Array:
        return np.array(self.proxy_of(user))

    def proxy_of(self, user: int) -> Row:
        offset = self._offsets.get(user)
        if offset is None:
            offset = self._offsets[user] = self.offset[user].tolist()
        return self.moving.proxy_of(user, offset)

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

    position = StepState("place", "a")
    velocity = StepState("speed", "a")
    external_force = StepState("external", "a")
    port_work = StepState("work", "n")
    force = StepState("force", "na")
    stretch = StepState("stretch", "na")
    stiffness = StepState("K", "n1")
    damping = StepState("B", "n1")

    @property
    def balance_error_j(self) -> float:
        """Largest error of the energy balance so far."""
        return self.moving.error_j

    @balance_error_j.setter
    def balance_error_j(self, error_j: float) -> None:
        self.moving.error_j = error_j


class SmallAccounts(Accounts):
    """Accounts in plain floats."""

    def __init__(self, world: SmallGripWorld) -> None:
        super().__init__(world)
        self._moving = world.moving

    def stiffness(self, user: int) -> float:
        return self._moving.K[user]
