"""Forces that hands feel of each other by models of partners, in tasks, beside wave lines and no force at all.

`dev.py bench partner` prints all of it, with devices that have friction and encoders too.
"""

from pathlib import Path

import numpy as np
import pytest

from tests.extent import long
from tests.sim.partner_tasks import Felt, error_n, felt, ideal, recorded_pairs, rms_n, several, task_people

DATA = Path("../shared/data")
SECONDS = 4.0
FAR_MS, MIDDLE_MS, NEAR_MS, VERY_FAR_MS = 101.5625, 46.875, 23.4375, 203.125


def step_n(found: Felt, number: int) -> float:
    return float(np.abs(np.diff(found.force_n[:, number])).max())


@pytest.mark.parametrize(("task", "delay_ms", "share"), [
    ("pull", FAR_MS, 0.12), ("opposed", FAR_MS, 0.24), long("rest", FAR_MS, 0.15), long("collide", FAR_MS, 0.18),
    long("pull", NEAR_MS, 0.04), long("opposed", NEAR_MS, 0.08), long("collide", MIDDLE_MS, 0.13),
])  # fmt: skip
def test_a_partner_is_felt_almost_as_without_a_network(task: str, delay_ms: float, share: float) -> None:
    people = task_people(task)
    wanted = ideal(people, seconds=SECONDS)
    error = error_n(felt("partner", people, delay_ms, seconds=SECONDS), wanted)
    assert error < share * rms_n(wanted.force_n)
    assert error < 0.5 * error_n(felt("wave", people, delay_ms, seconds=SECONDS), wanted)


@pytest.mark.parametrize(("task", "delay_ms", "least"), [
    ("together", FAR_MS, 0.9), long("together", VERY_FAR_MS, 0.6), long("apart", VERY_FAR_MS, 0.9),
])  # fmt: skip
def test_hands_that_move_alike_are_told_apart_from_their_models(task: str, delay_ms: float, least: float) -> None:
    """Without trust these were felt worse than no force: at 203 ms by three times."""
    people = task_people(task)
    wanted = ideal(people, seconds=4.5)
    found = felt("partner", people, delay_ms, seconds=4.5)
    known = [each for person in found.laboratory.people for each in person.core.coupling.partners.values()]
    assert all(each.trust.share < least for each in known[:1])
    late = 3 * 1024  # by then it has been learnt
    error = rms_n(found.force_n[late:] - wanted.force_n[late:])
    assert error < 1.1 * rms_n(wanted.force_n[late:])


@pytest.mark.parametrize("task", ["collide", long("opposed"), "let go"])
def test_no_step_of_force_is_above_half_a_newton(task: str) -> None:
    """One own device that is let go: its damper gives up 0.67 N at once, without a network as well."""
    people = task_people(task)
    found = felt("partner", people, FAR_MS, seconds=4.0 if task == "let go" else 2.5)
    assert step_n(found, 0) <= 0.5
    if task != "let go":
        assert step_n(found, 1) <= 0.5


@pytest.mark.parametrize("delay_ms", [long(NEAR_MS), FAR_MS])
def test_the_hand_that_still_pulls_is_let_go_at_the_speed_of_no_network(delay_ms: float) -> None:
    people = task_people("let go")

    def speed(found: Felt) -> float:
        return float(np.abs(np.diff(found.place_m[3 * 1024 :, 0])).max()) * 1024

    wanted = speed(ideal(people, seconds=4.0))
    assert speed(felt("partner", people, delay_ms, seconds=4.0)) == pytest.approx(wanted, rel=0.2)


@pytest.mark.skipif(not DATA.is_dir(), reason="no recorded hands in ../shared/data")
@pytest.mark.parametrize("name", ["levers, free", "arm, x and y", *map(long, ("levers, rigid", "pen, x and y"))])
def test_recorded_hands_feel_each_other_better_than_by_a_wave_line(name: str) -> None:
    hands = recorded_pairs(DATA)[name]
    wanted = ideal(hands, seconds=4.5)
    model, wave = (error_n(felt(each, hands, FAR_MS, seconds=4.5), wanted) for each in ("partner", "wave"))
    assert model < wave


@pytest.mark.parametrize("count", [3, long(5)])
def test_several_people_feel_most_of_each_other(count: int) -> None:
    people = several(count)
    wanted = ideal(people, seconds=5.0)
    assert error_n(felt("partner", people, FAR_MS, seconds=5.0), wanted) < 0.4 * rms_n(wanted.force_n)
