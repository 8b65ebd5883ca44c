"""The law of the gates in whole random sessions: all honest hands together take no more than their budgets, whoever lies."""

import pytest

from cogrip.client.coupling.partner.spring_gate import SpringGate
from cogrip.client.coupling.partner.trust import Trust

from tests.extent import every
from tests.interpreted import needs_interpreted
from tests.sim.gate_sessions import POWER_W, outcome_of

SESSIONS = 300


@pytest.mark.parametrize("seed", every(30, range(SESSIONS)))
def test_honest_hands_take_no_more_than_their_budgets_and_what_liars_power_lets_pass(seed: int) -> None:
    found = outcome_of(seed)
    assert found.spare_j >= -1e-9, found


def test_a_liar_who_says_that_it_gave_without_end_passes_its_power_alone() -> None:
    found = outcome_of(1, seconds=2.0, people=2, liars=1)
    assert found.said_j > 1e5 * POWER_W
    assert 0.0 < found.passed_j <= POWER_W * (2.0 + 0.25 + 1.0 / 128.0)


@pytest.fixture
def stiff_models(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every model be twice as stiff as its hand, which makes loops of two grow."""
    monkeypatch.setattr(Trust, "stiffness_npm", lambda self, told, own, spring: min(2.0 * told, 400.0))


@needs_interpreted
@pytest.mark.usefixtures("stiff_models")
@pytest.mark.parametrize("seed", [0, 1])
def test_gates_hold_where_models_are_wrong(seed: int) -> None:
    assert outcome_of(seed, liars=0).spare_j >= -1e-9


@needs_interpreted
@pytest.mark.usefixtures("stiff_models")
@pytest.mark.parametrize("seed", [0, 1])
def test_without_gates_hands_take_what_nobody_put_in(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The harness sees a leak where there is one."""
    monkeypatch.setattr(SpringGate, "cut", lambda self, stretch, stiffness: 1.0)
    monkeypatch.setattr(SpringGate, "pay", lambda self, stretch, K, damper, velocity, B: damper)
    assert outcome_of(seed, liars=0).spare_j < -1.0
