"""Partners' models in whole sessions: two hands feel each other through a delay, statically exactly, within their budgets."""

from typing import Any

import numpy as np
import pytest

from cogrip.client.coupling.partner.partner_coupling import PartnerCoupling
from cogrip.client.coupling.partner.spring_gate import BUDGET_J
from cogrip.protocol.settings.room import resolve
from cogrip.sim.laboratory import Laboratory

from tests.extent import long
from tests.sim.session_measures import by_tick

K, B, MASS_KG = 1000.0, 10.0, 0.2
HAND_NPM, HAND_NSPM, DEVICE_KG, DEVICE_NSPM = 300.0, 5.0, 0.1, 0.5
START_S = 2.0
PULL = ((0.5, 1.0), (0.0, 0.03)), ((0.5, 1.0), (0.0, -0.03))
REST = ((0.5, 1.0), (0.0, 0.03)), ((0.5, 1.0), (0.0, 0.0))


def session(kind: str, course: Any, delay_ms: float, seconds: float = 3.0, **link: float) -> Laboratory:
    users = [
        {
            "name": "ab"[number], "side": ("left", "right")[number],
            "device": f"sim:ideal?mass_kg={DEVICE_KG}&damping_nspm={DEVICE_NSPM}",
            "hand": f"waypoints&times_s={','.join(str(each + START_S) for each in times)}&x_m={','.join(map(str, places))}"
            f"&hand_stiffness_npm={HAND_NPM}&hand_damping_nspm={HAND_NSPM}",
        }
        for number, (times, places) in enumerate(course)
    ]  # fmt: skip
    coupling = {"kind": kind, "stiffness_npm": K, "damping_nspm": B}
    if kind == "wave":
        coupling["impedance_nspm"] = 20.0
    return Laboratory(resolve({
        "seconds": START_S + seconds, "coupling": coupling, "object": {"axes": 1, "mass_kg": MASS_KG},
        "link": {"delay_ms": delay_ms, **link}, "users": users,
    }))  # fmt: skip


def ideal(course: Any, seconds: float = 3.0, steps: int = 8) -> np.ndarray:
    """Return the force at both hands without a network, at each tick: hands, devices and object by semi-implicit Euler."""
    ticks, h = int(seconds * 1024), 1.0 / 1024 / steps
    place, speed, o, v = [0.0, 0.0], [0.0, 0.0], 0.0, 0.0
    forces = np.zeros((ticks, 2))
    for tick in range(ticks):
        for step in range(steps):
            now, pull = (tick + step / steps) / 1024, 0.0
            for hand, (times, places) in enumerate(course):
                share = min(1.0, max(0.0, (now - times[0]) / (times[1] - times[0])))
                rise = (10 - 15 * share + 6 * share * share) * share**3
                rate = 30 * (share - share * share) ** 2 / (times[1] - times[0])
                way = places[1] - places[0]
                force = K * (place[hand] - o) + B * (speed[hand] - v)
                drive = HAND_NPM * (places[0] + way * rise - place[hand]) + HAND_NSPM * way * rate - force
                speed[hand] = (DEVICE_KG * speed[hand] + h * drive) / (DEVICE_KG + h * (HAND_NSPM + DEVICE_NSPM))
                pull += force
                forces[tick, hand] += force / steps
            v += h * pull / MASS_KG
            o += h * v
            for hand in (0, 1):
                place[hand] += h * speed[hand]
    return forces


def error_n(laboratory: Laboratory, wanted: np.ndarray) -> float:
    rows = by_tick(laboratory, lambda now: [person.core.force_n[0] for person in now.people])
    first = int(START_S * 1024)
    found = np.array(rows)[first : first + len(wanted)]
    return float(np.sqrt(((found - wanted)[256:] ** 2).mean()))


@pytest.mark.parametrize("delay_ms", [long(23.4), 101.6, long(203.1)])
def test_two_who_pull_apart_feel_each_other_through_a_delay(delay_ms: float) -> None:
    wanted = ideal(PULL)
    laboratory = session("partner", PULL, delay_ms)
    assert error_n(laboratory, wanted) < 0.35 * error_n(session("wave", PULL, delay_ms), wanted)
    assert all(person.core.safety.state == "live" for person in laboratory.people)


@pytest.mark.parametrize("delay_ms", [5.0, 101.6, long(300.0)])
def test_a_partner_at_rest_is_as_stiff_as_without_a_network(delay_ms: float) -> None:
    laboratory = session("partner", REST, delay_ms, seconds=5.0)
    laboratory.run()
    core = laboratory.people[0].core
    felt = core.force_n[0] / core.position_m[0]
    assert felt == pytest.approx(1.0 / (2.0 / K + 1.0 / HAND_NPM), rel=0.03)


@pytest.mark.parametrize(("delay_ms", "loss"), [(50.0, 0.05), long(150.0, 0.2)])
def test_nobody_gets_more_than_the_budget_over_a_line_that_loses(delay_ms: float, loss: float) -> None:
    laboratory = session("partner", PULL, delay_ms, loss=loss, jitter_ms=10.0)
    least = by_tick(laboratory, lambda now: [gate_of(person).budget_j for person in now.people])
    assert min(map(min, least)) > -1e-4
    for person in laboratory.people:
        gate = gate_of(person)
        assert gate.work.value >= -(BUDGET_J + gate.refilled_j + gate.credited_j) - 1e-4


def gate_of(person: Any) -> Any:
    coupling = person.core.coupling
    assert isinstance(coupling, PartnerCoupling)
    return coupling.gate


def test_the_force_fades_where_a_partner_leaves() -> None:
    """Its intention goes on with a stiffness that falls, and its silence lets go of what is left."""
    laboratory = session("partner", PULL, 50.0, seconds=4.0)
    forces = by_tick(
        laboratory, lambda now: now.people[0].core.force_n[0], {int(4.0 * 1024): lambda: laboratory.leave(1)}
    )
    held, after = forces[int(4.0 * 1024) - 1], forces[-1]
    assert held > 5.0
    assert abs(after) < 0.2
    assert np.abs(np.diff(forces[int(3.5 * 1024) :])).max() < 0.5
