"""Base of all worlds: state of the object, a proxy for each person, and the energy ledger."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from math import isfinite
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cogrip.machine.addition import add_integers
from cogrip.machine.rows import Row as Row
from cogrip.protocol.axes import PLACES, POSE_AXES
from cogrip.protocol.foreign_file import ForeignFileError
from cogrip.protocol.laws.rotations import between, exp
from cogrip.protocol.laws.waves import server_gain
from cogrip.protocol.line.energy_sums import add_compensated
from cogrip.protocol.settings.effects import Effect
from cogrip.protocol.settings.object_kinds import kind_of
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.worlds.accounts import Accounts
from cogrip.server.worlds.drawing import Drawing
from cogrip.server.worlds.progress import Progress
from cogrip.server.worlds.world_step import REACH_M as REACH_M
from cogrip.server.worlds.world_step import WORKSPACE_M as WORKSPACE_M
from cogrip.server.worlds.world_step import WorldStep

Array = NDArray[np.float64]


class WorldError(ForeignFileError, ArithmeticError):
    """A world that cannot go on from the state that it has reached. The text says which."""


def dot(a: Array, b: Array) -> float:
    """Return the sum of products in one order on every processor; BLAS's order differs, and no replay elsewhere is exact."""
    return float(np.add.reduce(a * b, axis=None))


def turn(matrices: Array, vectors: Array) -> Array:
    """Return matrices (..., 3, 3) times vectors (..., 3), summed in one order on every processor as in `dot`."""
    turned: Array = np.add.reduce(matrices * vectors[..., None, :], axis=-1)
    return turned


def displacement(before: Array, after: Array) -> Array:
    """Return by how much each row of places [m], of six axes with a rotation vector [rad] behind it, has gone to another one.

    Of orientations that is the rotation vector from one to the other, in the world's frame: T times the mean rate.
    """
    moved: Array = after - before
    if moved.shape[1] == POSE_AXES:
        turns = zip(before[:, PLACES:].tolist(), after[:, PLACES:].tolist(), strict=True)
        moved[:, PLACES:] = [between(exp(was), exp(now)) for was, now in turns]
    return moved


