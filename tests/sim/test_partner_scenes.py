"""Two people hold the box of the shipped lift by copies of the scene: it stays held, and what becomes of partners steps nobody.

All in virtual time, on three axes. Delay each way in ms.
"""

from math import dist, hypot

import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest

from cogrip.cli.settings.settings_file import load
from cogrip.cli.settings.shipped_settings import shipped
from cogrip.client.coupling.partner.partner_scene import PartnerSceneCoupling
from cogrip.client.coupling.partner.scene_copy import SceneCopy
from cogrip.client.coupling.partner.spring_gate import BUDGET_J
from cogrip.protocol.wire.session import LOST_NS
from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.sim.laboratory import Laboratory

from tests.extent import long
from tests.sim.felt_forces import Felt
from tests.sim.test_partner_life import silenced
from tests.sim.test_people_join_and_leave import seated

MOST_STEP_N = 0.5
MOST_BREAK_N = 0.8  # Contact that breaks, as a box slips out from between two tools, may step the force by so much.
PRESSED_S, ALOFT_S, DOWN_S = 2.3, 4.0, 7.5  # times of the hands of `configs/lift.toml`


def lifting(delay_ms: float, *overrides: str) -> Laboratory:
    settings = load(shipped("lift"), ["coupling.kind=partner", f"link.delay_ms={delay_ms}", *overrides])
    return Laboratory(settings)


def coupling_of(laboratory: Laboratory, number: int) -> PartnerSceneCoupling:
    coupling = laboratory.people[number].core.coupling
    assert isinstance(coupling, PartnerSceneCoupling)
    return coupling


def copy_of(laboratory: Laboratory, number: int) -> SceneCopy:
    copy = coupling_of(laboratory, number).copy
    assert copy is not None
    return copy


def until(felt: Felt, seconds: float) -> None:
    felt.run(round((seconds - felt.laboratory.seconds) * 128))


class Grip:
    """How far each tool of a copy slips along the box between its faces while that is aloft, and how far it is turned."""

    def __init__(self, laboratory: Laboratory, number: int) -> None:
        self._laboratory, self._number = laboratory, number
        self._begun: dict[int, tuple[float, ...]] = {}
        self.slip_m = self.turned = self.lifted_m = 0.0

    def look(self) -> None:
        copy = copy_of(self._laboratory, self._number)
        height = copy.object_m[2]
        x, y, z, turn = copy.object_pose
        self.lifted_m = max(self.lifted_m, height)
        if height < 0.01:
            self._begun.clear()
            return
        for seat, place in copy.tool_places().items():
            local = np.zeros(3)
            inverse = np.zeros(4)
            mujoco.mju_negQuat(inverse, np.array(turn))
            mujoco.mju_rotVecQuat(local, np.array(place) - (x, y, z), inverse)
            along = tuple(local[1:].tolist())
            self.slip_m = max(self.slip_m, dist(along, self._begun.setdefault(seat, along)))
        self.turned = max(self.turned, 2.0 * hypot(*turn[1:]))


@pytest.mark.parametrize(
    ("delay_ms", "most_slip_m"), [long(0.0, 1e-4), long(20.0, 1e-4), (100.0, 2e-4), long(200.0, 2e-3)]
)
def test_the_box_is_lifted_and_carried_in_the_scene_and_in_each_copy(delay_ms: float, most_slip_m: float) -> None:
    laboratory = lifting(delay_ms)
    felt, grips = Felt(laboratory), [Grip(laboratory, number) for number in (0, 1)]
    until(felt, PRESSED_S)
    while laboratory.seconds < DOWN_S - 1.0:
        felt.run(1)
        for grip in grips:
            grip.look()
    until(felt, DOWN_S + 2.0)
    world = laboratory.room.world
    assert isinstance(world, SceneWorld)
    task, scene = world.progress.account(), world.accounts.scene()
    assert task is not None
    assert task["reached"]
    assert scene["lifted_m"] > 0.04
    assert scene["lifted_slip_m"] < 1e-5
    assert felt.step_n < MOST_STEP_N
    for number, grip in enumerate(grips):
        assert grip.lifted_m > 0.04
        assert grip.slip_m < most_slip_m
        assert grip.turned < 0.05
        gate = coupling_of(laboratory, number).gate
        assert gate.budget_j > 0.0
        assert copy_of(laboratory, number).object_pose[:3] == pytest.approx(
            world.position + world.offset[number], abs=1e-4
        ), "what nobody holds lies where the server has it"
    work = [coupling_of(laboratory, number).gate.work.value for number in (0, 1)]
    refill = [coupling_of(laboratory, number).gate.refilled_j for number in (0, 1)]
    assert sum(work) >= -2.0 * BUDGET_J - sum(refill)


