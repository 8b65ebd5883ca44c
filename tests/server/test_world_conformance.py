"""The conformance suite passes sound worlds and the built-in ones, and finds each of many that break one promise."""

from collections.abc import Callable, Iterator
from itertools import count

import pytest

from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.schemes import make_world
from cogrip.server.worlds import conformance
from cogrip.server.worlds.conformance import (
    CHECKS,
    Subject,
    UnfitError,
    keeps_time,
    makes_no_energy,
    proxies_follow_their_waves,
)
from cogrip.server.worlds.grip import GripWorld
from cogrip.server.worlds.lagged import PaperWorld
from cogrip.server.worlds.scenes import scene_grips
from cogrip.server.worlds.scenes.scene_springs import uncounted_j
from cogrip.server.worlds.scenes.turning_ports import TurningPorts
from cogrip.server.worlds.tool_world import ToolWorld
from cogrip.server.worlds.world import World

from tests.extent import long
from tests.server import broken_worlds as broken
from tests.server.broken_worlds import seats
from tests.server.object_worlds import seats as object_seats
from tests.server.scene_worlds import world_of_settings


@pytest.fixture(autouse=True)
def _fewer_sessions(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Look for energy in a third of the sessions by default."""
    if not request.config.getoption("--all"):
        monkeypatch.setattr(conformance, "SESSIONS", conformance.SESSIONS // 3)


def found(subject: Subject) -> dict[str, str]:
    """Return what is wrong, by the check that finds it."""
    problems = {}
    for check in CHECKS:
        try:
            check(subject)
        except Exception as error:  # noqa: BLE001 (as the command does)
            problems[check.__name__] = str(error)
    return problems


@pytest.mark.long
@pytest.mark.parametrize(
    ("world", "axes"),
    [
        (broken.Springs, 3), (broken.Tumbling, 6), long(broken.Springs, 1), long(broken.InPlace, 3),
        long(broken.InPlace, 1),
    ],
)  # fmt: skip
def test_a_sound_world_keeps_every_promise(world: type[ToolWorld], axes: int) -> None:
    assert found(Subject(lambda: world(seats(3, axes)))) == {}


@pytest.mark.parametrize(
    ("make", "kind", "compensate"),
    [
        (make_world, "cube", True),
        long(make_world, "cube", False),
        long(make_world, "faces", True),
        long(make_world, "wall", False),
        long(GripWorld, "cube", True),
    ],
)
def test_built_in_worlds_keep_every_promise(
    make: Callable[[list[SeatSettings]], World], kind: str, compensate: bool
) -> None:
    given = object_seats(3, kind, 2, compensate=compensate)
    assert found(Subject(lambda: make(given))) == {}


def test_the_papers_step_makes_energy() -> None:
    given = object_seats(2, server_step="paper", stiffness_npm=3000.0)
    with pytest.raises(UnfitError, match="more than came in"):
        makes_no_energy(Subject(lambda: PaperWorld(given)))


def subject_of_scene(name: str) -> Subject:
    return Subject(lambda: world_of_settings(name), uncounted=uncounted_j)


@pytest.mark.long
@pytest.mark.parametrize("name", ["valve", "peg", *map(long, ("wheel", "table", "lift", "pinch", "pile"))])
def test_scenes_keep_every_promise(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    if name == "peg":  # it swings in its rack, and gains at most a thousandth of what it holds (docs/worlds.md)
        monkeypatch.setattr(conformance, "MOST_MADE_J", 1e-4)
    assert found(subject_of_scene(name)) == {}


@pytest.mark.long
def test_a_scene_that_puts_its_handles_to_the_hands_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene_grips, "is_tied", lambda *_: False)
    with pytest.raises(UnfitError, match="more than came in"):
        makes_no_energy(subject_of_scene("valve"))


def test_a_scene_that_forgets_how_a_tool_was_taken_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its tools would be turned all the way to their hands."""
    monkeypatch.setattr(TurningPorts, "take", lambda ports, _, user, turn: ports.begin(user))
    with pytest.raises(UnfitError, match="turned as their hands"):
        proxies_follow_their_waves(subject_of_scene("valve"))


MADE, SAME, STATE = "makes_no_energy", "gives_the_same_again", "restores_bit_for_bit"


@pytest.mark.parametrize(
    ("world", "check", "words"),
    [
        (broken.CreatesSlowly, MADE, "more than came in"),
        long(broken.CreatesFarOut, MADE, "more than came in"),
        long(broken.CreatesAlone, MADE, "more than came in"),
        (broken.ExplicitEuler, MADE, "step it by an implicit rule"),
        (broken.HidesEnergy, MADE, "count all of its energy"),
        long(broken.CountsTwice, MADE, "more than came in"),
        (broken.CountsFromAbove, "counts_its_energy", "never below 0"),
        (broken.HoldsMuch, "counts_its_energy", "from 0 to 1 J at first"),
        (broken.ForgetsSpeed, STATE, "goes on with the same bits"),
        (broken.ForgetsCount, STATE, "is all that changes in `kept`"),
        (broken.SharesState, SAME, "with another world beside it"),
        (broken.DrawsLots, SAME, "the same bits as alone"),
        (broken.WritesIntoRows, MADE, "does not write into the rows"),
        (broken.ReusesAnswers, "keeps_what_it_answered", "return new arrays"),
        (broken.WritesIntoForce, MADE, "read-only"),
        (broken.JumpsToTheHand, "joins_and_leaves", "taking hold brings no energy"),
        (broken.LeavesTheHand, "joins_and_leaves", "the proxy is at the hand"),
        (broken.MovesOthers, "joins_and_leaves", "nobody else's proxy moves"),
        (broken.HoldsForEver, "joins_and_leaves", "holding is false"),
        (broken.AddsWaves, "proxies_follow_their_waves", "as their waves say"),
        (broken.AddsRotationVectors, MADE, "more than came in"),
        (broken.ForgetsRotation, MADE, "count all of its energy"),
        (broken.TakesAnything, "refuses_other_states", "restore raises WorldError"),
        (broken.RestoresHalf, "refuses_other_states", "a state that is refused changes nothing"),
        (broken.Diverges, MADE, "finite"),
        (broken.Raises, MADE, "bead 7"),
        (broken.Shapeless, MADE, "a row of 2 waves a seat"),
    ],
)
def test_a_broken_world_is_found(world: type[ToolWorld], check: str, words: str) -> None:
    with pytest.raises(Exception, match=words):
        getattr(conformance, check)(Subject(lambda: world(seats(axes=6 if 6 in world.axes_allowed else 2))))


def clocks(step_us: Callable[[int], int]) -> tuple[Callable[[], int], Callable[[], int]]:
    """Return two clocks by which step number n takes step_us(n)."""

    def clock() -> Iterator[int]:
        now_us = 0
        for number in count():
            yield 1000 * now_us
            now_us += step_us(number)
            yield 1000 * now_us

    wall, processor = clock(), clock()
    return lambda: next(wall), lambda: next(processor)


@pytest.mark.long
def test_the_cost_of_a_step_is_judged_against_the_frame() -> None:
    frame_us = round(1e6 / 128)

    def judged(step_us: Callable[[int], int]) -> str:
        return keeps_time(Subject(lambda: broken.Springs(seats()), clocks=clocks(step_us)))

    assert judged(lambda number: frame_us // 2 - 1).startswith(f"p50 {frame_us // 2 - 1} us")
    assert "p99 20 us" in judged(lambda number: 10**6 if number % 200 == 0 else 20)
    for slow in (lambda number: frame_us // 2 + 1, lambda number: 10**6 if number % 50 == 0 else 20):
        with pytest.raises(UnfitError, match=r"at most 0\.5 of a frame"):
            judged(slow)
    assert keeps_time(Subject(lambda: broken.Springs(seats()))) == ""


def test_no_check_is_idle() -> None:
    """Each is the one that some broken world above is found by, or is tried by itself."""
    cases = next(mark for mark in test_a_broken_world_is_found.pytestmark if mark.name == "parametrize").args[1]
    assert {getattr(case, "values", case)[1] for case in cases} | {"keeps_time"} == {
        check.__name__ for check in conformance.CHECKS
    }