class World(ABC):
    """One object and its users. `step` takes one row of inputs a user, shape (n, inputs), and returns rows to send back.

    Positions of a user (proxy, device) are in that user's own frame: `offset` is what joining put between it and the
    object's (theory section 3.7: the proxy starts on the object, wherever the hand is).

    Beside it stand its `drawing`, its `accounts` and the `progress` of its task, on which no step depends.

    can_change_object  whether `set_mass` and `set_object_damping` may be called
    can_change_gravity  whether `set_gravity` may be called
    failed            why it is not stepped any more, "" while it is
    impedance         b of each person's port [N s/m], shape (n, 1)
    further_impedance  of the axes behind the places, shape (n, 1): b_r [N m s] of those that turn, b_g [N s/m] of an opening
    port_impedance    of each axis, shape (n, a)
    """

    axes_allowed: ClassVar[Sequence[int]] = (1, 2, 3)
    seats_allowed: ClassVar[Sequence[int]] = range(1, 257)
    kept: ClassVar[tuple[str, ...]] = (
        "position", "velocity", "offset", "force", "holding", "stiffness", "damping", "target_stiffness", "external_force",
        "port_work", "_work_error", "balance_error_j",
    )  # fmt: skip
    """Names of the attributes, numbers or arrays of them, that make up the state. Each class names its own; `save` and
    `restore` go through those of all base classes."""
    inputs_per_axis = 1  # number of inputs on each axis, which are waves
    object_name = "the object"  # name of the object in texts
    gained_j = 0.0  # energy that the bodies of a scene have got in all steps so far
    can_adapt_stiffness = False  # whether `set_target_stiffness` may be called
    can_change_object = can_change_gravity = False
    failed = ""

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        first = seats[0]
        self.axes = axes = max(seat.object.axes for seat in seats)
        self.frame_s = first.rates.frame_s
        self.mass_kg = first.object.mass_kg
        self.object_damping = first.object.damping_nspm
        self.impedance = np.array([[seat.coupling.impedance_nspm] for seat in seats])
        self.further_impedance = np.array([[seat.coupling.further_impedance] for seat in seats])
        self.port_impedance = np.repeat(self.impedance, axes, axis=1)
        self.port_impedance[:, PLACES:] = self.further_impedance
        self._impedance_ratio = [seat.coupling.length_scale**2 for seat in seats]  # b_r / b [m^2], or b_g / b
        self.wave_gain = np.array([[server_gain(seat.coupling.impedance_nspm)] for seat in seats])  # c
        self.side = np.array([seat.side_sign for seat in seats])
        self.target_stiffness = np.array([[seat.rendered_npm] for seat in seats])
        self.target_damping = np.array([[seat.coupling.damping_nspm] for seat in seats])
        self.adapts_stiffness = np.array([seat.adapts_stiffness for seat in seats])  # while the user holds the object
        self.stiffness = np.zeros((len(seats), 1))
        self.damping = np.zeros((len(seats), 1))
        self.holding = np.zeros(len(seats), dtype=bool)
        self.position, self.velocity = np.zeros(axes), np.zeros(axes)
        self.offset = np.zeros((len(seats), axes))
        self.force = np.zeros((len(seats), axes))
        self.port_work = np.zeros(len(seats))  # energy that came out of each user's line so far [J]
        self._work_error = np.zeros(len(seats))  # of that over the true sum
        self.external_force = np.zeros(axes)  # F_ext [N]
        self.balance_error_j = 0.0
        self.events: list[str] = []  # what has happened in this step: a marker each
        # bodies that left the workspace in this step, each with its place [m]
        self.departed: list[tuple[str, Row]] = []
        self.drawing, self.accounts, self.progress = Drawing(), Accounts(self), Progress()
        # that everybody's client renders, places in the object's frame at its start
        self.effects: Sequence[Effect] = ()

    def take_events(self) -> Sequence[str]:
        """Return the texts of `events` since the last call, and clear them; the room sends each to everybody as a marker."""
        if not self.events:
            return ()
        found, self.events = self.events, []
        return found

    def effects_of(self, user: int) -> Sequence[Effect]:
        """Return the haptic effects that a person's client is to render (docs/effects.md), asked for after every step.

        The same object is the same effect; a new one begins anew. One that is left out ends, unless it ends by itself.
        """
        return self.effects

    @property
    def moving_kg(self) -> float:
        """Mass of the object that moves here."""
        return self.mass_kg

    @property
    def places(self) -> int:
        """Number of axes that are places; where there are six, the last three are a rotation vector [rad]."""
        return min(self.axes, PLACES)

    @abstractmethod
    def join(self, user: int, position_m: Array) -> None:
        """Let a person take hold with the hand at position_m [m, rad], shape (a,), in its own frame."""

    @abstractmethod
    def leave(self, user: int) -> None:
        """Let a person go: the spring's energy is discarded, never returned as a jerk."""

    @abstractmethod
    def step(self, inputs: Array) -> Array:
        """Advance the object by one frame. inputs: shape (n, inputs); returns what goes back to each."""

    @property
    @abstractmethod
    def energy_j(self) -> float:
        """Kinetic and potential energy of all that is in the world, and what springs may spend on growing stiffer."""

    @abstractmethod
    def proxy(self, user: int) -> Array:
        """Return the proxy of a person [m], shape (a,), in the person's own frame."""

    def set_target_stiffness(self, user: int, stiffness_npm: float) -> None:
        """Set the target of a user's spring, K [N/m].

        Each `step` moves K there: down at once, up as fast as a ramp and the seat's saved energy allow, since raising K by
        dK at the stretch e costs dK e^2 / 2 (theory 3.7). Called only where `can_adapt_stiffness`.
        """
        raise NotImplementedError(f"{type(self).__name__}: a stiffness that changes would not be passive here")

    def goal_npm(self, user: int) -> float | None:
        """Return where a spring goes that follows what was set or measured [N/m]; None where it does not."""
        if not (self.can_adapt_stiffness and self.adapts_stiffness[user]):
            return None
        return float(self.target_stiffness[user, 0])

    def lend(self, user: int) -> None:
        """Lend a spring whose stiffness was set LENT_J to grow stiffer with, once a seat session (theory 3.7).

        Called only where `can_adapt_stiffness`.
        """
        raise NotImplementedError(f"{type(self).__name__}: a stiffness that changes would not be passive here")

    def set_damping(self, user: int, damping_nspm: float) -> None:
        """Set the damper of a person's spring, B [N s/m], from the next step on: passive whatever it is (theory 3.3)."""
        self.target_damping[user] = damping_nspm
        if self.holding[user]:
            self.damping[user] = damping_nspm

    def set_mass(self, mass_kg: float) -> None:
        """Set the object's mass [kg] from the next step on, without adding energy (theory 7.9).

        A heavier object keeps its momentum, p^2 / 2m, a lighter one its velocity, m v^2 / 2.
        """
        if mass_kg > self.mass_kg:
            self.velocity = self.velocity * (self.mass_kg / mass_kg)
        self.mass_kg = mass_kg

    def set_object_damping(self, damping_nspm: float) -> None:
        """Set the object's own damping [N s/m] from the next step on: passive whatever it is (theory 3.3)."""
        self.object_damping = damping_nspm

    @property
    def gravity_mps2(self) -> float:
        """Size of the acceleration with which bodies fall here [m/s^2]."""
        return 0.0

    def set_gravity(self, gravity_mps2: float) -> None:
        """Set the size of the acceleration with which bodies fall [m/s^2] from the next step on (theory 8.9).

        Called only where `can_change_gravity`.
        """
        raise NotImplementedError(f"{type(self).__name__}: nothing falls here")

    def set_impedance(self, user: int, impedance_nspm: float) -> None:
        """Set the wave impedance b of a person's port [N s/m] from the next step on; any b is passive (theory 7.3)."""
        if self.impedance[user, 0] != impedance_nspm:
            self.impedance[user] = impedance_nspm
            self.impedance_changed(user)

    def impedance_changed(self, user: int) -> None:
        """Compute anew the numbers that are derived of a person's impedance; a world with more of them extends this.

        b_r [N m s], or b_g [N s/m], changes in proportion to b: the characteristic length stays (theory 8.5).
        """
        b = float(self.impedance[user, 0])
        self.wave_gain[user] = server_gain(b)
        self.further_impedance[user] = self._impedance_ratio[user] * b
        self.port_impedance[user, :PLACES], self.port_impedance[user, PLACES:] = b, self.further_impedance[user]

    def advance(self, rows: Sequence[Row]) -> Sequence[Sequence[float]]:
        """Step in plain floats: a row a user in, a row a user out."""
        answers: list[list[float]] = self.step(np.array(rows)).tolist()
        return answers

    def as_step(self) -> WorldStep:
        """Return the step of this world, for its room."""
        return WorldStep(self)

    def set_reported_rotation(self, user: int, rotation_rad: Row, travelled_rad: Row) -> None:
        """Set how the hand was turned as it sent the wave row that the next step takes, from its client's message.

        rotation_rad   rotation vector of the hand in its own frame [rad]
        travelled_rad  sum of the rotation vectors from each of its samples to the next since the line began (SPEC 3.6) [rad]

        Called before `step`. Rotations do not commute, so a tool's rotation drifts away from its hand's; the drift is
        corrected by these values (`orientation_drift`, theory 8.5).
        """
        raise NotImplementedError(f"{type(self).__name__}: nothing turns here")

    def set_reported_positions(self, user: int, hand_m: Row, proxy_m: Row) -> None:
        """Set where a hand and its proxy were at the end of the newest frame, from its client's message, before `step`.

        hand_m, proxy_m  places [m] in the hand's own frame; they differ by the depth at which the hand presses

        Only worlds whose clients render contact themselves use it (theory 7.7, 8.7); the base ignores it.
        """
        return

    def button(self, user: int, button: int, down: bool) -> None:
        """Tell the world, before the next step, that a person pressed (`down`) or released a button, counted from 1.

        Each edge comes once and in order, whatever the network loses. Buttons that are down when a person leaves are released
        before `leave`.
        """
        return

    def handle(self, user: int, orientation: Row | None, grip_m: float | None) -> None:
        """Tell the world the newest orientation of a person's handle, a unit quaternion w, x, y, z in the device's own frame,
        and the opening of its gripper [m]; None: not known. Called before every step in which either is known."""
        return

    def limit_calls(self, limit: Callable[[], AbstractContextManager[None]]) -> None:
        """Bound the time of calls of another author's code by this context; nothing of this world is another author's."""
        return

    def engaged_at(self, user: int) -> Row:
        """Return the place [m], in the hand's own frame, at which the wave line began to move a person's tool (theory 8.7).

        () where the line moves no tool now, and in worlds where it moves one from joining to leaving.
        """
        return ()

    def start_ledger(self, user: int) -> None:
        """Count the user's work from here: a new seat session."""
        self.port_work[user] = self._work_error[user] = 0.0

    def _count_work(self, work: Array) -> None:
        """Add the energy that came out of each user's line in this step [J], shape (n,), to `port_work`."""
        self.port_work, self._work_error = add_compensated(self.port_work, self._work_error, work)

    def bring_to_rest(self) -> None:
        """Set the object's velocity to 0 because nobody holds it. A world of bodies with friction leaves them moving."""
        self.velocity = np.zeros(self.axes)

    def reset(self) -> None:
        """Set the state at the start, held by nobody. Called after `step` raised WorldError."""
        raise NotImplementedError(f"{type(self).__name__}: no state here is one that it cannot go on from")

    def save(self) -> Row:
        """Return the state between two steps; a world of the same seats continues from it bit for bit."""
        arrays = [np.ravel(np.asarray(getattr(self, name), dtype=float)) for name in self._saved_names()]
        row: list[float] = np.concatenate(arrays).tolist()
        return tuple(row)

    def restore(self, saved: Row) -> None:
        """Continue from a saved state. Raises WorldError for one that is not of such a world, and nothing has changed."""
        before = {name: getattr(self, name) for name in self._saved_names()}
        sizes = [np.size(value) for value in before.values()]
        check_saved(saved, add_integers(sizes))
        for (name, value), part in zip(before.items(), np.split(np.array(saved), np.cumsum(sizes)[:-1]), strict=True):
            old = np.asarray(value)
            new = part.astype(old.dtype).reshape(old.shape)
            setattr(self, name, new if isinstance(value, np.ndarray) else new.tolist())

    @classmethod
    def _saved_names(cls) -> list[str]:
        return list(dict.fromkeys(name for each in reversed(cls.__mro__) for name in vars(each).get("kept", ())))

    def coordinates(self) -> tuple[str, Row]:
        """Return the digest of the scene and the coordinates of all its bodies; "" and () where there is only the object."""
        return "", ()

    def restore_coordinates(self, position_m: Row, scene: str, coordinates: Row) -> None:
        """Put all bodies where a checkpoint had them, at rest; called before anybody takes hold.

        position_m   place of the object [m, rad], shape (a,)
        scene        digest of the scene in which the checkpoint was made, from `coordinates`
        coordinates  of all bodies, from `coordinates`

        Raises WorldError for another scene.
        """
        if scene or coordinates:
            raise WorldError("it is of a scene of rigid bodies, and this room has none")
        self.position = np.array(position_m)

    def motion(self) -> Row:
        """Return the object's position [m], then its velocity [m/s]."""
        return tuple(self.position.tolist() + self.velocity.tolist())

    def port_work_j(self) -> Sequence[float]:
        """Return `port_work` [J] in plain floats, one a user."""
        work: list[float] = self.port_work.tolist()
        return work

    def proxy_of(self, user: int) -> Row:
        """Return `proxy` in plain floats."""
        return tuple(self.proxy(user).tolist())

    def force_of(self, user: int) -> Row:
        """Return the force of one user's coupling [N], in plain floats."""
        return tuple(self.force[user].tolist())

    @property
    def left_workspace(self) -> bool:
        """Return whether the object is outside the workspace, or not a number."""
        return not all(abs(place) <= WORKSPACE_M for place in self.motion()[: self.places])

    @property
    def out_of_reach(self) -> bool:
        """Return whether nobody can hold the object where it is, or it is not a number."""
        return not all(abs(place) <= REACH_M for place in self.motion()[: self.places])


