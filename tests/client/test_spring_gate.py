"""The gate at a hand's own spring: whatever forces, hands, losses and people do, nobody gets more than the law says."""

from itertools import pairwise
from math import cos, pi
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.coupling.partner.spring_gate import BUDGET_J, CAP_J, DAMPED_J, DONATED_S, SpringGate

TICK_S = 1.0 / 1024.0


def tick(gate: SpringGate, random: Random, stiffness: float, damping: float, most_mps: float) -> float:
    """Let a copy go anywhere, and the hand then anywhere within its speed. Return what that tick took beyond what was free."""
    stretch = [random.uniform(-0.2, 0.2) for _ in range(3)]
    velocity = [random.uniform(-most_mps, most_mps) for _ in range(3)]
    part = gate.cut(stretch, stiffness)
    stretch = [part * each for each in stretch]
    damper = [damping * (rate - random.uniform(-2.0, 2.0)) for rate in velocity]
    paid = gate.pay(stretch, stiffness, damper, velocity, damping)
    force = [stiffness * each + more for each, more in zip(stretch, paid, strict=True)]
    moved = [random.uniform(-most_mps, most_mps) * TICK_S for _ in range(3)]
    work = sum(f * step for f, step in zip(force, moved, strict=True))
    gate.work.add(work)
    return max(0.0, -work)


@given(st.integers(0, 2**32), st.floats(10.0, 5000.0), st.floats(0.0, 30.0), st.floats(0.01, 2.0))
def test_a_hand_gets_no_more_than_it_put_in_its_budget_and_the_take_of_two_ticks(
    seed: int, stiffness: float, damping: float, most_mps: float
) -> None:
    gate, random = SpringGate(TICK_S), Random(seed)
    most = 0.0
    for _ in range(400):
        most = max(most, tick(gate, random, stiffness, damping, most_mps))
        assert gate.budget_j >= -2.0 * most - 1e-12
        assert gate.work.value >= -(BUDGET_J + gate.refilled_j + gate.credited_j) - 2.0 * most - 1e-12


@given(st.integers(0, 2**32), st.integers(2, 5), st.floats(0.0, 0.9))
def test_all_hands_together_get_no_more_than_their_budgets(seed: int, people: int, loss: float) -> None:
    """Counters are lost, kept back and repeated; each receiver credits the growth of the largest that it has seen."""
    random, gates = Random(seed), [SpringGate(TICK_S) for _ in range(people)]
    credited = [[0.0] * people for _ in range(people)]
    under_way: list[tuple[int, float]] = []
    most = [0.0] * people
    for _ in range(300):
        most = [max(each, tick(gate, random, 1000.0, 10.0, 0.5)) for each, gate in zip(most, gates, strict=True)]
        under_way += [(number, gate.donated_j) for number, gate in enumerate(gates)]
        random.shuffle(under_way)
        for sender, counter in under_way[: random.randint(0, len(under_way))]:
            for receiver, gate in enumerate(gates):
                grown = counter - credited[receiver][sender]
                if receiver != sender and grown > 0.0 and random.random() >= loss:
                    gate.credit(grown / (people - 1))
                    credited[receiver][sender] = counter
        under_way = under_way[-3 * people :]
        whole = sum(gate.work.value + BUDGET_J + gate.refilled_j for gate in gates)
        assert whole >= -2.0 * sum(most) - 1e-9


def test_what_is_free_above_the_budget_is_given_away_and_above_the_cap_lost() -> None:
    gate = SpringGate(TICK_S)
    gate.work.add(0.3)
    gate.pay([0.0], 1000.0, [0.0], [0.1], 10.0)
    assert gate.spilt_j == 0.3 + BUDGET_J - CAP_J
    before = gate.donated_j
    for _ in range(1024):
        gate.pay([0.0], 1000.0, [0.0], [0.1], 10.0)
    assert before < gate.donated_j <= CAP_J - BUDGET_J
    assert abs(gate.budget_j - BUDGET_J) < 1e-6


def test_a_hand_at_rest_is_refilled_slowly_and_no_other() -> None:
    resting, moving = SpringGate(TICK_S), SpringGate(TICK_S)
    for gate in (resting, moving):
        gate.work.add(-BUDGET_J)
    for _ in range(1024):
        resting.pay([0.0], 1000.0, [0.0], [0.0], 10.0)
        moving.pay([0.0], 1000.0, [0.0], [0.05], 10.0)
    assert 0.014 < resting.refilled_j <= 0.02 * 0.76
    assert moving.refilled_j == 0.0


def test_what_partners_gave_is_credited_bit_by_bit_and_no_more_than_it() -> None:
    """A credit that came at once would let go of the force in one tick."""
    gate, credited = SpringGate(TICK_S), [0.0]
    gate.credit(0.02)
    assert gate.budget_j == BUDGET_J
    for _ in range(round(0.5 / TICK_S)):
        gate.cut([0.0], 1000.0)
        gate.pay([0.0], 1000.0, [0.0], [0.1], 10.0)
        credited.append(gate.credited_j)
    assert max(later - before for before, later in pairwise(credited)) == pytest.approx(0.02 * TICK_S / DONATED_S)
    assert 0.0199 < gate.credited_j <= 0.02


def test_a_stretch_that_is_cut_counts_as_a_tick_gated() -> None:
    gate = SpringGate(TICK_S)
    for stretch, gated in ((0.001, 0), (0.5, 1)):
        part = gate.cut([stretch], 1000.0)
        gate.pay([part * stretch], 1000.0, [0.0], [0.0], 10.0)
        assert gate.gated == gated


@pytest.mark.parametrize("late_ticks", [0, 5])
def test_a_hand_that_has_spent_all_and_goes_on_moving_earns_its_force_again(late_ticks: int) -> None:
    """By its damper, whose speed an encoder tells late: it gives a little as the hand turns, and may not be stuck for that."""
    gate = SpringGate(TICK_S)
    gate.work.add(-BUDGET_J + 2.0 * DAMPED_J)
    speeds = [0.1 * cos(2.0 * pi * 0.6 * tick * TICK_S) for tick in range(-8, 4096)]
    gave, least, stretch = 0.0, 1.0, -0.01
    for tick in range(4096):
        told, true = speeds[8 + tick - late_ticks], speeds[8 + tick]
        least = min(least, gate.budget_j)
        part = gate.cut([stretch], 1000.0)
        stretch = stretch if true > 0.0 and tick < 1024 else 0.0  # it pushes the hand on until that turns
        paid = gate.pay([part * stretch], 1000.0, [10.0 * told * (not stretch)], [told], 10.0)[0]
        work = (paid + 1000.0 * part * stretch) * true * TICK_S
        if not stretch:
            gave += min(0.0, work)
        gate.work.add(work)
    assert least < 1.1 * DAMPED_J
    assert (gave < 0.0) is (late_ticks > 0)
    assert gate.budget_j > 10.0 * DAMPED_J
