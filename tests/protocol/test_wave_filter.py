"""The filter of a wave: passive over every horizon, for any lengths that waves are held, and while it is changed."""

from math import cos, pi, sin, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.line.wave_filter import WaveFilter

waves = st.floats(-30.0, 30.0)
lags = st.one_of(st.just(0.0), st.floats(1e-9, 600.0))  # ticks: none, or a lag that can be divided by
ticks = st.integers(1, 16)


def stored(filtered: WaveFilter) -> float:
    return filtered._content[0] ** 2 / filtered.lag_ticks if filtered.lag_ticks else 0.0


@given(lags, st.lists(st.tuples(waves, ticks, st.integers(0, 15)), max_size=60))
def test_what_comes_in_goes_out_is_stored_or_is_dissipated(lag: float, steps: list[tuple[float, int, int]]) -> None:
    """Each wave is held for its ticks, less those by which it is cut short: the balance is exact where none is."""
    filtered = WaveFilter(2, lag)
    balance = moved = 0.0
    for wave, held, cut in steps:
        before = stored(filtered)
        out, mirrored = filtered.step((wave, -wave), held)
        assert mirrored == -out
        if not lag:
            assert out == wave
        else:
            lost = held * (1.0 + held / lag) * (wave - out) ** 2
            assert held * (wave**2 - out**2) == pytest.approx(stored(filtered) - before + lost, rel=1e-9, abs=1e-6)
        played = max(1, held - cut)
        filtered.cut(held - played)
        balance += played * (wave**2 - out**2)
        moved += played * (wave - out)
        assert balance >= stored(filtered) - 1e-6
        assert filtered._content[0] == pytest.approx(moved, rel=1e-9, abs=1e-6) or not lag


@given(lags, st.lists(st.tuples(waves, ticks, lags, st.floats(0.3, 3.0)), max_size=60))
def test_no_change_of_lag_or_impedance_makes_energy(lag: float, steps: list[tuple[float, int, float, float]]) -> None:
    filtered, balance = WaveFilter(1, lag), 0.0
    for wave, held, after, ratio in steps:
        (out,) = filtered.step((wave,), held)
        balance += held * (wave**2 - out**2)
        before, content = stored(filtered), filtered._content[0]
        (owed,) = filtered.retune(after, ratio)
        assert stored(filtered) <= before * (1.0 + 1e-12)
        assert filtered._content[0] + owed == pytest.approx(sqrt(ratio) * content), "displacement, read with the new b"
        assert balance >= stored(filtered) - 1e-6


def test_a_filter_that_grows_shorter_could_make_energy_if_it_kept_its_content() -> None:
    """The test above can fail: C^2 / S grows as S falls."""
    filtered = WaveFilter(1, 100.0)
    for _ in range(200):
        filtered.step((1.0,), 8)
    before = stored(filtered)
    filtered.lag_ticks = 50.0
    assert stored(filtered) > 1.9 * before


@given(st.floats(1.0, 600.0), st.floats(-5.0, 5.0), ticks)
def test_a_steady_wave_passes_whole_and_is_behind_by_the_lag(lag: float, wave: float, held: int) -> None:
    filtered, behind = WaveFilter(1, lag), 0.0
    for _ in range(int(60.0 * lag / held) + 10):
        (out,) = filtered.step((wave,), held)
        behind += held * (wave - out)
    assert out == pytest.approx(wave, rel=1e-9, abs=1e-9)
    assert behind == pytest.approx(lag * wave, rel=1e-6, abs=1e-6), "S ticks: what it adds to the loop"


@pytest.mark.parametrize("lag", [5.0, 50.0, 400.0])
def test_its_corner_is_where_theory_has_it(lag: float) -> None:
    """|H|^2 = 1 / (1 + (w S)^2) where w S is small against a frame's rate."""
    filtered, omega = WaveFilter(1, lag), 1.0 / lag
    sine, cosine, count = 0.0, 0.0, 20 * round(2.0 * pi / omega)
    for tick in range(2 * count):
        (out,) = filtered.step((sin(omega * tick),), 1)
        if tick >= count:
            sine += out * sin(omega * tick)
            cosine += out * cos(omega * tick)
    assert 2.0 / count * sqrt(sine**2 + cosine**2) == pytest.approx(sqrt(0.5), rel=0.1)
