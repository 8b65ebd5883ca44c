"""Memory of processes over time: the slope is that of a known line, a real process has memory, a dead one has none."""

import ctypes
import os
import subprocess
import sys

import pytest

from tests.bench.loads.process_memory import Growth, family_of, memory_kb, own_memory_in_use_kb

needs_proc = pytest.mark.skipif(sys.platform != "linux", reason="/proc is Linux's")


def test_the_slope_is_that_of_the_second_half() -> None:
    growth = Growth()
    for minute in range(60):
        growth.note(60.0 * minute, 1000.0 + (500.0 * minute if minute < 30 else 15_000.0 + 2.0 * (minute - 30)))
    assert growth.slope_kb_per_h == pytest.approx(120.0)
    found = growth.summary()
    assert (found.first_kb, found.middle_kb, found.last_kb) == (1000.0, 16_000.0, 16_058.0)


def test_too_few_notes_have_no_slope_and_none_has_no_memory() -> None:
    growth = Growth()
    with pytest.raises(ValueError, match="no memory was noted"):
        growth.summary()
    growth.note(0.0, 10.0)
    growth.note(1.0, 20.0)
    growth.note(2.0, None)
    assert growth.slope_kb_per_h == 0.0
    assert growth.last_kb == 20.0


@needs_proc
def test_a_family_is_the_leader_and_its_children() -> None:
    program = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'print(1, flush=True); input()'])"
    leader = subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
    )
    assert leader.stdin is not None
    assert leader.stdout is not None
    try:
        assert leader.stdout.readline() == b"1\n"  # the child runs
        family = family_of(leader.pid)
        assert [role for _, role in family if role == ""] == [""]
        assert [role for pid, role in family if pid != leader.pid] == [" child"]
        assert all((memory_kb(pid) or 0.0) > 1000.0 for pid, _ in family)
    finally:
        leader.stdin.write(b"\n")
        leader.stdin.close()
        leader.wait(60.0)
        leader.stdout.close()
    assert family_of(leader.pid) == []
    assert memory_kb(leader.pid) is None
    assert (memory_kb(os.getpid()) or 0.0) > 1024.0, "our own"


@pytest.mark.skipif(
    sys.platform != "linux" or not hasattr(ctypes.CDLL(None), "mallinfo2"), reason="mallinfo2 is of glibc 2.33"
)
def test_memory_in_use_grows_by_what_is_allocated_and_not_by_what_the_heap_keeps_free() -> None:
    before_kb = own_memory_in_use_kb()
    made = [bytearray(10_000) for _ in range(4000)]
    held_kb = own_memory_in_use_kb()
    assert held_kb - before_kb == pytest.approx(39_000, abs=4000)
    kept = made[::2]  # free parts between others: they stay resident
    del made
    assert held_kb - own_memory_in_use_kb() == pytest.approx(19_500, abs=4000)
    assert len(kept) == 2000
