"""Force that comes back to a hand deep inside of what its client renders: re-armed, resumed, on a new line."""

from itertools import pairwise
from math import dist, hypot

import pytest

from cogrip.client.inputs import DeviceFailed, Rearm
from cogrip.client.local_contact import LENT_J, MOST_SAVED_J, LocalCoupling
from cogrip.protocol.settings import Settings, resolve
from cogrip.sim.runs.summary import of_laboratory
from cogrip.sim.runs.verdict import felt
from cogrip.sim.session.laboratory import Laboratory

from tests.extent import long
from tests.sim.test_local_sessions import of_scene

AWAY, BACK = 600, 2560  # ticks at which the force goes, and comes back
HAND = "reach&amplitude_m=0.045&stroke_s=0.8&delay_s=0.4&stop_s=1.2"


def pressed(kind: str, hand: str = HAND, seconds: float = 4.0) -> Settings:
    if kind == "scene":
        return of_scene("wall", "lan", seconds)
    users = [{"name": "anna", "hand": hand}]
    return resolve({"seconds": seconds, "object": {"kind": kind}, "coupling": {"kind": "local"}, "users": users})


def take_and_return(laboratory: Laboratory, how: str) -> None:
    """Let the force go by a fault of the device, or by a server that is gone; and let it come back."""
    core, now_ns = laboratory.people[0].core, laboratory.now_ns
    if laboratory.tick == AWAY:
        if how == "rearmed":
            core.handle(DeviceFailed("of the test"), now_ns)
        else:
            laboratory.restart_from = laboratory.kill()  # type: ignore[attr-defined]
    if laboratory.tick == BACK:
        if how == "rearmed":
            core.handle(Rearm(), now_ns)
        else:
            laboratory.restart(laboratory.restart_from)  # type: ignore[attr-defined]


@pytest.mark.sample(1)
@pytest.mark.parametrize("how", ["rearmed", "resumed"])
@pytest.mark.parametrize("kind", [long("wall"), "faces", "scene"])
def test_a_hand_deep_inside_is_not_thrown_out(kind: str, how: str) -> None:
    """It sinks 26 to 45 mm while there is no force. Before, the wall gave it 68 to 89 mJ, and the peak of the device."""
    laboratory, forces = Laboratory(pressed(kind)), list[tuple[float, ...]]()
    core, work_j, least_j, deepest_m, before_m = laboratory.people[0].core, 0.0, 0.0, 0.0, (0.0,)

    def watch(now: Laboratory) -> None:
        nonlocal work_j, least_j, deepest_m, before_m
        take_and_return(now, how)
        if now.tick < BACK:
            deepest_m = max(deepest_m, core.position_m[0])
            return
        if forces:
            work_j += sum(force * (x - p) for force, x, p in zip(forces[-1], core.position_m, before_m, strict=True))
            least_j = min(least_j, work_j)
        forces.append(core.force_n)
        before_m = core.position_m

    laboratory.run(watch)
    laboratory.close_ledger()
    assert isinstance(core.coupling, LocalCoupling)
    assert core.safety.state == "live"
    assert core.safety.gain == 1.0
    assert deepest_m > 0.04
    assert least_j >= -(MOST_SAVED_J + LENT_J), "what the contact had saved, and what a ramp lends"
    assert max(hypot(*force) for force in forces) < 1.5
    assert max(dist(after, earlier) for earlier, after in pairwise(forces)) < 0.2
    account = core.account
    assert account is not None
    assert account.device.let_go == 0
    assert account.device.leak_j < 1e-3


@pytest.mark.sample(1)
@pytest.mark.parametrize("how", ["rearmed", "resumed"])
def test_and_feels_all_of_the_wall_once_it_has_been_outside(how: str) -> None:
    """The surface follows the hand out, and is where it belongs for one that comes in again."""
    hand = "waypoints&times_s=0.5,1.2,2.6,3.1,3.5,4.5&x_m=-0.01,0.045,0.045,-0.01,0.01,0.01"
    laboratory = Laboratory(pressed("wall", hand=hand, seconds=4.5))
    core, deepest_m = laboratory.people[0].core, 0.0

    def watch(now: Laboratory) -> None:
        nonlocal deepest_m
        deepest_m = max(deepest_m, core.position_m[0])
        take_and_return(now, how)

    laboratory.run(watch)
    laboratory.close_ledger()
    assert core.account is not None
    assert deepest_m > 0.04
    assert core.account.felt_stiffness_npm == pytest.approx(1000.0, rel=1e-6)
    assert core.force_n[0] == pytest.approx(1000.0 * core.position_m[0], rel=1e-6)
    assert core.force_n[0] > 2.0


@pytest.mark.sample(1)
@pytest.mark.parametrize("kind", ["wall", "scene"])
def test_a_surface_that_has_yielded_is_not_felt_as_intended(kind: str) -> None:
    """The hand rests as deep as there is no force, and says how soft that is."""
    laboratory = Laboratory(pressed(kind))
    laboratory.run(lambda now: take_and_return(now, "resumed"))
    laboratory.close_ledger()
    (account,) = [person.core.account for person in laboratory.people]
    assert account is not None
    assert account.felt_stiffness_npm is None or account.felt_stiffness_npm < 100.0
    judgement = felt(of_laboratory(laboratory))
    assert judgement.tone == "warn", judgement.sentence
