"""History of a line's energy ledger: totals that are long in coming still say what was lost, to the last bit."""

import random

import pytest

from cogrip.machine.rows import Row
from cogrip.protocol.line.energy_ledger import FIRST_ROWS, HISTORY, WaveLedger
from cogrip.protocol.line.energy_sums import RESERVE_FRACTION, WaveSums
from cogrip.protocol.line.received_waves import ReceivedWaves


def totals(first: int, total: Row, squares: Row) -> ReceivedWaves:
    datagram = ReceivedWaves()
    datagram.put(first, total, total, squares, (0.0, 0.0, 0), 0)
    return datagram


@pytest.mark.parametrize("axes", [1, 3, 6])
@pytest.mark.parametrize("begin", [0, 5, FIRST_ROWS - 1, 3 * FIRST_ROWS + 7])
@pytest.mark.parametrize("outage", [1, FIRST_ROWS - 2, FIRST_ROWS - 1, FIRST_ROWS, FIRST_ROWS + 1, 500, HISTORY - 1])
def test_totals_from_before_an_outage_say_what_was_lost_until_then(outage: int, begin: int, axes: int) -> None:
    """The frames after `begin` + 20 come without totals; then those of frame `begin` + 20 come, so long after."""
    chance, ledger, sent, played = random.Random(f"{outage} {begin} {axes}"), WaveLedger(axes, 1.0), *[
        WaveSums(axes) for _ in range(2)
    ]  # fmt: skip
    expected = None
    for number in range(begin, begin + 20 + outage):
        wave = tuple([chance.uniform(-1.0, 1.0) for _ in range(axes)])
        lost = number % 7 == 3
        frame = (0.0,) * axes if lost else wave
        if number == begin + 20:
            expected = sent.total, sent.squares, played.total, played.squares
        sent.add(wave)
        played.add(frame)
        ledger.add_played(number, frame)
    cursor = begin + 20 + outage
    total, squares, were, were_squares = expected or (sent.total, sent.squares, played.total, played.squares)
    ledger.add_totals(totals(begin + 20, total, squares), cursor)
    ledger.add_played(cursor, (0.0,) * axes)
    reaches = outage + 1 < HISTORY  # of older frames nobody knows any more what was played
    assert ledger.settled == (begin + 20 if reaches else 0)
    if reaches:
        assert ledger.deficit == [a - b for a, b in zip(total, were, strict=True)]
        assert ledger.lost_squares == [
            (a - b) - RESERVE_FRACTION * a for a, b in zip(squares, were_squares, strict=True)
        ]


def test_totals_of_a_frame_before_the_first_one_played_find_nothing_played() -> None:
    ledger = WaveLedger(2, 1.0)
    ledger.begin(40)
    ledger.add_totals(totals(38, (3.0, -1.0), (9.0, 1.0)), 40)
    ledger.add_played(40, (0.5, 0.5))
    assert (ledger.settled, ledger.deficit) == (38, [3.0, -1.0])
