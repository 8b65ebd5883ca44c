"""The loop of the last second."""

from statistics import median_low

from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.line.loop_meter import MOST_LOOP_FRAMES, LoopMeter


@given(
    st.integers(1, 9) | st.just(128), st.lists(st.integers(-3, MOST_LOOP_FRAMES + 3) | st.integers(1, 3), max_size=200)
)
def test_it_is_the_median_of_the_newest(window: int, loops: list[int]) -> None:
    meter = LoopMeter(window)
    kept: list[int] = []
    for number, loop in enumerate(loops):
        meter.add(loop)
        if 1 <= loop <= MOST_LOOP_FRAMES:
            kept.append(loop)
        assert meter.implausible == number + 1 - len(kept)
        assert meter.median() == (median_low(kept[-window:]) if kept else None)
        assert meter.full == (len(kept) >= window)
