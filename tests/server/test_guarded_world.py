"""The guard of other authors' worlds: what fails is named and never called again, and none gives out what it did not get."""

import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import product

import numpy as np
import pytest

from cogrip.machine.rows import Row
from cogrip.protocol.drawing import Shape
from cogrip.protocol.settings.effects import MOST_EFFECTS, Effect
from cogrip.protocol.texts import TEXT_BYTES
from cogrip.server.io import call_limit
from cogrip.server.worlds.energy_limiter import START_J
from cogrip.server.worlds.grip import GripWorld
from cogrip.server.worlds.guarded import MOST_GIVEN, MOST_HELD_J, GuardedWorld
from cogrip.server.worlds.tool_world import ToolWorld
from cogrip.server.worlds.world import Array, WorldError

from tests.extent import every
from tests.server import broken_worlds as broken
from tests.server.broken_worlds import Springs, Tumbling, seats

KIND = "python:mine.py:Mine"


def guarded(world: type[ToolWorld], count: int = 2, axes: int = 2) -> GuardedWorld:
    given = seats(count, axes)
    return GuardedWorld(given, lambda: world(given), KIND, "this code")


def held(world: type[ToolWorld], axes: int = 2) -> GuardedWorld:
    made = guarded(world, axes=axes)
    for user in range(2):
        made.join(user, np.array([0.01, 0.01, 0.0, 0.3, 0.0, 0.5])[:axes])
    return made


def until_failed(world: GuardedWorld) -> str:
    """Push until it fails. Returns what the error says."""
    for _ in range(200):
        try:
            world.advance([(0.05, 0.02)] * 2)
        except WorldError as error:
            return str(error)
    pytest.fail("it goes on")


@pytest.mark.parametrize(
    ("world", "words"),
    [
        (broken.Raises, "KeyError: 'bead 7' (line "),
        (broken.Diverges, "advance is not finite, or beyond 1000: [nan, "),
        (broken.Shapeless, "advance has the shape (1, 2), not (2, 2)"),
        (broken.WritesIntoForce, "read-only"),
        (broken.Quits, "SystemExit: 3 (line "),
        (broken.CountsFromAbove, "never below 0"),
    ],
)
def test_a_world_that_fails_is_named_and_never_called_again(world: type[ToolWorld], words: str) -> None:
    room = held(world)
    said = until_failed(room)
    assert said.startswith(f"{KIND}: ")
    assert words in said
    assert said == room.failed
    room.inner = None  # type: ignore[assignment]
    for again in (lambda: room.advance([(0.0, 0.0)] * 2), lambda: room.step(np.zeros((2, 2)))):
        with pytest.raises(WorldError):
            again()
    room.reset()
    room.leave(0)
    room.join(0, np.zeros(2))
    room.position = np.zeros(2)
    assert np.isfinite([*room.motion(), *room.proxy_of(0), *room.force_of(0), *room.port_work_j()]).all()
    assert room.coordinates()[0] == "this code"
    assert room.failed == said


class Waits(Springs):
    def advance(self, rows: Sequence[Row]) -> Sequence[Sequence[float]]:
        threading.Event().wait()
        return rows


@pytest.mark.parametrize(("world", "limits"), [(broken.Endless, (0.02, 100.0)), (Waits, (100.0, 0.02))])
def test_a_world_that_takes_for_ever_is_ended(
    monkeypatch: pytest.MonkeyPatch, world: type[ToolWorld], limits: Row
) -> None:
    for name, limit_s in zip(("COMPUTE_LIMIT_S", "WAIT_LIMIT_S"), limits, strict=True):
        monkeypatch.setattr(call_limit, name, limit_s)
    room = held(world)
    room.time_limit = call_limit.call_limit
    assert until_failed(room) == f"{KIND}: takes too long in advance"


@pytest.mark.parametrize("fails", [False, True])
def test_an_alarm_that_comes_as_a_call_ends_leaves_the_timer_off(monkeypatch: pytest.MonkeyPatch, fails: bool) -> None:
    """Raised in what puts the timer off it would leave that on, and later end whatever the server does then."""
    set_timer, late = signal.setitimer, []

    def set_late(which: int, seconds: float, interval: float = 0.0) -> tuple[float, float]:
        if not seconds:
            signal.raise_signal(signal.SIGALRM)
            late.append(which)
        return set_timer(which, 100.0 if seconds else 0.0)

    monkeypatch.setattr(call_limit, "COMPUTE_LIMIT_S", 1e-9)  # each alarm comes too late
    room = held(broken.Raises if fails else Springs)
    monkeypatch.setattr(signal, "setitimer", set_late)
    room.time_limit = call_limit.call_limit
    if fails:
        assert "KeyError" in until_failed(room)
    else:
        room.advance([(0.05, 0.02)] * 2)
    assert late
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("computed_s", "waited_s", "ended"),
    [(0.249, 0.999, False), (0.25, 0.3, True), (0.0, 1.0, True), (0.01, 0.9, False)],
)
def test_a_machine_that_stood_still_ends_no_world(computed_s: float, waited_s: float, ended: bool) -> None:
    assert call_limit.too_long(computed_s, waited_s) is ended


