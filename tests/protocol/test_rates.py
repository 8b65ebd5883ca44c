"""Deadlines in whole nanoseconds, and the two rates that must fit."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.settings.rates import NS_PER_S, Rates, RatesError, due_ns


@given(st.integers(0, 2**62), st.integers(1, 20_000), st.integers(0, 10**12))
def test_a_deadline_is_the_last_whole_nanosecond_up_to_it(t0_ns: int, rate_hz: int, tick: int) -> None:
    """Whole seconds are exact, and every frame's border is a tick of the device, however long a session is."""
    assert 0 <= tick * NS_PER_S - (due_ns(t0_ns, tick, rate_hz) - t0_ns) * rate_hz < rate_hz


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
