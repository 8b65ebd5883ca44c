"""Laws of an energy reserve: newest balance, least after the first second, and margin, the least of all."""

from math import inf

from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.line.energy_reserve import EnergyReserve, known

energies = st.floats(-1e3, 1e3)
frames = st.lists(st.tuples(st.integers(1, 5), st.none() | energies), max_size=60)


@given(st.integers(1, 40), frames)
def test_the_least_after_the_first_second_is_that_of_the_frames_after_it(network_hz: int, balances: list) -> None:  # type: ignore[type-arg]
    reserve, passed, margin, later = EnergyReserve(network_hz), 0, 0.0, inf
    for count, value in balances:
        passed += count
        reserve.elapse(count)
        if value is not None:
            reserve.update(value)
            margin = min(margin, value)
            later = min(later, value) if passed >= network_hz else later
            assert reserve.now_j == value >= margin
        assert reserve.reported_j == known(later)
        assert reserve.reported_j is None or reserve.reported_j >= margin


def test_a_ledger_without_a_balance_reports_nothing() -> None:
    reserve = EnergyReserve(128)
    for _ in range(1000):
        reserve.elapse()
    assert (reserve.now_j, reserve.reported_j) == (None, None)
