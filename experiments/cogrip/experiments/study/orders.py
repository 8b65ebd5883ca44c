"""Orders of conditions in a block: fixed, random, and balanced Latin squares.

A Williams square (Williams 1949) has n rows for even n, 2 n for odd n: each condition stands in each place equally often, and
follows each other condition equally often. Groups, and within them repetitions, take the rows in turn, so that all are used.
"""

from collections.abc import Sequence
from random import Random
from typing import Literal, TypeVar

T = TypeVar("T")
Order = Literal["fixed", "random", "latin", "staircase"]


def williams(n: int) -> list[list[int]]:
    """Return the rows of a Williams square of 0 ... n - 1."""
    # 0, 1, n-1, 2, n-2, ...: all differences between neighbours are different
    first = [(step + 1) // 2 if step % 2 else (n - step // 2) % n for step in range(n)]
    rows = [[(place + shift) % n for place in first] for shift in range(n)]
    return rows if n % 2 == 0 or n == 1 else rows + [row[::-1] for row in rows]


def ordered(order: Order, items: Sequence[T], repetitions: int, row: int, random: Random) -> list[tuple[T, int]]:
    """Return (item, repetition) in the order in which a group has them.

    row: number of the group, whose repetitions take as many rows of a Latin square. Random: shuffled in each repetition.
    """
    found: list[tuple[T, int]] = []
    for repetition in range(repetitions):
        chosen = list(items)
        if order == "random":
            random.shuffle(chosen)
        elif order == "latin":
            rows = williams(len(chosen))
            chosen = [chosen[place] for place in rows[(row * repetitions + repetition) % len(rows)]]
        found += [(item, repetition) for item in chosen]
    return found


def unfilled(items: int, repetitions: int, groups: int) -> str:
    """Return how a Latin square of so many items is not filled, so that places and sequences are not balanced; "" if it is."""
    rows, taken = len(williams(items)), groups * repetitions
    if taken % rows == 0:
        return ""
    whole = next(count for count in range(groups, groups + rows + 1) if count * repetitions % rows == 0)
    return f"its Latin square has {rows} rows, and {taken} are taken: {whole} groups would balance it"