@pytest.mark.parametrize("how", ["leaves", "is killed"])
def test_who_is_left_with_a_box_aloft_feels_no_jolt_as_it_falls(how: str) -> None:
    laboratory = lifting(100.0)
    felt = Felt(laboratory, 0)
    until(felt, ALOFT_S)
    if how == "leaves":
        laboratory.leave(1)
    else:
        silenced(laboratory)
    assert copy_of(laboratory, 0).object_m[2] > 0.03
    felt.run(round(LOST_NS * 128e-9) + 256)
    assert felt.step_n < MOST_BREAK_N
    assert copy_of(laboratory, 0).object_m[2] < 0.005
    assert laboratory.people[0].core.safety.state == "live"


@pytest.mark.parametrize("delay_ms", [20.0, long(100.0)])
def test_a_server_that_dies_while_two_press_finds_both_holding_on(delay_ms: float) -> None:
    laboratory = lifting(delay_ms)
    felt = Felt(laboratory)
    until(felt, PRESSED_S + 0.5)
    copies = [copy_of(laboratory, number) for number in (0, 1)]
    gates = [coupling_of(laboratory, number).gate for number in (0, 1)]
    checkpoints = laboratory.kill()
    felt.run(40)
    laboratory.restart(checkpoints)
    felt.until(seated(laboratory), 4.0)
    felt.run(64)
    assert felt.step_n < MOST_STEP_N
    for number, person in enumerate(laboratory.people):
        assert person.core.session.renewed == 1
        assert copy_of(laboratory, number) is copies[number]
        assert coupling_of(laboratory, number).gate is gates[number], "one budget for the life of the hand"


def test_a_hand_feels_nothing_before_its_copy_is_whole() -> None:
    laboratory = lifting(20.0)
    felt = Felt(laboratory)
    while coupling_of(laboratory, 0).copy is None if laboratory.people[0].core.seated else True:
        felt.run(1)
        assert felt.peak_n == 0.0
        assert laboratory.seconds < 0.5
    until(felt, 1.0)
    assert felt.step_n < MOST_STEP_N


def test_a_partner_who_is_known_late_as_it_presses_already_is_held_against() -> None:
    """With this seed a's client hears of b only as b presses, whose hand then means to be inside of the box."""
    laboratory = lifting(100.0, "link.jitter_ms=5", "link.loss=0.02", "seed=1")
    felt = Felt(laboratory)
    until(felt, DOWN_S + 1.0)
    task = laboratory.room.world.progress.account()
    assert task is not None
    assert task["reached"]
    assert felt.step_n < MOST_STEP_N


def test_who_falls_silent_as_it_presses_comes_back_to_press() -> None:
    laboratory = lifting(50.0)
    felt = Felt(laboratory)
    until(felt, PRESSED_S + 0.4)
    back = laboratory.people[1].core
    laboratory.lose_address(1)
    felt.until(lambda: back.session.state == "resuming", 2.0)
    felt.until(seated(laboratory), 3.0)
    felt.run(192)
    assert felt.step_n < MOST_STEP_N
    assert back.session.resumed == 1
    assert all(person.core.safety.state == "live" for person in laboratory.people)
