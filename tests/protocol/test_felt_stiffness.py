"""The line as a spring: the numbers of theory 4, and compensation up to where it ends."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.laws.decimation import lag_s
from cogrip.protocol.laws.felt_stiffness import OutOfReachError, compensated_stiffness, felt_stiffness, line_compliance

FRAME_S = 1.0 / 128.0


@pytest.mark.parametrize(
    ("frames_each_way", "hold_s", "hand_npm"),
    [(0, FRAME_S, 837), (1, FRAME_S, 630), (3, FRAME_S, 422), (0, lag_s("lowpass", FRAME_S, 50.0), 623)],
)
def test_what_the_hand_feels_of_1000_npm_at_b_20(frames_each_way: int, hold_s: float, hand_npm: int) -> None:
    compliance = line_compliance(20.0, 2 * frames_each_way * FRAME_S, hold_s)
    assert felt_stiffness(1000.0, compliance) == pytest.approx(hand_npm, abs=0.6)


@given(st.floats(1.0, 1e5), st.floats(1.0, 1e3), st.floats(0.0, 1.0))
def test_compensation_gives_the_hand_what_was_asked_or_names_the_impedance(
    stiffness: float, b: float, round_trip_s: float
) -> None:
    compliance = line_compliance(b, round_trip_s, FRAME_S)
    try:
        rendered = compensated_stiffness(stiffness, b, compliance)
    except OutOfReachError as error:
        assert stiffness * compliance >= 1.0
        advised = float(str(error).partition("coupling.impedance_nspm = ")[2].split()[0])
        within = compensated_stiffness(stiffness, advised, line_compliance(advised, round_trip_s, FRAME_S))
        assert within >= stiffness
    else:
        share = stiffness * compliance
        assert felt_stiffness(rendered, compliance) == pytest.approx(stiffness, rel=1e-12 / (1.0 - share))


def test_both_sides_of_the_reach() -> None:
    """b = 20, no delay: the line alone is 5120 N/m."""
    compliance = line_compliance(20.0, 0.0, FRAME_S)
    assert compensated_stiffness(5119.0, 20.0, compliance) > 1e7
    with pytest.raises(OutOfReachError, match=r"above 20 N s/m would do: set coupling\.impedance_nspm = 22 or more"):
        compensated_stiffness(5120.0, 20.0, compliance)
