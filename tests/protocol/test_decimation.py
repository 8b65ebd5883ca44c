"""The decimators: what each does to the energy and the integral of any signal, and the golden numbers of theory 3.2."""

from math import exp, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.axes import PLACES
from cogrip.protocol.laws.decimation import KINDS, Decimator, lag_s, make_decimator

M = 8
TICK_S = 1.0 / 1024.0
FRAME_S = M * TICK_S

ratios = st.integers(1, 16)
samples = st.floats(-1e3, 1e3)


def decimated(decimator: Decimator, signal: list[float], ticks_per_frame: int = M) -> list[float]:
    out = []
    for tick, value in enumerate(signal):
        decimator.push((value,))
        if (tick + 1) % ticks_per_frame == 0:
            out.append(decimator.take()[0])
    return out


def impulse_response(kind: str, cutoff_rad_s: float, frames: int = 400) -> np.ndarray:
    """h[n]: weight of the sample n ticks before a frame's end, measured one phase at a time. Shape (frames M,)."""
    response = np.zeros(frames * M)
    for place in range(M):
        signal = [0.0] * (frames * M)
        signal[place] = 1.0
        response[M - 1 - place :: M] = decimated(make_decimator(kind, 1, M, TICK_S, cutoff_rad_s), signal)
    return response


def alias_gains(response: np.ndarray, points: int = 2048) -> np.ndarray:
    """H at (w + 2 pi k)/M for k < M, shape (M, points), w from 0 to 2 pi."""
    return np.fft.fft(response, points * M).reshape(M, points)


def largest_gain(kind: str, cutoff_rad_s: float = 50.0) -> float:
    """max over w of S(w) = sum over the aliases of |H|^2 (theory 3.2)."""
    return float((np.abs(alias_gains(impulse_response(kind, cutoff_rad_s))) ** 2).sum(axis=0).max())


@given(ratios, st.data())
def test_boxcar_never_creates_energy_and_keeps_the_integral(ratio: int, data: st.DataObject) -> None:
    frames = data.draw(st.integers(1, 8))
    signal = data.draw(st.lists(samples, min_size=ratio * frames, max_size=ratio * frames))
    slow = decimated(make_decimator("boxcar", 1, ratio, 1.0, 50.0), signal, ratio)
    fast_energy = sum(value * value for value in signal)
    assert ratio * sum(value * value for value in slow) <= fast_energy * (1.0 + 1e-12)
    assert ratio * sum(slow) == pytest.approx(sum(signal), abs=1e-9 * (1.0 + sum(map(abs, signal))))


@given(st.lists(samples, min_size=M, max_size=M), samples)
def test_axes_do_not_touch_each_other(signal: list[float], other: float) -> None:
    for kind in KINDS:
        both, alone = (make_decimator(kind, axes, M, TICK_S, 50.0) for axes in (2, 1))
        for value in signal:
            both.push((value, other))
            alone.push((value,))
        assert both.take()[:1] == alone.take()


@pytest.mark.parametrize(
    ("kind", "cutoff_rad_s", "golden", "digits"),
    [
        ("boxcar", 50.0, 1.0, 4),
        ("none", 50.0, 8.0, 9),
        ("lowpass", 50.0, 1.0125, 4),
        ("lowpass", 2 * pi * 20, 1.078, 3),
        ("lowpass", 2 * pi * 40, 1.296, 3),
        ("lowpass", 2 * pi * 64, 1.691, 3),
    ],
)
def test_golden_maxima_over_the_aliases(kind: str, cutoff_rad_s: float, golden: float, digits: int) -> None:
    assert largest_gain(kind, cutoff_rad_s) == pytest.approx(golden, abs=0.5 * 10**-digits)


def energy_ratio(kind: str, signal: list[float]) -> float:
    slow = decimated(make_decimator(kind, 1, M, TICK_S, 50.0), signal)
    return M * sum(value * value for value in slow) / sum(value * value for value in signal)


def test_the_papers_own_filter_creates_energy_on_its_worst_signal() -> None:
    """The signal that excites all aliases in phase: cut-off below pi/M is not enough (P section II)."""
    gains = alias_gains(impulse_response("lowpass", 50.0))
    points = gains.shape[1]
    worst = int((np.abs(gains) ** 2).sum(axis=0).argmax())
    ticks = np.arange(2 * points * M)
    signal = np.zeros(len(ticks))
    for alias in range(M):
        angle = 2 * pi * (worst + points * alias) / (points * M)
        signal += (np.conj(gains[alias, worst]) * np.exp(1j * angle * (ticks + 1))).real
    assert energy_ratio("lowpass", signal.tolist()) == pytest.approx(largest_gain("lowpass"), abs=1e-3)
    assert energy_ratio("lowpass", signal.tolist()) > 1.01
    assert energy_ratio("boxcar", signal.tolist()) <= 1.0


def test_lowpass_lag_is_the_closed_form() -> None:
    lowpass = make_decimator("lowpass", 1, M, TICK_S, 50.0)
    steps = decimated(lowpass, [1.0] * (400 * M))
    shortfall_s = FRAME_S * (1.0 + sum(1.0 - value for value in steps))  # one frame of hold before the first
    assert lag_s("lowpass", FRAME_S, 50.0) == pytest.approx(shortfall_s, rel=1e-12)
    assert lag_s("lowpass", FRAME_S, 50.0) == pytest.approx(FRAME_S / (1.0 - exp(-50.0 * FRAME_S)))
    assert f"{lag_s('lowpass', FRAME_S, 50.0) * 1e3:.3f}" == "24.160"
    assert lag_s("boxcar", FRAME_S, 50.0) == lag_s("none", FRAME_S, 50.0) == FRAME_S == 0.0078125


@pytest.mark.parametrize("axes", [1, 2, 3, 6])
def test_no_more_numbers_are_added_than_there_are_axes(axes: int) -> None:
    made = [make_decimator("boxcar", axes, 2, 1e-3, 50.0) for _ in range(20)]
    for boxcar in made:
        if axes == PLACES:
            with pytest.raises(ValueError, match=r"."):
                boxcar.push((1.0,) * 30)
        else:
            boxcar.push((1.0,) * 30)
            assert boxcar.take() == (0.5,) * axes
