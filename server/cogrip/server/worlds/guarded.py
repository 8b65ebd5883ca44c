"""Guard of a world that another author wrote: its answers are checked, its energy at the ports is bounded.

It is called in `advance`, `join` and `leave`, to save and restore, and for its shapes. One that raises, answers something else
than was agreed, or takes too long is never called again: `advance` raises WorldError, and `failed` says why.

More than what came in, what it held at first (at most MOST_HELD_J) and the limiter's start never goes out: E is never below 0,
and no change of E goes by uncounted, also where people join and leave or the world is put back (`energy_limiter`). What turns
tools back to their hands, where there are six axes (`orientation_drift`), is added here and paid by the same ledger.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any, TypeVar

import msgspec
import numpy as np

from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES
from cogrip.protocol.drawing import MOST_SHAPES, Shape
from cogrip.protocol.laws.rotations import exp
from cogrip.protocol.settings.effects import MOST_EFFECTS, Effect
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.texts import MOST_NAMED, clipped, shown
from cogrip.server.worlds.accounts import ToolAccounts
from cogrip.server.worlds.drawing import Drawing
from cogrip.server.worlds.energy_limiter import EnergyLimiter
from cogrip.server.worlds.orientation_drift import DriftCorrection
from cogrip.server.worlds.tool_world import ToolWorld
from cogrip.server.worlds.world import REACH_M, Array, World, WorldError, dot

T = TypeVar("T")

MOST_HELD_J = 1.0  # most energy that a world may hold at first, as people may get it
LEAST_J = -1e-9  # least energy that counts as 0, for rounding
MOST_WAVE = 1e3  # largest wave [sqrt(W)]: 0.5 MW
MOST_PLACE = 1e3  # largest place [m] and velocity [m/s]: an object is put back long before
MOST_EVENTS = 8  # most events that are taken of one step
MOST_GIVEN = 4 * MOST_EFFECTS
"""Most effects that are taken of one step: a person has fewer, and looking at each takes time."""
LOOKS = "geoms", "poses_of_bodies", "not_drawn"  # methods of a ToolWorld that any world had
GONE = {
    "limiter_account": "accounts.limiter", "task_account": "progress.account", "scene_account": "accounts.scene",
    "contact_of": "accounts.contact", "stiffness_of": "accounts.stiffness", "sensor_names": "accounts.sensor_names",
}  # fmt: skip
"""Methods that worlds had, and what is asked in their place."""
MOST_SAVED = 10_000  # most numbers of a saved state: a checkpoint holds them


class TooLongError(BaseException):
    """A call of the world takes too long. No `except Exception` in the world keeps it from getting here."""


@contextmanager
def called(name: str, verb: str, time_limit: Callable[[], AbstractContextManager[None]]) -> Iterator[None]:
    """Make a WorldError with the name of another author's code of whatever is raised inside."""
    try:
        with time_limit():
            yield
    except TooLongError:
        failed = f"{name}: takes too long in {verb}"
    except WorldError as error:
        failed = f"{name}: {error}"
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # noqa: BLE001 (it is another author's, and may call sys.exit)
        failed = f"{name}: {error_line(error)} in {verb}"
    else:
        return
    raise WorldError(failed)


