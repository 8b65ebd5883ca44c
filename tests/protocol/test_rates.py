"""Deadlines in whole nanoseconds, and the two rates that must fit."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.rates import NS_PER_S, Rates, RatesError, due_ns

YEAR_S = 365 * 86_400


@pytest.mark.parametrize("rate_hz", [1024, 128])
def test_whole_seconds_are_exact_after_a_year(rate_hz: int) -> None:
    for second in (0, 1, 3600, YEAR_S):
        assert due_ns(7, rate_hz * second, rate_hz) == 7 + second * NS_PER_S


def test_128_hz_periods_are_whole_nanoseconds_and_1024_hz_alternates() -> None:
    assert {due_ns(0, k + 1, 128) - due_ns(0, k, 128) for k in range(1000)} == {7_812_500}
    assert [due_ns(0, k + 1, 1024) - due_ns(0, k, 1024) for k in range(4)] == [976_562, 976_563] * 2


@given(st.integers(0, 2**62), st.integers(0, 10**12))
def test_every_frame_border_is_a_device_tick(t0_ns: int, frame: int) -> None:
    assert due_ns(t0_ns, 8 * frame, 1024) == due_ns(t0_ns, frame, 128)


@given(st.integers(1, 20_000), st.integers(0, 10**12))
def test_a_deadline_errs_by_less_than_a_nanosecond(rate_hz: int, tick: int) -> None:
    assert 0 <= tick * NS_PER_S - due_ns(0, tick, rate_hz) * rate_hz < rate_hz


@pytest.mark.parametrize(("device_hz", "network_hz"), [(1000, 128), (64, 128), (1023, 1024)])
def test_rates_that_do_not_fit_cannot_exist(device_hz: int, network_hz: int) -> None:
    with pytest.raises(RatesError, match=rf"rates\.device_hz = {device_hz} .* rates\.network_hz = {network_hz}"):
        Rates(device_hz, network_hz)
    with pytest.raises(msgspec.ValidationError, match="whole multiple"):
        msgspec.convert([device_hz, network_hz], Rates)


@pytest.mark.parametrize("raw", [[1024, 0], [0, 128], [1024, -128], [40_000, 128]])
def test_rates_from_outside_are_bounded(raw: list[int]) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(raw, Rates)
