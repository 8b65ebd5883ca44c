"""When a client dials anew, and which of its ways it uses."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.path_migration import AGAIN_NS, REFUSED_NS, SPARE_NS, PathMigration

MS = 1_000_000


def dials(until_ms: int, *, ready_ms: int | None = None, refused: bool = False, resuming_ms: int = 0) -> list[int]:
    """When a client dials [ms] that resumes from `resuming_ms` on; each way opens `ready_ms` after it was dialled."""
    migration, found = PathMigration("first"), []
    for ms in range(until_ms):
        ready = bool(found) and ready_ms is not None and ms >= found[-1] + ready_ms
        if migration.due(ms * MS, ms >= resuming_ms, ready, refused):
            found.append(ms)
            migration.dialled(f"at {ms}", ms * MS)
    return found


@pytest.mark.parametrize(
    ("what", "expected"),
    [
        ({}, [0, 500, 1500, 3500, 5500]),  # nothing answers: 0.5, 1, 2, 2 s
        ({"refused": True}, list(range(0, 6000, 250))),  # nobody listens
        ({"ready_ms": 30}, [0, 2030, 4060]),  # open, and no welcome: 2 s from when it opened
        ({"ready_ms": 499}, [0, 2499, 4998]),
        ({"ready_ms": 0}, [0, 2001, 4002]),  # plain: open at the first look after it was dialled
        ({"resuming_ms": 700}, [700, 1200, 2200, 4200]),
        ({"resuming_ms": 9999}, []),
    ],
)
def test_when_it_dials(what: dict[str, int | bool], expected: list[int]) -> None:
    assert dials(6000, **what) == expected  # type: ignore[arg-type]
    assert AGAIN_NS == (500 * MS, 1000 * MS, 2000 * MS)
    assert REFUSED_NS == 250 * MS


def test_hellos_go_by_the_newest_way_and_the_rest_by_the_one_in_use() -> None:
    migration = PathMigration("old")
    assert (migration.ways, migration.way, migration.asking) == (("old",), "old", "old")
    assert migration.dialled("new", 0) is None
    assert (migration.ways, migration.way, migration.asking) == (("old", "new"), "old", "new")
    assert migration.dialled("newer", 1) == "new", "to be closed"
    assert migration.ways == ("old", "newer")
    assert migration.dials == 2


@pytest.mark.parametrize(("by", "closed"), [("old", ["new"]), ("new", ["old"])])
def test_a_welcome_decides_which_way_is_gone_on_with(by: str, closed: list[str]) -> None:
    migration = PathMigration("old")
    migration.dialled("new", 0)
    assert migration.adopt(by) == closed
    assert (migration.ways, migration.way, migration.asking) == ((by,), by, by)


def test_a_way_that_could_not_be_opened_counts_as_a_try() -> None:
    migration = PathMigration("old")
    assert migration.due(0, True, False, False)
    assert migration.dialled(None, 0) is None
    assert migration.ways == ("old",)
    assert not migration.due(AGAIN_NS[0] - 1, True, True, False), "the old way's being open says nothing"
    assert migration.due(AGAIN_NS[0], True, False, False)


def test_the_newer_way_is_listened_to_for_a_while_after_the_old_one_was_heard() -> None:
    migration = PathMigration("old")
    migration.due(0, True, False, False)
    migration.dialled("new", 0)
    assert migration.spare(5 * SPARE_NS, True) is None, "not while it is needed"
    assert migration.spare(6 * SPARE_NS, False) is None
    assert migration.spare(7 * SPARE_NS - 1, False) is None
    assert migration.ways == ("old", "new")
    assert migration.spare(7 * SPARE_NS, False) == "new"
    assert migration.ways == ("old",)


def test_a_second_silence_begins_anew() -> None:
    migration = PathMigration("old")
    for now_ns in (0, 500 * MS):
        assert migration.due(now_ns, True, False, False)
        migration.dialled(f"{now_ns}", now_ns)
    assert not migration.due(600 * MS, False, False, False)
    assert migration.spare(600 * MS, False) is None
    assert migration.due(700 * MS, True, False, False), "at once"
    migration.dialled("again", 700 * MS)
    assert not migration.due(1199 * MS, True, False, False)
    assert migration.due(1200 * MS, True, False, False), "and with the first wait"
    assert migration.spare(700 * MS + SPARE_NS, False) is None, "the time since the first return does not count"


@given(
    st.lists(
        st.tuples(st.integers(0, 3000), st.booleans(), st.booleans(), st.booleans(), st.integers(0, 3)), max_size=60
    )
)
def test_there_are_never_more_than_two_ways_and_one_is_always_in_use(
    steps: list[tuple[int, bool, bool, bool, int]],
) -> None:
    migration, made, now_ns = PathMigration(0), 0, 0
    is_open = {0}
    for wait_ms, resuming, ready, refused, welcome in steps:
        now_ns += wait_ms * MS
        closed: list[int | None] = []
        if migration.due(now_ns, resuming, ready, refused):
            made += 1
            is_open.add(made)
            closed.append(migration.dialled(made, now_ns))
        closed.append(migration.spare(now_ns, resuming))
        if welcome == 0:
            closed += migration.adopt(migration.ways[-1])
        is_open -= set(closed)  # type: ignore[arg-type]
        assert is_open == set(migration.ways), "what is not used any more is closed, and nothing else"
        assert 1 <= len(is_open) <= 2
