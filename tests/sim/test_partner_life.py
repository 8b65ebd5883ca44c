"""Partners come, leave, are kicked, fall silent and come back, and the server dies: no step of force, and a law that holds on.

All in virtual time, with hands that pull apart, so that each feels what becomes of the others. Delay each way in ms.
"""

from collections.abc import Callable
from typing import Any

import pytest

from cogrip.client.coupling.partner.partner_coupling import PartnerCoupling
from cogrip.client.coupling.partner.spring_gate import BUDGET_J, SpringGate
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.wire.session import LOST_NS
from cogrip.server.inputs import Kick
from cogrip.sim.laboratory import Laboratory

from tests.extent import every, long
from tests.sim.felt_forces import Felt
from tests.sim.test_people_join_and_leave import seated

MOST_STEP_N = 0.5
HELD_N = 3.0  # of two who pull apart
FAR = [long(10.0), long(50.0), 101.6, long(203.0)]


def pulling(delay_ms: float, people: int = 2, **link: float) -> Laboratory:
    """The first pulls one way and the second the other; a third swings gently between them."""
    hands = ("0.03", "-0.03", "0.002")
    courses = [f"waypoints&times_s=0.5,1.5&x_m=0,{place}" for place in hands[:2]] + [
        f"sine&amplitude_m={hands[2]}&frequency_hz=0.5"
    ]
    users = [
        {
            "name": "abc"[number], "device": "sim:ideal?mass_kg=0.1&damping_nspm=0.5",
            "hand": f"{courses[number]}&hand_stiffness_npm=300&hand_damping_nspm=5",
        }
        for number in range(people)
    ]  # fmt: skip
    return Laboratory(resolve({
        "seconds": 1e3, "coupling": {"kind": "partner", "stiffness_npm": 1000.0, "damping_nspm": 10.0},
        "object": {"axes": 1, "mass_kg": 0.2}, "link": {"delay_ms": delay_ms, **link}, "users": users,
    }))  # fmt: skip


def gate_of(laboratory: Laboratory, number: int) -> SpringGate:
    coupling: Any = laboratory.people[number].core.coupling
    assert isinstance(coupling, PartnerCoupling)
    return coupling.gate


def held(laboratory: Laboratory, *numbers: int) -> Felt:
    """Run until the two pull against each other and nothing moves. Return what watches these from there on."""
    felt = Felt(laboratory, *numbers)
    felt.run(288)
    assert felt.step_n < MOST_STEP_N
    assert all(abs(laboratory.people[number].core.force_n[0]) > HELD_N for number in (0, 1))
    return Felt(laboratory, *numbers)


def kicked(laboratory: Laboratory) -> None:
    laboratory.server.handle(Kick("b", laboratory.settings.name, "enough"), laboratory.now_ns)


class Every(set[str]):
    """All addresses that there are and will be."""

    def __contains__(self, address: object) -> bool:
        return True


def silenced(laboratory: Laboratory) -> None:
    """Cut both directions of b for good, as where its process is killed with -9."""
    laboratory.people[1].lost = Every()


ENDS: dict[str, Callable[[Laboratory], None]] = {
    "leaves": lambda laboratory: laboratory.leave(1), "is kicked": kicked, "is killed": silenced,
}  # fmt: skip
ENDING = {
    "leaves": (101.6, 10.0, 50.0, 203.0),
    "is kicked": (101.6, 10.0, 50.0, 203.0),
    "is killed": (10.0, 50.0, 101.6, 203.0),
}
"""Delays at which a partner ends so, of which the first is ordinary."""


@pytest.mark.parametrize(
    ("how", "delay_ms"),
    every(4, [(how, delay_ms) for how, delays in ENDING.items() for delay_ms in delays]),
)
def test_the_force_fades_without_a_step_where_a_partner_ends(how: str, delay_ms: float) -> None:
    laboratory = pulling(delay_ms)
    felt = held(laboratory, 0)
    ENDS[how](laboratory)
    felt.run(round(LOST_NS * 128e-9) + 256)
    assert felt.step_n <= MOST_STEP_N
    assert abs(laboratory.people[0].core.force_n[0]) < 0.1
    assert laboratory.people[0].core.safety.state == "live"
    assert laboratory.room.seats[1].state == "free"


@pytest.mark.parametrize("delay_ms", FAR)
def test_a_third_comes_and_goes_without_a_step(delay_ms: float) -> None:
    laboratory = pulling(delay_ms, people=3)
    felt = held(laboratory, 0, 1)
    for _ in range(2):
        laboratory.leave(2)
        felt.run(200)
        laboratory.come(2)
        felt.run(256)
    assert felt.step_n <= MOST_STEP_N
    assert all(person.core.safety.state == "live" for person in laboratory.people)
    assert all(abs(laboratory.people[number].core.force_n[0]) > HELD_N for number in (0, 1))


@pytest.mark.parametrize("delay_ms", FAR)
def test_who_falls_silent_comes_back_by_the_ticket_to_the_same_budget(delay_ms: float) -> None:
    laboratory = pulling(delay_ms)
    felt = held(laboratory, 0)
    back, before_j = laboratory.people[1].core, gate_of(laboratory, 1).budget_j
    laboratory.lose_address(1)
    felt.until(lambda: back.session.state == "resuming", 1.0 + 4e-3 * delay_ms)
    felt.until(seated(laboratory), 3.0)
    felt.run(256)
    assert felt.step_n <= MOST_STEP_N
    assert (back.session.resumed, back.session.renewed) == (1, 0)
    assert all(abs(person.core.force_n[0]) > HELD_N for person in laboratory.people)
    assert gate_of(laboratory, 1).budget_j <= before_j + BUDGET_J


@pytest.mark.parametrize("delay_ms", FAR)
@pytest.mark.parametrize("away_s", [0.3, long(1.2)])
def test_a_server_that_dies_and_is_started_anew_steps_nobody_and_lends_nobody_more(
    delay_ms: float, away_s: float
) -> None:
    laboratory = pulling(delay_ms)
    felt = held(laboratory)
    gates = [gate_of(laboratory, number) for number in (0, 1)]
    checkpoints = laboratory.kill()
    felt.run(round(away_s * 128))
    laboratory.restart(checkpoints)
    felt.until(seated(laboratory), 4.0)
    felt.run(2 * 128)
    assert felt.step_n <= MOST_STEP_N
    for number, person in enumerate(laboratory.people):
        assert person.core.session.renewed == 1
        assert person.core.safety.state == "live"
        assert gate_of(laboratory, number) is gates[number], "one budget for the life of the hand"
        ledger = person.core.ledger
        assert ledger.port_j == pytest.approx(gates[number].work.value, abs=1e-12)
        assert ledger.given_j == pytest.approx(gates[number].granted_j, abs=1e-12)


@pytest.mark.parametrize(("when_s", "moves"), [(1.2, True), (2.6, False)])
def test_the_gate_of_a_hand_that_leaves_knows_its_work_to_the_end(when_s: float, moves: bool) -> None:
    """A hand is let go while it moves: what the line is told of its motion then is not how it moves."""
    laboratory = pulling(20.0)
    felt = Felt(laboratory)
    felt.run(round(when_s * 128))
    person, gate = laboratory.people[0].core, gate_of(laboratory, 0)
    moving = max(map(abs, person.velocity_mps))
    laboratory.leave(0)
    felt.run(128)
    assert (moving > 0.005) is moves
    assert gate.work.value == pytest.approx(person.ledger.work.value, abs=2e-4)
