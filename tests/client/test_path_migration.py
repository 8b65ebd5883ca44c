"""Path migration: when a client tries another path, and which of its paths it uses."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.path_migration import AGAIN_NS, REFUSED_NS, SPARE_NS, PathMigration

MS = 1_000_000


def attempts(until_ms: int, *, ready_ms: int | None = None, refused: bool = False, resuming_ms: int = 0) -> list[int]:
    """Return when a client that resumes from `resuming_ms` on tries another path; each is ready `ready_ms` later [ms]."""
    migration, found = PathMigration("first"), []
    for ms in range(until_ms):
        ready = bool(found) and ready_ms is not None and ms >= found[-1] + ready_ms
        if migration.due(ms * MS, ms >= resuming_ms, ready, refused):
            found.append(ms)
            migration.tried(f"at {ms}", ms * MS)
    return found


@pytest.fixture
def migration() -> PathMigration:
    return PathMigration("old")


@pytest.mark.parametrize(
    ("what", "expected"),
    [
        ({}, [0, 500, 1500, 3500, 5500]),  # nothing answers: 0.5, 1, 2, 2 s
        ({"refused": True}, list(range(0, 6000, 250))),  # nobody listens
        ({"ready_ms": 30}, [0, 2030, 4060]),  # ready, and no welcome: 2 s from when it was
        ({"ready_ms": 499}, [0, 2499, 4998]),
        ({"ready_ms": 0}, [0, 2001, 4002]),  # unencrypted: ready at the first poll after it was tried
        ({"resuming_ms": 700}, [700, 1200, 2200, 4200]),
        ({"resuming_ms": 9999}, []),
    ],
)
def test_times_of_attempts(what: dict[str, int | bool], expected: list[int]) -> None:
    assert attempts(6000, **what) == expected  # type: ignore[arg-type]
    assert AGAIN_NS == (500 * MS, 1000 * MS, 2000 * MS)
    assert REFUSED_NS == 250 * MS


def test_hellos_go_by_the_newest_path_and_the_rest_by_the_one_in_use(migration: PathMigration) -> None:
    assert (migration.paths, migration.path, migration.newest) == (("old",), "old", "old")
    assert migration.tried("new", 0) is None
    assert (migration.paths, migration.path, migration.newest) == (("old", "new"), "old", "new")
    assert migration.tried("newer", 1) == "new", "to be closed"
    assert migration.paths == ("old", "newer")
    assert migration.attempts == 2


@pytest.mark.parametrize(
    ("by", "asked", "closed"), [("old", False, ["new"]), ("new", False, ["old"]), ("new", True, ["old"])]
)
def test_a_welcome_decides_which_path_is_used(
    migration: PathMigration, by: str, asked: bool, closed: list[str]
) -> None:
    migration.tried("new", 0)
    assert migration.adopt(by, asked) == closed
    assert (migration.paths, migration.path, migration.newest) == ((by,), by, by)


def test_a_hello_by_the_newer_path_may_be_answered_after_the_one_by_the_old_path(migration: PathMigration) -> None:
    migration.due(0, True, False, False)
    migration.tried("new", 0)
    assert migration.adopt("old") == []
    assert (migration.paths, migration.path) == (("old", "new"), "old")
    assert migration.spare(SPARE_NS, False) is None, "the server comes to the next hello"
    assert migration.adopt("new") == ["old"], "and has bound the seat to that path"
    assert (migration.paths, migration.path) == (("new",), "new")


def test_a_path_that_could_not_be_opened_counts_as_an_attempt(migration: PathMigration) -> None:
    assert migration.due(0, True, False, False)
    assert migration.tried(None, 0) is None
    assert migration.paths == ("old",)
    assert not migration.due(AGAIN_NS[0] - 1, True, True, False), "the old path is ready: that says nothing"
    assert migration.due(AGAIN_NS[0], True, False, False)


def test_the_newer_path_stays_open_for_a_while_after_the_session_resumed_by_the_old_one(
    migration: PathMigration,
) -> None:
    migration.due(0, True, False, False)
    migration.tried("new", 0)
    assert migration.spare(5 * SPARE_NS, True) is None, "not while it is needed"
    assert migration.spare(6 * SPARE_NS, False) is None
    assert migration.spare(7 * SPARE_NS - 1, False) is None
    assert migration.paths == ("old", "new")
    assert migration.spare(7 * SPARE_NS, False) == "new"
    assert migration.paths == ("old",)


def test_a_second_silence_begins_anew(migration: PathMigration) -> None:
    for now_ns in (0, 500 * MS):
        assert migration.due(now_ns, True, False, False)
        migration.tried(f"{now_ns}", now_ns)
    assert not migration.due(600 * MS, False, False, False)
    assert migration.spare(600 * MS, False) is None
    assert migration.due(700 * MS, True, False, False), "at once"
    migration.tried("again", 700 * MS)
    assert not migration.due(1199 * MS, True, False, False)
    assert migration.due(1200 * MS, True, False, False), "and with the first wait"
    assert migration.spare(700 * MS + SPARE_NS, False) is None, "the time since the first return does not count"


@given(
    st.lists(
        st.tuples(st.integers(0, 3000), st.booleans(), st.booleans(), st.booleans(), st.integers(0, 3)), max_size=60
    )
)
def test_there_are_never_more_than_two_paths_and_one_is_always_in_use(
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
            closed.append(migration.tried(made, now_ns))
        closed.append(migration.spare(now_ns, resuming))
        if welcome == 0:
            closed += migration.adopt(migration.paths[-1])
        is_open -= set(closed)  # type: ignore[arg-type]
        assert is_open == set(migration.paths), "what is not used any more is closed, and nothing else"
        assert 1 <= len(is_open) <= 2