@pytest.mark.parametrize(
    ("world", "words"),
    [
        (broken.HoldsMuch, "holds 38.4 J at first, more than 1: let it begin at rest"),
        (type("Few", (Springs,), {"__init__": lambda self, given: Springs.__init__(self, given[:1])}), "constructor"),
        (type("Bare", (Springs,), {"__init__": lambda self, given: None}), "AttributeError"),
        (type("Many", (Springs,), {"geoms": lambda self: [Shape("box", (1.0, 1.0, 1.0))] * 1025}), "1025 shapes, more"),
        (type("Odd", (Springs,), {"geoms": lambda self: [Shape("box", (1.0,))]}), "ValidationError"),
        (type("Vast", (Springs,), {"save": lambda self: (0.0,) * 10_001}), "save gives 10001 numbers, more than"),
    ],
)
def test_a_world_that_cannot_be_made_says_why(world: type[ToolWorld], words: str) -> None:
    with pytest.raises(WorldError, match=words) as caught:
        guarded(world)
    assert str(caught.value).startswith(KIND)


def test_what_a_world_says_it_does_not_draw_is_told_to_who_looks_at_it() -> None:
    world = guarded(type("Dim", (Springs,), {"not_drawn": lambda self: ["the strings", "x" * 500]}))
    assert world.drawing.left_out() == ("the strings", "x" * TEXT_BYTES)
    assert world.drawing.notes()[0].startswith("not drawn of the scene: the strings, xxx")


# Energy ----------------------------------------------------------------------------------------------------------------


class Hanging(Springs):
    """Holds 0.4 J at first, and lets people have it."""

    def __init__(self, given: Sequence[object]) -> None:
        super().__init__(given)  # type: ignore[arg-type]
        self.place = self.place + np.sqrt(0.4 * 2.0 / self.npm / self.place.size)


class Liar(Springs):
    """Claims to hold 1 J, and to lose a part of it in each frame, while it sends out waves."""

    told_j = 1.0

    @property
    def energy_j(self) -> float:
        return self.told_j

    def advance(self, rows: Sequence[Row]) -> Sequence[Sequence[float]]:
        self.told_j = max(0.0, self.told_j - 0.01)
        return [(3.0,) * self.axes for _ in rows]


class Pump(Liar):
    """Claims to be filled up anew whenever somebody takes hold."""

    def join(self, user: int, position_m: Array) -> None:
        super().join(user, position_m)
        self.told_j = 1.0


WORLDS = (
    Springs, Hanging, Liar, Pump, broken.CreatesSlowly, broken.ExplicitEuler, broken.HidesEnergy, broken.JumpsToTheHand,
    broken.CountsTwice,
)  # fmt: skip


def attacks() -> dict[str, Callable[[int, Array], Array]]:
    random = np.random.default_rng(1)
    return {
        "noise": lambda frame, back: random.normal(size=back.shape),
        "ends that lose nothing": lambda frame, back: back + (frame % 50 == 0),
        "forty cycles of pulling": lambda frame, back: np.full_like(back, 2.0 if frame % 32 < 16 else -2.0),
        "nothing": lambda frame, back: np.zeros_like(back),
    }