class GuardedWorld(World):
    """A world of another author. kind: as in the settings, for errors; identity: its code, which a checkpoint must share.

    time_limit  returns a context that raises TooLongError in a call that takes too long; the server's loop sets its own
    """

    def __init__(self, seats: Sequence[SeatSettings], make: Callable[[], World], kind: str, identity: str) -> None:
        super().__init__(seats)
        self.kind, self._identity = kind, identity
        self.time_limit: Callable[[], AbstractContextManager[None]] = nullcontext
        self.limiter = EnergyLimiter(self.frame_s)
        self._shape = len(seats), self.axes
        self.turning = DriftCorrection(range(len(seats)) if self.axes > PLACES else (), self.frame_s)
        self._where = self._place = np.zeros(self.axes)
        self._proxies = np.zeros(self._shape)
        self._energy = 0.0
        self.accounts = GuardedAccounts(self)
        with self._named("its constructor"):
            self.inner = make()
            self._check_made()
            self._read_state()
            self._start = self._saved()
        if self._energy > MOST_HELD_J:
            raise WorldError(
                f"{kind}: holds {self._energy:.3g} J at first, more than {MOST_HELD_J:g}: let it begin at rest"
            )

    def _check_made(self) -> None:
        inner = self.inner
        if inner.axes != self.axes or inner.inputs_per_axis != 1 or len(inner.holding) != len(self.holding):
            raise WorldError("does not call its base's constructor with the seats that it is given")
        looks = () if isinstance(inner, ToolWorld) else LOOKS
        if gone := [name for name in (*looks, *GONE) if hasattr(inner, name)]:
            now = GONE.get(gone[0], "a `drawing`, or a ToolWorld as base")
            raise WorldError(f"has {gone[0]}, which is asked no more: it is {now} now (docs/worlds.md)")
        self.drawing = GuardedDrawing(inner.drawing, self._try)

    # Calls of the world

    @contextmanager
    def _named(self, verb: str) -> Iterator[None]:
        """Make a WorldError with the world's name of whatever is raised inside; the world has failed then."""
        try:
            with called(self.kind, verb, self.time_limit):
                yield
        except WorldError as error:
            self.failed = str(error)
            raise

    def limit_calls(self, limit: Callable[[], AbstractContextManager[None]]) -> None:
        self.time_limit = limit

    def _try(self, verb: str, call: Callable[[], T], otherwise: T) -> T:
        """Return what a call gives, or `otherwise` where it fails or the world has failed: the next step will say so."""
        if self.failed:
            return otherwise
        try:
            with self._named(verb):
                return call()
        except WorldError:
            return otherwise

    def _read_state(self) -> None:
        """Read from the world, and check, what the room asks for between two steps."""
        inner, seats = self.inner, range(len(self.holding))
        self._energy = _number(inner.energy_j)
        self._place = _array("position", inner.position, (self.axes,), MOST_PLACE)
        self.velocity = _array("velocity", inner.velocity, (self.axes,), MOST_PLACE)
        self._proxies = _array("proxy", [inner.proxy(user) for user in seats], self._shape, MOST_PLACE)

    def _saved(self) -> Row:
        row = tuple(map(float, self.inner.save()))
        if len(row) > MOST_SAVED:
            raise WorldError(f"save gives {len(row)} numbers, more than {MOST_SAVED}")
        _array("save", row, (len(row),), np.inf)
        return row

    def advance(self, rows: Sequence[Row]) -> Sequence[Sequence[float]]:
        if self.failed:
            raise WorldError(self.failed)
        held = self.holding[:, None]
        received, before = np.where(held, np.array(rows), 0.0), self._energy
        u = (
            self.turning.corrected(received, self.port_impedance, self.limiter.level_j)
            if self.turning.driven
            else received
        )
        with self._named("advance"):
            answers = _array("advance", self.inner.advance([tuple(row) for row in u.tolist()]), self._shape, MOST_WAVE)
            self.events += [str(text) for text in self.inner.take_events()[:MOST_EVENTS]]
            self._read_state()
        back = np.where(held, answers, 0.0)
        if self.turning.driven:
            poses = [exp(proxy[PLACES:]) for proxy in self._proxies.tolist()]
            rates = (u + back) / np.sqrt(2.0 * self.port_impedance)
            self.turning.watch(poses, rates, u - received, self.port_impedance)
        factor = self.limiter.limit(dot(received, received), dot(back, back), self._energy - before)
        if factor < 1.0:
            back = factor * back
        self.force = np.where(held, (u - back) / np.sqrt(2.0 / self.port_impedance), 0.0)
        self._count_work((0.5 * self.frame_s) * (received * received - back * back).sum(axis=1))
        moved: list[list[float]] = back.tolist()
        return moved

    def step(self, inputs: Array) -> Array:
        return np.array(self.advance(inputs.tolist()))

    def join(self, user: int, position_m: Array) -> None:
        def joined() -> None:
            self.inner.join(user, np.array(position_m))
            self._proxies = _array(
                "proxy", [self.inner.proxy(each) for each in range(len(self.holding))], self._shape, MOST_PLACE
            )
            self.offset = _array("offset", self.inner.offset, self._shape, MOST_PLACE)

        self.holding[user] = True
        self.turning.begin(user)
        self._try("join", joined, None)

    def set_reported_rotation(self, user: int, rotation_rad: Row, travelled_rad: Row) -> None:
        self.turning.set_hand(user, rotation_rad, travelled_rad)

    def impedance_changed(self, user: int) -> None:
        super().impedance_changed(user)
        b = float(self.impedance[user, 0])
        self._try("set_impedance", lambda: self.inner.set_impedance(user, b), None)

    def leave(self, user: int) -> None:
        self.holding[user] = False
        self.force[user] = 0.0
        self.turning.begin(user)
        self._try("leave", lambda: self.inner.leave(user), None)

    def button(self, user: int, button: int, down: bool) -> None:
        self._try("button", lambda: self.inner.button(user, button, down), None)

    def effects_of(self, user: int) -> Sequence[Effect]:
        inner = self.inner
        if type(inner).effects_of is World.effects_of:  # no call of the world
            return inner.effects[:MOST_GIVEN] if isinstance(inner.effects, list | tuple) else ()
        return self._try("effects_of", lambda: tuple(inner.effects_of(user))[:MOST_GIVEN], ())

    def handle(self, user: int, orientation: Row | None, grip_m: float | None) -> None:
        if type(self.inner).handle is not World.handle:  # it would be called in vain at every step
            self._try("handle", lambda: self.inner.handle(user, orientation, grip_m), None)

    # What the room asks between two steps

    @property
    def energy_j(self) -> float:
        return self._energy

    @property
    def position(self) -> Array:
        """Place of the object [m]. To set it puts the whole world back to where it began."""
        return self._place

    @position.setter
    def position(self, value: Array) -> None:
        if hasattr(self, "inner"):  # not in the base's constructor
            self._try("restore", lambda: self._restore_unheld(self._start), None)

    @property
    def out_of_reach(self) -> bool:
        return super().out_of_reach or bool(np.any(np.abs(self._proxies - self.offset)[:, :PLACES] > REACH_M))

    def _restore_unheld(self, saved: Row) -> None:
        """Restore a state in which nobody holds anything; energy that it has more counts as made."""
        before = self._energy
        self.inner.restore(saved)
        for user in range(len(self.holding)):
            self.inner.leave(user)
        self._read_state()
        self.limiter.limit(0.0, 0.0, max(0.0, self._energy - before))

    def proxy(self, user: int) -> Array:
        place: Array = self._proxies[user]
        return place

    def bring_to_rest(self) -> None:
        """Do nothing: its own friction brings it to rest."""

    def reset(self) -> None:
        """Do nothing: it has failed, and is not called again."""

    # Saving

    @classmethod
    def _saved_names(cls) -> list[str]:
        return ["holding", "offset", "force", "port_work", "_work_error"]

    def save(self) -> Row:
        limiter = self.limiter
        own = super().save()
        return *own, *self.turning.save(), limiter.level_j, limiter.paid_j, float(limiter.limited), *self._saved()

    def restore(self, saved: Row) -> None:
        size = len(super().save())
        ports = size + self.turning.saved_numbers
        own, turned, ledger, inner = saved[:size], saved[size:ports], saved[ports : ports + 3], saved[ports + 3 :]
        self.inner.restore(inner)
        super().restore(own)
        self.turning.restore(turned)
        self._read_state()
        self.limiter.level_j, self.limiter.paid_j, limited = ledger
        self.limiter.limited = int(limited)

    def coordinates(self) -> tuple[str, Row]:
        return self._identity, self._try("save", self._saved, self._start)

    def restore_coordinates(self, position_m: Row, scene: str, coordinates: Row) -> None:
        if scene != self._identity:
            raise WorldError("its world is another one: the file or the package has been changed")
        problem = ""
        try:
            with self._named("restore"):
                self._restore_unheld(coordinates)
            if self._energy > MOST_HELD_J:
                problem = f"its world holds {self._energy:.3g} J, more than {MOST_HELD_J:g}"
        except WorldError as error:
            problem, self.failed = str(error), ""
        if problem:
            self._restore_unheld(self._start)
        self.limiter = EnergyLimiter(self.frame_s)  # a new server's: nobody has held it yet
        if problem:
            raise WorldError(problem)


