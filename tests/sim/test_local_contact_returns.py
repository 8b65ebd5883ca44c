"""Force that comes back to a hand deep inside of what its client renders: re-armed, resumed, on a new line."""

from collections.abc import Callable
from itertools import accumulate, pairwise
from math import dist, hypot

import pytest

from cogrip.client.coupling.local.contact_spring import LENT_J, MOST_SAVED_J
from cogrip.client.coupling.local.local_contact import LocalCoupling
from cogrip.client.coupling.local.local_poses import PoseContact
from cogrip.client.inputs import DeviceFailed, Rearm
from cogrip.results.verdict.verdict import felt
from cogrip.results.writing.summary import of_laboratory
from cogrip.sim.laboratory import Laboratory

from tests.extent import long
from tests.sim.session_measures import account_of, by_tick, laboratory_of
from tests.sim.test_local_poses import at_wall
from tests.sim.test_local_sessions import of_scene

AWAY, BACK = 600, 2560  # ticks at which the force goes, and comes back
HAND = "reach&amplitude_m=0.045&stroke_s=0.8&delay_s=0.4&stop_s=1.2"


def pressed(kind: str, hand: str = HAND, seconds: float = 4.0) -> Laboratory:
    if kind == "poses":
        return at_wall("lan", seconds=5.2)
    if kind == "scene":
        return Laboratory(of_scene("wall", "lan", seconds))
    users = [{"name": "anna", "hand": hand}]
    return laboratory_of(seconds=seconds, object={"kind": kind}, coupling={"kind": "local"}, users=users)


def take_and_return(laboratory: Laboratory, how: str) -> dict[int, Callable[[], object]]:
    """Let the force go by a fault of the device, or by a server that is gone; and let it come back."""
    core = laboratory.people[0].core
    if how == "rearmed":
        return {
            AWAY: lambda: core.handle(DeviceFailed("of the test"), laboratory.now_ns),
            BACK: lambda: core.handle(Rearm(), laboratory.now_ns),
        }
    checkpoints = []
    return {AWAY: lambda: checkpoints.extend(laboratory.kill()), BACK: lambda: laboratory.restart(checkpoints)}


@pytest.mark.sample(1)
@pytest.mark.parametrize("how", ["rearmed", "resumed"])
@pytest.mark.parametrize(
    ("kind", "deep_m"), [long("wall", 0.04), ("faces", 0.04), ("scene", 0.04), long("poses", 0.095)]
)
def test_a_hand_deep_inside_is_not_thrown_out(kind: str, deep_m: float, how: str) -> None:
    """It sinks 26 to 45 mm while there is no force. Before, the wall gave it 68 to 89 mJ, and the peak of the device."""
    laboratory = pressed(kind)
    core = laboratory.people[0].core
    rows = by_tick(laboratory, lambda _: (core.position_m[:3], core.force_n[:3]), take_and_return(laboratory, how))
    account = account_of(laboratory)
    assert isinstance(core.coupling, LocalCoupling)
    assert isinstance(core.coupling.contact, PoseContact) == (kind == "poses")
    assert core.safety.state == "live"
    assert core.safety.gain == 1.0
    assert max(place_m[0] for place_m, _ in rows[:BACK]) > deep_m
    back = rows[BACK:]
    works_j = (
        sum(force * (x - p) for force, x, p in zip(force_n, there_m, here_m, strict=True))
        for (here_m, force_n), (there_m, _) in pairwise(back)
    )
    assert min(accumulate(works_j)) >= -(MOST_SAVED_J + LENT_J), "what the contact had saved, and what a ramp lends"
    assert max(hypot(*force_n) for _, force_n in back) < 1.5
    assert max(dist(after, before) for (_, before), (_, after) in pairwise(back)) < 0.2
    assert account.device.let_go == 0
    assert account.device.leak_j < 1e-3


@pytest.mark.sample(1)
@pytest.mark.parametrize("how", ["rearmed", "resumed"])
def test_and_feels_all_of_the_wall_once_it_has_been_outside(how: str) -> None:
    """The surface follows the hand out, and is where it belongs for one that comes in again."""
    hand = "waypoints&times_s=0.5,1.2,2.6,3.1,3.5,4.5&x_m=-0.01,0.045,0.045,-0.01,0.01,0.01"
    laboratory = pressed("wall", hand=hand, seconds=4.5)
    core = laboratory.people[0].core
    assert max(by_tick(laboratory, lambda _: core.position_m[0], take_and_return(laboratory, how))) > 0.04
    assert account_of(laboratory).felt_stiffness_npm == pytest.approx(1000.0, rel=1e-6)
    assert core.force_n[0] == pytest.approx(1000.0 * core.position_m[0], rel=1e-6)
    assert core.force_n[0] > 2.0


@pytest.mark.sample(1)
@pytest.mark.parametrize("kind", ["wall", "scene"])
def test_a_surface_that_has_yielded_is_not_felt_as_intended(kind: str) -> None:
    """The hand rests as deep as there is no force, and says how soft that is."""
    laboratory = pressed(kind)
    by_tick(laboratory, lambda _: None, take_and_return(laboratory, "resumed"))
    account = account_of(laboratory)
    assert account.felt_stiffness_npm is None or account.felt_stiffness_npm < 100.0
    judgement = felt(of_laboratory(laboratory))
    assert judgement.tone == "warn", judgement.sentence