@pytest.mark.sample(3)
@pytest.mark.parametrize(("world", "attack"), every(5, product(WORLDS, attacks())))
def test_no_more_comes_out_than_came_in_and_was_held_at_first(world: type[ToolWorld], attack: str) -> None:
    """Also where people come and go, and where the object is put back."""
    room, wave = held(world), attacks()[attack]
    start, came, back = room.energy_j, 0.0, np.zeros((2, 2))
    for frame in range(40 * 32):
        if frame % 100 == 60:
            room.leave(frame // 100 % 2)
        if frame % 100 == 80:
            room.join(frame // 100 % 2, np.full(2, 0.001 * (frame % 7)))
        if frame % 500 == 499:
            room.leave(0)
            room.leave(1)
            room.position = np.full(2, 1.0)
            room.join(0, np.zeros(2))
            room.join(1, np.zeros(2))
        u = np.clip(wave(frame, back), -4.0, 4.0)
        try:
            back = np.array(room.advance(u.tolist()))
        except WorldError:
            return  # the room has ended
        u = np.where(room.holding[:, None], u, 0.0)
        came += 0.5 * room.frame_s * float((u * u - back * back).sum())
        assert room.limiter.level_j >= 0.0 or not back.any()
        if back.any():
            assert came >= room.energy_j - start - START_J - 1e-9
        assert sum(room.port_work_j()) == pytest.approx(came, abs=1e-9)
    assert -came <= MOST_HELD_J + START_J + 1e-9


# Six axes --------------------------------------------------------------------------------------------------------------


@pytest.mark.sample(1)
@pytest.mark.parametrize("seed", every(2, range(8)))
def test_what_turns_tools_to_hands_that_lie_is_paid_by_the_ledger(seed: int) -> None:
    room, came = held(Tumbling, 6), 0.0
    start = room.energy_j
    for came_j, energy_j, *_ in course(room, seed, 600):
        came += came_j
        assert came >= energy_j - start - START_J - 1e-9
    assert any(drift.correction_radps != (0.0, 0.0, 0.0) for drift in room.turning.drift.values())
    assert sum(room.port_work_j()) == pytest.approx(came, abs=1e-9)


def test_a_tool_is_turned_to_its_hand_and_no_further_when_it_is_let_go() -> None:
    """A hand that rests, so that what comes goes back turned round, and is turned by 0.1 rad against its tool."""
    room = held(Tumbling, 6)
    room.inner.place[0, 3:] = (0.0, 0.0, 0.1)  # type: ignore[attr-defined]
    for user in range(2):
        room.join(user, np.zeros(6))
    assert room.proxy_of(0) == pytest.approx([0.0] * 6, abs=1e-14)
    u, left = np.zeros((2, 6)), []
    for _ in range(400):
        room.set_reported_rotation(0, (0.0, 0.0, 0.1), (0.0, 0.0, 0.0))
        u = -np.array(room.advance(u.tolist()))
        left.append(0.1 - room.proxy_of(0)[5])
    assert left[0] == pytest.approx(0.1, abs=1e-6)
    assert abs(left[-1]) <= 1e-3
    assert room.limiter.limited == 0
    room.set_reported_rotation(0, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    room.advance(u.tolist())
    room.leave(0)
    assert room.turning.corrected(u, room.port_impedance, 1.0) == pytest.approx(u)


def test_tools_out_of_reach_and_not_turned_far_are_put_back_though_the_object_is_not() -> None:
    turned = held(Tumbling, 6)
    turned.inner.place = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 3.0], (2, 1))  # type: ignore[attr-defined]
    turned.advance(np.zeros((2, 6)).tolist())
    assert not turned.out_of_reach
    room = held(Springs)
    assert not room.out_of_reach
    room.inner.place = np.full((2, 2), 2.1)  # type: ignore[attr-defined]
    room.advance([(0.0, 0.0)] * 2)
    assert room.out_of_reach
    for user in range(2):
        room.leave(user)
    room.position = np.zeros(2)
    assert not room.out_of_reach
    assert room.energy_j == 0.0


BUTTON, HANDLE = ("button", (0, 3, True)), ("handle", (1, (1.0, 0.0, 0.0, 0.0), 0.01))


@pytest.mark.parametrize(("name", "given"), [("join", (0, np.zeros(2))), ("leave", (0,)), BUTTON, HANDLE])
def test_one_that_fails_between_steps_ends_with_the_next(name: str, given: tuple[object, ...]) -> None:
    room = held(type("Torn", (Springs,), {}))
    setattr(type(room.inner), name, lambda *given: 1 / 0)
    getattr(room, name)(*given)
    with pytest.raises(WorldError, match=rf"division by zero \(line \d+\) in {name}"):
        room.advance([(0.0, 0.0)] * 2)


@pytest.mark.parametrize(("name", "given"), [BUTTON, HANDLE])
def test_buttons_and_handles_reach_a_world_that_hears_them(name: str, given: tuple[object, ...]) -> None:
    told: list[tuple[object, ...]] = []
    for heard in ({name: lambda self, *args: told.append(args)}, {}):
        room = held(type("Hears", (Springs,), heard))
        getattr(room, name)(*given)
        room.advance([(0.0, 0.0)] * 2)
    assert told == [given]


@pytest.mark.parametrize("world", [Springs, GripWorld])
def test_a_sound_world_is_never_limited_and_passes_unchanged(world: type[Springs | GripWorld]) -> None:
    """Also one without tools: the cube as it comes with cogrip, under another name."""
    given = seats()
    room, alone = GuardedWorld(given, lambda: world(given), KIND, "this code"), world(given)
    for user, place in enumerate(((0.01, 0.0), (0.0, -0.02))):
        room.join(user, np.array(place))
        alone.join(user, np.array(place))
    for rows in np.random.default_rng(2).normal(size=(500, 2, 2)).tolist():
        assert list(map(list, room.advance(rows))) == list(map(list, alone.advance(rows)))
        assert room.force == pytest.approx(alone.force, abs=1e-12)
        assert [room.proxy_of(user) for user in (0, 1)] == [alone.proxy_of(user) for user in (0, 1)]
    assert room.motion() == alone.motion()
    assert room.port_work_j() == pytest.approx(alone.port_work_j(), abs=1e-15)
    assert room.accounts.limiter()["limited_frames"] == 0


# Saving ----------------------------------------------------------------------------------------------------------------


def course(room: GuardedWorld, seed: int, frames: int = 100) -> list[tuple[float, ...]]:
    """Push at random, hands of six axes saying that they are turned otherwise than their tools; return all that is seen.

    First of it what came in and what is held.
    """
    random, seen = np.random.default_rng(seed), []
    for _ in range(frames):
        for user, (turned, travelled) in enumerate(random.uniform(-2.0, 2.0, (2, 2, 3)).tolist()):
            room.set_reported_rotation(user, turned, travelled)
        rows = np.clip(random.normal(size=(2, room.axes)), -4.0, 4.0)
        back = np.array(room.advance(rows.tolist()))
        came_j = 0.5 * room.frame_s * float((rows * rows - back * back).sum())
        seen.append((came_j, room.energy_j, *back.flat, *room.motion(), *room.port_work_j(), *room.save()))
    return seen


@pytest.mark.parametrize(("world", "axes"), [(Springs, 2), (broken.CreatesSlowly, 2), (Tumbling, 6)])
def test_a_guarded_world_goes_on_bit_for_bit_with_its_ledger(world: type[ToolWorld], axes: int) -> None:
    room, again = held(world, axes), held(world, axes)
    course(room, 1)
    room.leave(1)
    saved = room.save()
    expected = course(room, 2)
    course(again, 3)
    again.restore(saved)
    assert again.save() == saved
    assert course(again, 2) == expected


def test_after_a_restart_everything_is_where_it_was_and_nobody_holds_it() -> None:
    room = held(Springs)
    course(room, 1)
    after = guarded(Springs)
    after.restore_coordinates(room.motion()[:2], *room.coordinates())
    assert after.energy_j == room.energy_j
    assert not after.holding.any()
    assert not after.inner.holding.any()
    assert after.inner.save()[-8:] == room.inner.save()[-8:]  # place and speed


@pytest.mark.parametrize(
    ("identity", "spoil", "words"),
    [
        ("other code", lambda row: row, "its world is another one"),
        ("this code", lambda row: row[:-1], "numbers, not"),
        ("this code", lambda row: (*row[:-1], float("nan")), "not all finite"),
        ("this code", lambda row: (*row[:-1], 10.0), "holds 10 J, more than 1"),
    ],
)
def test_a_checkpoint_of_another_world_changes_nothing(identity: str, spoil: Callable[[Row], Row], words: str) -> None:
    room = guarded(Springs)
    before = room.save()
    with pytest.raises(WorldError, match=words):
        room.restore_coordinates((0.0, 0.0), identity, spoil(room.coordinates()[1]))
    assert room.save()[:-3] == before[:-3]
    assert not room.failed
    room.advance([(0.0, 0.0)] * 2)


def test_the_limit_of_time_needs_the_main_thread_alone() -> None:
    """Elsewhere there is none, and nothing is left behind."""

    def inside() -> bool:
        with call_limit.call_limit():
            return True

    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(inside).result()


def test_effects_beyond_what_people_can_have_are_not_even_looked_at() -> None:
    """To look at one takes a part of the frame: others' rooms have the same frame. None of these would fit."""
    floods = type("Floods", (Springs,), {"effects_of": lambda self, user: [Effect("viscous")] * 10_000})
    assert len(held(floods).effects_of(0)) == MOST_GIVEN == 4 * MOST_EFFECTS
