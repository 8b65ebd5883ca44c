"""Virtual coupling's receiver: the newest state wins, and every state has one fate."""

from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.line.latest_state import HISTORY, StateReceiver
from cogrip.protocol.line.receiver import FURTHEST_JUMP
from cogrip.protocol.wire.messages import Stamp, State


def state(number: int) -> State:
    return State(1, number, (float(number),), (0.0,), 0.0, 0, Stamp(0))


@given(st.lists(st.one_of(st.integers(0, 600), st.none()), max_size=200))
def test_newest_wins_and_every_state_has_one_fate(events: list[int | None]) -> None:
    """A number is an arrival, None a take."""
    receiver = StateReceiver()
    newest, taken = -1, -1
    for event in events:
        if event is None:
            assert receiver.pop() == (newest > taken)
            taken = newest
            assert (receiver.latest.number if receiver.latest else -1) == taken
        else:
            assert receiver.receive(state(event)) == (event > newest - HISTORY)
            newest = max(newest, event)
        count = receiver.count()
        assert count.sent == count.applied + count.late + count.lost
        assert count.received == count.applied + count.late + count.pending
        assert min(count.lost, count.late, count.pending, count.duplicate) >= 0
        assert receiver.acknowledged == taken + 1


def test_fates_by_name() -> None:
    receiver = StateReceiver()
    for number in (0, 0):
        receiver.receive(state(number))
    receiver.pop()
    for number in (2, 4, 3):  # 2 is overtaken before it is taken, 3 comes after a newer one, 1 never
        receiver.receive(state(number))
    receiver.pop()
    count = receiver.count()
    assert (count.sent, count.received, count.applied) == (5, 4, 2)
    assert (count.late, count.lost, count.duplicate, count.pending) == (2, 1, 1, 0)
    assert not receiver.pop()


def test_numbers_out_of_the_window_change_nothing() -> None:
    receiver = StateReceiver()
    assert not receiver.receive(state(FURTHEST_JUMP))
    assert receiver.receive(state(FURTHEST_JUMP - 1))
    assert not receiver.receive(state(FURTHEST_JUMP - 1 - HISTORY))
    assert receiver.receive(state(FURTHEST_JUMP - HISTORY))
    assert receiver.count().received == 2
