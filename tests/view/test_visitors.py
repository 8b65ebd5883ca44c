"""Limits of what people at a page server's port may cost, in virtual time."""

from cogrip.server.rate_limit import Budget
from cogrip.view.visitors import VisitorLimits, Visitors

S = 1_000_000_000
LIMITS = VisitorLimits(
    connections=4, connections_each=2, tabs=4, tabs_each=2, failed=Budget(1, 6), failed_each=Budget(1, 3)
)
ANN, BEN, SIX, SIX_TOO = ("192.0.2.1", 5), ("192.0.2.2", 5), ("2001:db8::1", 5, 0, 0), ("2001:db8::2", 9, 0, 0)


def test_connections_are_bounded_for_each_address_and_in_all():
    visitors = Visitors(LIMITS, 1)
    assert [visitors.connect(ANN) for _ in range(3)] == ["", "", "too many connections of one address"]
    visitors.disconnect(ANN)
    assert [visitors.connect(SIX), visitors.connect(SIX_TOO)] == ["", ""]
    assert visitors.connect(BEN) == "too many connections"
    for address in (BEN, ANN, ANN):
        visitors.disconnect(address)
    assert visitors.connect(BEN) == ""


def test_tabs_are_bounded_for_each_network_and_in_all():
    visitors = Visitors(LIMITS, 1)
    visitors.open_tab(SIX)
    visitors.open_tab(SIX)
    assert visitors.may_open(SIX_TOO) == "too many tabs of one address"
    assert visitors.may_open(ANN) == ""
    visitors.open_tab(ANN)
    visitors.open_tab(BEN)
    assert visitors.may_open(ANN) == "too many tabs"
    visitors.close_tab(SIX)
    assert visitors.may_open(SIX_TOO) == ""
    assert visitors.tabs == 3


def test_wrong_tokens_use_up_a_budget_that_fills_again_and_right_ones_do_not():
    visitors = Visitors(LIMITS, 1)
    for _ in range(3):
        assert visitors.may_try(ANN, S)
        visitors.failed(ANN, S)
    assert not visitors.may_try(ANN, S)
    assert all(visitors.may_try(BEN, S) for _ in range(100))
    assert visitors.may_try(ANN, 2 * S)


def test_many_addresses_together_have_a_budget_too():
    visitors = Visitors(LIMITS, 1)
    for number in range(6):
        visitors.failed((f"192.0.2.{number}", 5), S)
    assert not visitors.may_try(("198.51.100.1", 5), S)
    assert visitors.may_try(("198.51.100.1", 5), 2 * S)


def test_whoever_has_left_takes_no_memory():
    visitors = Visitors(LIMITS, 1)
    for number in range(1000):
        address = (f"10.0.{number // 250}.{number % 250}", 5)
        visitors.connect(address)
        visitors.open_tab(address)
        visitors.close_tab(address)
        visitors.disconnect(address)
    assert not visitors._connections
    assert not visitors._tabs