def check_saved(saved: Row, length: int) -> None:
    """Raise WorldError for a saved state of another length, or with a number in it that is none."""
    if len(saved) != length:
        raise WorldError(
            f"the saved state has {len(saved)} numbers, not {length}: it is of another world, or of other seats"
        )
    if not all(map(isfinite, saved)):
        raise WorldError("the saved state is not all finite")


class HandWorld(World):
    """A world that keeps each proxy's own place: `hand` is x_s, shape (n, a), in the object's frame."""

    kept = ("hand",)

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        super().__init__(seats)
        self.hand = np.zeros_like(self.force)
        self.fixed = kind_of(seats[0].object.kind).fixed
        self.one_sided = seats[0].one_sided

    def join(self, user: int, position_m: Array) -> None:
        if self.one_sided:
            self.hand[user] = position_m
            # a hand that starts inside counts as on the surface: pressing in before joining stored no energy
            inside = max(0.0, self.side[user] * (position_m[0] - self.position[0]))
            self.hand[user, 0] -= self.side[user] * inside
        else:
            self.hand[user] = self.position
        self.offset[user] = position_m - self.hand[user]
        self.force[user] = 0.0
        self.holding[user] = True
        self.stiffness[user] = self.target_stiffness[user]  # costs nothing while nothing is stretched
        self.damping[user] = self.target_damping[user]

    @property
    def energy_j(self) -> float:
        stretch = self.hand - self.position
        if self.one_sided:
            stretch = np.maximum(0.0, self.side * stretch[:, 0])[:, None]
        return 0.5 * (dot(self.stiffness * stretch, stretch) + self.mass_kg * dot(self.velocity, self.velocity))

    def leave(self, user: int) -> None:
        self.holding[user] = False
        self.stiffness[user] = self.damping[user] = self.force[user] = 0.0

    def proxy(self, user: int) -> Array:
        place: Array = self.hand[user] + self.offset[user]
        return place
