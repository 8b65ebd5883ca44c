"""Two people hold a scene's body by tools that turn, with models of each other: welded to it, and by contact.

All in virtual time, on six axes. Delay each way in ms.
"""

from math import hypot

import numpy as np
import pytest

from cogrip.cli.settings.settings_file import load
from cogrip.cli.settings.shipped_settings import shipped
from cogrip.client.coupling.partner.partner_pose import PartnerPoseCoupling
from cogrip.client.coupling.partner.spring_gate import BUDGET_J
from cogrip.protocol.laws.rotations import between, exp
from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.sim.laboratory import Laboratory

from tests.extent import long
from tests.sim.felt_forces import Felt

MOST_STEP = 0.5  # N or N m, from one tick to the next
TWIST_RAD = 0.5
WRIST_NMPRAD, SPRING_NMPRAD = 1.0, 1.0  # of `sim:freeflyer`, and of the seat: K b_r / b
FREE = "object.axes=6", "users.0.device=sim:freeflyer", "users.1.device=sim:freeflyer"


def coupling_of(laboratory: Laboratory, number: int) -> PartnerPoseCoupling:
    coupling = laboratory.people[number].core.coupling
    assert isinstance(coupling, PartnerPoseCoupling)
    return coupling


def held(scene: str, delay_ms: float, *overrides: str) -> Laboratory:
    return Laboratory(
        load(shipped(scene), ["coupling.kind=partner", f"link.delay_ms={delay_ms}", "seed=1", *overrides])
    )


def check_gates(laboratory: Laboratory) -> None:
    gates = [coupling_of(laboratory, number).gate for number in (0, 1)]
    assert min(gate.budget_j for gate in gates) > 0.0
    assert sum(gate.work.value for gate in gates) >= -2.0 * BUDGET_J - sum(gate.refilled_j for gate in gates)


def check_copies(laboratory: Laboratory, apart_m: float, apart_rad: float) -> None:
    """Look whether each hand's own copy is where the server's scene is."""
    world = laboratory.room.world
    for number in (0, 1):
        copy = coupling_of(laboratory, number).copy
        assert copy is not None
        x, y, z, turn = copy.object_pose
        there = world.position + world.offset[number]
        assert hypot(*(np.array((x, y, z)) - there[:3])) < apart_m
        assert hypot(*between(exp(there[3:].tolist()), turn)) < apart_rad


@pytest.mark.parametrize("delay_ms", [long(0.0), 100.0, long(200.0)])
def test_who_twists_against_a_partner_feels_both_wrists_at_any_delay(delay_ms: float) -> None:
    hands = [
        "waypoints&times_s=0.4,1.2,1.5,2.2&z_m=0,0.04,0.04,0.04&rx_rad=0,0,0," + str(turn)
        for turn in (TWIST_RAD, -TWIST_RAD)
    ]
    laboratory = held("peg", delay_ms, f"users.0.hand={hands[0]}", f"users.1.hand={hands[1]}")
    felt = Felt(laboratory)
    felt.run(round((3.5 + 0.01 * max(0.0, delay_ms - 100.0)) * 128))
    # Trust in a model that was late as both moved comes back within some seconds (5b.2), and the welds give way a little.
    wanted_nm = 2.0 * TWIST_RAD / (2.0 / WRIST_NMPRAD + 2.0 / SPRING_NMPRAD)
    for number, sign in ((0, -1.0), (1, 1.0)):
        torque_nm = laboratory.people[number].core.force_n[3]
        assert -sign * torque_nm == pytest.approx(wanted_nm, rel=0.12)
    assert felt.step_n < MOST_STEP
    check_gates(laboratory)
    check_copies(laboratory, 0.003, 0.1)


@pytest.mark.parametrize("delay_ms", [long(20.0), long(100.0), long(200.0)])
@pytest.mark.parametrize(("scene", "overrides"), [("peg", ()), ("lift", FREE)], ids=["welded", "by contact"])
def test_the_task_is_done(scene: str, overrides: tuple[str, ...], delay_ms: float) -> None:
    laboratory = held(scene, delay_ms, *overrides)
    felt = Felt(laboratory)
    felt.run(round(12.0 * 128))
    world = laboratory.room.world
    assert isinstance(world, SceneWorld)
    task = world.progress.account()
    assert task is not None
    assert task["reached"]
    assert felt.step_n < MOST_STEP
    check_gates(laboratory)
    if (scene, delay_ms) != ("peg", 200.0):  # there the peg of a hand's own copy may rest on the rim of its hole
        check_copies(laboratory, 0.003, 0.06)
