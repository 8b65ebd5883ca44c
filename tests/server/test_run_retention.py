"""Retention of runs: by age and by size, of servers' finished runs alone."""

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.machine.platform import system
from cogrip.server.io.run_retention import DAY_S, LOCK, LeftRun, RunRetention, mark_run, runs_below, to_remove

NOW_S = 1_800_000_000.0


def a_run(base: Path, name: str, days: float, size: int = 8192, *, mark: bool = True) -> Path:
    folder = base / name
    (folder / "room").mkdir(parents=True)
    (folder / "room" / "server.mcap").write_bytes(os.urandom(size))
    if mark:
        os.close(mark_run(folder))
    for path in (folder / "room" / "server.mcap", folder / LOCK):
        if path.exists():
            os.utime(path, (NOW_S - days * DAY_S,) * 2)
    return folder


def test_only_finished_runs_of_servers_go(tmp_path: Path) -> None:
    base, outside = tmp_path / "runs", tmp_path / "outside"
    old, young = a_run(base, "old", 8.0), a_run(base, "young", 6.9)
    others = a_run(base, "a person's", 99.0, mark=False)
    going, recorded = a_run(base, "going", 99.0), a_run(base, "recorded", 99.0)
    elsewhere = a_run(outside, "elsewhere", 99.0)
    (base / "link").symlink_to(elsewhere)
    (base / "notes.txt").write_text("of somebody")
    held = mark_run(going)
    os.utime(going / LOCK, (NOW_S - 99 * DAY_S,) * 2)
    writing = os.open(recorded / "room" / "server.mcap", os.O_RDWR)
    system.lock(writing)
    said: list[str] = []
    retention = RunRetention(base, said.append, 7 * DAY_S, None)
    retention.sweep(NOW_S)
    assert [each.exists() for each in (old, young, others, going, recorded, elsewhere)] == [False] + [True] * 5
    assert (base / "link").is_symlink()
    assert (base / "notes.txt").exists()
    assert [text.split(" was removed")[0] for text in said] == [str(old)]
    os.close(held)
    os.close(writing)
    retention.sweep(NOW_S)
    assert not going.exists()
    assert not recorded.exists()
    assert retention.trouble == ""


def test_the_oldest_go_while_all_are_too_large_and_what_is_under_way_is_named(tmp_path: Path) -> None:
    runs = [a_run(tmp_path, f"run {days}", days, 100_000) for days in (3, 2, 1)]
    held = mark_run(runs[0])  # the oldest one is under way
    retention = RunRetention(tmp_path, lambda text: None, None, 250_000)
    retention.sweep(NOW_S)
    assert [run.exists() for run in runs] == [True, False, True]
    assert retention.trouble == ""
    retention = RunRetention(tmp_path, lambda text: None, None, 50_000)
    retention.sweep(NOW_S)
    assert [run.exists() for run in runs] == [True, False, False]
    assert "are more than --keep-gb 5e-05" in retention.trouble
    os.close(held)
    retention.sweep(NOW_S)
    assert list(tmp_path.iterdir()) == []
    assert retention.trouble == ""


def test_what_cannot_be_read_is_a_trouble_and_ends_nothing(tmp_path: Path) -> None:
    retention = RunRetention(tmp_path / "none", lambda text: None, 1.0, None)
    retention.sweep(NOW_S)
    assert "cannot be read" in retention.trouble


def test_nobody_finds_a_free_lock_of_a_run_that_begins(tmp_path: Path) -> None:
    held = mark_run(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [LOCK]
    (run,) = runs_below(tmp_path.parent)
    assert not run.finished
    os.close(held)
    assert runs_below(tmp_path.parent)[0].finished


RUNS = st.lists(st.tuples(st.floats(0, 100), st.integers(0, 1000), st.booleans()), max_size=12)


@given(RUNS, st.none() | st.floats(0, 100), st.none() | st.integers(0, 5000))
def test_no_more_goes_than_is_asked_for(
    found: list[tuple[float, int, bool]], keep_s: float | None, keep: int | None
) -> None:
    runs = [LeftRun(Path(str(number)), *each) for number, each in enumerate(sorted(found))]
    gone = to_remove(runs, 100.0, keep_s, keep)
    assert all(run.finished for run in gone)
    kept = [run for run in runs if run not in gone]
    if keep_s is None and keep is None:
        assert not gone
    if keep is not None:
        assert sum(run.size_bytes for run in kept) <= keep or not any(run.finished for run in kept)
        for run in gone:  # it was old, or there was too much with it and all later ones
            before = [each for each in runs[: runs.index(run)] if each in kept]
            old = keep_s is not None and 100.0 - run.ended_s > keep_s
            assert old or sum(each.size_bytes for each in before + runs[runs.index(run) :]) > keep
    elif keep_s is not None:
        assert gone == [run for run in runs if run.finished and 100.0 - run.ended_s > keep_s]


@pytest.mark.parametrize("kind", ["file", "fifo"])
def test_a_lock_that_is_none_marks_nothing(tmp_path: Path, kind: str) -> None:
    folder = a_run(tmp_path, "run", 99.0, mark=False)
    if kind == "fifo":
        os.mkfifo(folder / LOCK)
    else:
        (folder / LOCK).symlink_to("room/server.mcap")
    RunRetention(tmp_path, lambda text: None, 0.0, 0).sweep(NOW_S)
    assert folder.exists()
