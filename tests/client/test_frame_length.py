"""Frames of more or fewer ticks than M: the integral is kept, and no more energy is sent than the port had and may spare."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.coupling.wave_lines import PRESSING, QUIET, ForwardLine

from tests.client.seated_client import seat

M, T_C = 8, 1.0 / 1024.0
waves = st.floats(-2.0, 2.0)


def tick(line: ForwardLine, wave: float, returning: float = 0.0) -> None:
    line.ticks += 1
    line.decimator.push([wave])
    line.energy.made_now_j += 0.5 * T_C * wave * wave
    line.energy.used_now_j += 0.5 * T_C * returning * returning


@given(st.lists(st.tuples(st.integers(1, 2 * M), waves, waves), min_size=1, max_size=40), st.floats(0.0, 1e-3))
def test_whatever_their_lengths_what_is_sent_was_given_or_spared(
    frames: list[tuple[int, float, float]], spare_j: float
) -> None:
    line = ForwardLine(seat())
    total = sent_total = 0.0
    for ticks, wave, returning in frames:
        values = [wave * (1.0 + 0.3 * step) for step in range(ticks)]
        before = line.energy.made_j
        for value in values:
            tick(line, value, returning)
        made, used = (0.5 * T_C * sum(each * each for each in row) for row in (values, [returning] * ticks))
        line._shift = ticks - M
        (sent,) = line.end_frame(spare_j)
        going = 0.5 * M * T_C * sent * sent
        total += sum(values) / M
        sent_total += sent
        assert going <= max(0.0, spare_j + used) * (1.0 + 1e-12)
        if ticks > M or sent != pytest.approx(sum(values) / M, rel=1e-12):
            assert line.energy.made_j - before >= going * (1.0 - 1e-9) - 1e-15, "the ledger has all that was sent"
        else:
            assert going <= made * (1.0 + 1e-12) + 1e-15, "a mean has no more energy than what it is the mean of"
    assert sent_total + line._withheld[0] == pytest.approx(total, abs=1e-9)


def heard(line: ForwardLine, spare: int, acknowledged: int) -> int:
    """A frame ends after the server has said this; gives the length of the next."""
    line.spare = spare
    for _ in range(M + line._shift):
        tick(line, 0.0)
    line.end_frame(0.0)
    return line.next_length(acknowledged)


def test_the_first_shift_is_whole_and_each_later_one_a_tick() -> None:
    line = ForwardLine(seat())
    assert heard(line, 5, 0) == M, "before the server has played anything, nothing is known"
    assert heard(line, 5, 1) == M + 5
    assert line.phase == 0, "the frame that ended had M"
    assert heard(line, -3, 2) == M, "said before it had heard of the shift"
    assert line.phase == 5
    lengths = [heard(line, -3, 3 + number) for number in range(PRESSING // 3 + 1)]
    assert lengths == [M] * (PRESSING // 3 - 1) + [M - 1, M], "it had been said once before"
    assert heard(line, 0, 50) == M
    assert line.phase == 4


def test_to_send_later_takes_that_it_is_said_for_a_while() -> None:
    line = ForwardLine(seat())
    heard(line, 2, 1)
    heard(line, 0, 2)
    lengths = [heard(line, 2, 3 + number) for number in range(QUIET + 1)]
    assert lengths == [M] * QUIET + [M + 1]
    lengths = [heard(line, 5, 1000) for _ in range(QUIET // 4 + 1)]
    assert lengths == [M] * (QUIET // 4) + [M + 1], "more is made use of sooner"
    assert {heard(line, 1, 1000) for _ in range(2 * QUIET)} == {M}, "one tick is not worth it"
    lengths = [heard(line, (-1) ** number, 1000) for number in range(2 * QUIET)]
    assert set(lengths) == {M}, "who says now this, now that, is not followed"


def test_a_loop_of_one_tick_a_frame_never_sends_sooner() -> None:
    line = ForwardLine(seat(rates={"network_hz": 1024}))
    tick(line, 0.0)
    line.end_frame(0.0)
    line.spare = -5
    assert line.next_length(1) == 1
