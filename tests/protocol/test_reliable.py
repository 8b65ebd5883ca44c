"""Reliable delivery: over any loss, repetition and order, each item is taken once and in order, and nothing waits for ever."""

from random import Random

from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.wire.reliable import Unanswered


@given(st.integers(0, 2**32), st.integers(0, 40), st.floats(0.0, 0.9))
def test_each_item_comes_once_and_in_order(seed: int, count: int, loss: float) -> None:
    """Messages and answers are lost at random, kept back and repeated; the sender may have four items on their way."""
    random, sender, taken = Random(seed), Unanswered[str](4), []
    flying: list[tuple[int, str]] = []
    answers: list[int] = []
    items = [f"item {number}" for number in range(count)]
    left = list(items)
    for now in range(10_000):
        while left and not sender.full:
            assert sender.add(left.pop(0)) == count - len(left)
        flying += [each for each in sender.due(now) if random.random() >= loss]
        random.shuffle(flying)
        for number, item in flying[: random.randint(0, len(flying))]:
            if number == len(taken) + 1:
                taken.append(item)
            if random.random() >= loss:
                answers.append(len(taken))
        flying = flying[-8:]
        for answer in random.sample(answers, min(len(answers), 2)):
            sender.answered(answer)
        answers = answers[-8:]
        if not left and not sender.waiting:
            break
    assert taken == items
    assert not sender.waiting
    assert sender.number == count


def test_it_is_sent_again_after_a_time_and_at_once_where_there_is_more() -> None:
    sender = Unanswered[str](again=10)
    assert sender.due(0) == []
    sender.add("one")
    assert sender.due(100) == [(1, "one")]
    assert sender.due(109) == []
    assert sender.due(110) == [(1, "one")]
    sender.add("two")
    assert sender.due(111) == [(1, "one"), (2, "two")]


def test_an_answer_to_what_was_never_sent_changes_nothing() -> None:
    sender = Unanswered[str](3)
    for item in "abc":
        sender.add(item)
    assert sender.full
    assert sender.answered(4) == 0
    assert sender.answered(2) == 2
    assert sender.answered(1) == 0
    sender.add("d")
    sender.answered_one(3)
    sender.answered_one(7)
    assert list(sender.waiting) == [(4, "d")]
    assert sender.begin() == 1
    assert sender.add("e") == 1