def error_line(error: BaseException) -> str:
    """Return what was raised and where, in one line."""
    text = shown(" ".join(f"{type(error).__name__}: {error}".split()))[:200]
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return f"{text} (line {trace.tb_lineno})" if trace is not None else text


def _number(value: Any) -> float:
    energy = float(value)
    if not energy >= LEAST_J or energy == np.inf:
        raise WorldError(f"energy_j is {energy}: count from the lowest, so that it is a number and never below 0")
    return energy


def _array(name: str, value: Any, shape: tuple[int, ...], most: float) -> Array:
    """Return a value as a new array. Raises WorldError for another shape, and for numbers that are none or beyond `most`."""
    found = np.array(value, dtype=float)
    if found.shape != shape:
        raise WorldError(f"{name} has the shape {found.shape}, not {shape}")
    if not np.all(np.abs(found) <= most):
        raise WorldError(f"{name} is not finite, or beyond {most:g}: {found.ravel()[:6].tolist()}")
    return found


class GuardedDrawing(Drawing):
    """Drawing of a world of another author: its shapes are read once, its poses are checked.

    attempt: makes a call of the world, with its verb, and returns a value in its place where it fails
    """

    def __init__(self, drawing: Drawing, attempt: Callable[[str, Callable[[], Array], Array], Array]) -> None:
        self._drawing, self._attempt = drawing, attempt
        shapes = tuple(drawing.shapes())
        if len(shapes) > MOST_SHAPES:
            raise WorldError(f"has {len(shapes)} shapes, more than {MOST_SHAPES}")
        self._shapes = msgspec.convert(msgspec.to_builtins(shapes), tuple[Shape, ...])
        self._left_out = tuple(clipped(str(words)) for words in tuple(drawing.left_out())[:MOST_NAMED])
        bodies = 1 + max((body for shape in self._shapes for body in shape.bodies), default=-1)
        self._still = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (bodies, 1))

    def shapes(self) -> Sequence[Shape]:
        return self._shapes

    def left_out(self) -> Sequence[str]:
        return self._left_out

    def poses(self) -> Array:
        def asked() -> Array:
            return _array("poses", self._drawing.poses(), self._still.shape, MOST_PLACE)

        return self._attempt("poses_of_bodies", asked, self._still)


class GuardedAccounts(ToolAccounts):
    """Accounts of a world of another author: the guard's own ledger."""

    def __init__(self, world: GuardedWorld) -> None:
        super().__init__(world)
        self._guard = world

    def limiter(self) -> dict[str, float]:
        return self._guard.limiter.account()
