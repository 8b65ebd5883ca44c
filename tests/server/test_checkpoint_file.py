"""A file that is whole at every moment, and a writer that never holds the loop: disks that fail or hang, kills at any time."""

import hashlib
import os
import random
import resource
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cogrip.server.io import checkpoint_file
from cogrip.server.io.checkpoint_file import (
    HEADER,
    SLOT_BYTES,
    WHOLE_EVERY,
    CheckpointWriter,
    WriterThread,
    read,
    remove,
)
from cogrip.server.io.state_folder import StateError

from tests.server.patience import LIMIT_S, until

ENDLESS = """
import hashlib, sys, threading
from pathlib import Path
from cogrip.server.io import checkpoint_file

done = threading.Semaphore(0)

def noted(write):
    def written(path, slot, *where, **how):
        write(path, slot, *where, **how)
        print(int(slot[checkpoint_file.HEADER.size + 64 :].split()[0]), flush=True)
        done.release()

    return written

for name in ("write_private", "overwrite_private"):
    setattr(checkpoint_file, name, noted(getattr(checkpoint_file, name)))
writer, number = checkpoint_file.CheckpointWriter(Path(sys.argv[1])), int(sys.argv[2])
while True:
    number += 1
    body = f"{number} ".encode() * (1 + number * 7919 % 3000)
    writer.put(hashlib.sha256(body).hexdigest().encode() + body)
    if number % 3 == 0:
        done.acquire()
"""


@pytest.fixture
def path(tmp_path) -> Path:
    tmp_path.chmod(0o700)
    return tmp_path / "checkpoint-lab.json"


@pytest.fixture
def disk(monkeypatch) -> tuple[threading.Event, threading.Event]:
    """Writes wait. What lets them go on once it is set, and what is set once one has begun."""
    held, begun = threading.Event(), threading.Event()
    whole = checkpoint_file.write_private

    def slow(there: Path, data: bytes, *, durable: bool) -> None:
        begun.set()
        assert held.wait(LIMIT_S)
        whole(there, data, durable=durable)

    monkeypatch.setattr(checkpoint_file, "write_private", slow)
    return held, begun


def number_in(data: bytes) -> int:
    """Return a whole version."""
    assert hashlib.sha256(data[64:]).hexdigest().encode() == data[:64], "torn"
    return int(data[64:].split()[0])


def test_what_was_put_is_read_and_nothing_else_is_left(path):
    CheckpointWriter(path).close()
    assert list(path.parent.iterdir()) == []
    assert read(path) is None
    writer = CheckpointWriter(path)
    writer.put(b"one")
    writer.close()
    assert read(path) == b"one"
    assert path.stat().st_mode & 0o777 == 0o600
    assert (writer.written, writer.overtaken, writer.failures) == (1, 0, 0)
    assert list(path.parent.iterdir()) == [path]
    path.with_name(f"{path.name}.new").write_bytes(b"half")
    for _ in range(2):
        remove(path)
        assert list(path.parent.iterdir()) == []


@pytest.fixture
def full(path) -> list[bytes]:
    """Versions of a file with one in each slot: the replaced whole, and the two that came after it."""
    versions = [b"version %d" % number for number in range(WHOLE_EVERY + 3)]
    writer = CheckpointWriter(path)
    for version in versions:
        writer.put(version)
        writer.close()
    return versions[-3:]


@given(torn=st.sets(st.sampled_from(range(3))), at=st.integers(0, HEADER.size + len(b"version 10") - 1))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_torn_slot_costs_its_own_version_alone(path, full, torn, at):
    """Whichever were being written, and wherever they broke off."""
    before = path.read_bytes()
    content = bytearray(before)
    for slot in torn:
        content[slot * SLOT_BYTES + at] ^= 0x10
    path.write_bytes(content)
    by_slot = [full[0], full[2], full[1]]  # the first is the whole; the others in turns, the second one later
    left = [by_slot[slot] for slot in range(3) if slot not in torn]
    if left:
        assert read(path) == max(left, key=full.index)
    else:
        with pytest.raises(StateError, match="no whole checkpoint"):
            read(path)
    path.write_bytes(before)


def test_a_write_in_place_leaves_the_versions_before_and_makes_no_file(path, full):
    kept = path.read_bytes()
    writer, file = CheckpointWriter(path), path.stat().st_ino
    writer.put(b"whole")
    writer.close()
    assert path.stat().st_ino != file, "another writer never continues a file: its numbers begin anew"
    assert read(path) == b"whole"
    assert len(path.read_bytes()) < len(kept)
    file = path.stat().st_ino
    for number in range(1, WHOLE_EVERY):
        before = path.read_bytes()[:SLOT_BYTES].rstrip(b"\0")
        writer.put(b"in place %d" % number)
        writer.close()
        assert (path.stat().st_ino, read(path)) == (file, b"in place %d" % number)
        assert path.read_bytes().startswith(before)
    path.unlink()
    writer.put(b"removed meanwhile")
    writer.close()
    assert read(path) == b"removed meanwhile"


def test_a_writer_for_other_hosts_replaces_the_file_each_time(path):
    writer = CheckpointWriter(path, whole_every=1)
    for number in range(3):
        writer.put(b"%d" % number)
        writer.close()
        assert len(path.read_bytes()) == HEADER.size + 1
    assert read(path) == b"2"


def test_a_checkpoint_longer_than_its_slot_is_a_failure_and_the_one_before_stays(path):
    words: list[str] = []
    writer = CheckpointWriter(path, words.append)
    for size in (SLOT_BYTES - HEADER.size, SLOT_BYTES - HEADER.size + 1):
        writer.put(bytes(size))
        writer.close()
    assert (writer.written, writer.failures) == (1, 1)
    assert read(path) == bytes(SLOT_BYTES - HEADER.size)
    assert "a checkpoint of 1048553 bytes is too long: 1048552 at most" in words[0]


def test_a_disk_that_takes_only_a_part_is_a_failure_and_the_version_before_stays(path):
    words: list[str] = []
    writer = CheckpointWriter(path, words.append)
    writer.put(b"whole")
    writer.close()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (2 * SLOT_BYTES + HEADER.size + 4, limits[1]))
        writer.put(b"in place")
        writer.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert (writer.written, writer.failures) == (1, 1)
    assert read(path) == b"whole"
    assert "No space left on device; make room" in words[0]
    writer.put(b"room again")
    writer.close()
    assert read(path) == b"room again"


def test_failures_are_counted_and_said_once_by_whoever_puts(path, monkeypatch):
    words: list[tuple[str, str]] = []
    folder = path.parent / "gone"
    writer = CheckpointWriter(folder / path.name, lambda text: words.append((text, threading.current_thread().name)))
    for number in range(5):
        before = writer.failures
        writer.put(b"x")
        until(lambda before=before: writer.failures > before)
        assert writer.failures == number + 1
    folder.mkdir(0o700)  # a disk that has room again
    writer.put(b"y")
    writer.close()
    ((text, thread),) = words
    assert "No such file or directory" in text
    assert str(folder) in text
    assert thread == threading.current_thread().name
    assert read(folder / path.name) == b"y"
    assert (writer.written, writer.failures) == (1, 5)


def test_a_file_that_others_can_read_is_not_believed(path):
    path.write_bytes(b"{}")
    path.chmod(0o644)
    with pytest.raises(StateError, match=r"checkpoint-lab\.json"):
        read(path)


def test_killed_at_any_moment_it_leaves_a_whole_version(path):
    """And never one older than what was known to be written."""
    chance, last = random.Random(6), 0
    for _ in range(5):
        process = subprocess.Popen(
            [sys.executable, "-c", ENDLESS, str(path), str(last)], stdout=subprocess.PIPE, start_new_session=True
        )
        assert process.stdout is not None
        written = [int(process.stdout.readline()) for _ in range(chance.randrange(1, 20))]
        os.kill(process.pid, signal.SIGKILL)
        process.wait(LIMIT_S)
        process.stdout.close()
        data = read(path)
        assert data is not None
        last = number_in(data)
        assert last >= written[-1]
    beside = {each.name for each in path.parent.iterdir()} - {path.name}
    assert beside <= {f"{path.name}.new"}, "one at most, however often"


def test_writers_share_a_thread_and_each_keeps_its_newest_and_every_version_has_a_fate(path, disk):
    """A disk that hangs in one of them holds up no loop, and costs no other writer what it was given last."""
    held, begun = disk
    before, thread = threading.active_count(), WriterThread()
    writers = [CheckpointWriter(path.with_name(f"{number}.json"), thread=thread) for number in range(20)]
    writers[0].put(b"first")
    assert begun.wait(LIMIT_S)
    for number in range(50):
        for writer in writers:
            writer.put(b"%d" % number)
    assert threading.active_count() == before + 1
    held.set()
    for writer in writers:
        writer.close()
    assert [read(writer.path) for writer in writers] == [b"49"] * 20
    assert [(writer.written, writer.overtaken, writer.failures) for writer in writers] == [(2, 49, 0)] + [
        (1, 49, 0)
    ] * 19
    writers[3].put(b"again")  # a thread that was ended begins anew
    writers[3].close()
    assert read(writers[3].path) == b"again"


def test_whatever_a_write_raises_the_thread_goes_on(path, monkeypatch):
    """It writes for all rooms: without it no checkpoint would be written any more, and nobody would say so."""
    whole, said, thread = checkpoint_file.write_private, [], WriterThread()
    one, other = [CheckpointWriter(path.with_name(name), said.append, thread) for name in ("one", "other")]

    def failing(there: Path, data: bytes, *, durable: bool) -> None:
        if b"too much" in data:
            raise MemoryError
        whole(there, data, durable=durable)

    monkeypatch.setattr(checkpoint_file, "write_private", failing)
    one.put(b"too much")
    other.put(b"of the other")
    one.close()
    assert (one.failures, len(said)) == (1, 1)
    one.put(b"once more")
    one.close()
    assert read(one.path) == b"once more"
    assert read(other.path) == b"of the other"


def test_what_waits_for_a_slow_disk_does_not_come_back_after_its_removal(path, disk, monkeypatch):
    """Writes of other rooms may take longer than an end waits for them."""
    held, begun = disk
    monkeypatch.setattr(checkpoint_file, "END_LIMIT_S", 0.05)
    thread = WriterThread()
    one, other, last = [CheckpointWriter(path.with_name(name), thread=thread) for name in ("one", "other", "last")]
    one.put(b"of one")
    assert begun.wait(LIMIT_S)
    for writer in (other, last):
        writer.put(b"nobody resumes")
    for writer in (one, other, last):
        writer.close()
    other.remove()
    held.set()
    monkeypatch.setattr(checkpoint_file, "END_LIMIT_S", LIMIT_S)
    last.put(b"later")
    last.close()
    until(lambda: one.written and last.written)
    assert read(one.path) == b"of one"
    assert read(other.path) is None


def test_a_thread_that_has_begun_is_not_started_by_what_is_put(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A start waits for an ordinary thread: a loop with the first person to join stood for 0.2 to 0.4 s on a busy machine."""
    thread = WriterThread()
    thread.begin()
    monkeypatch.setattr(threading.Thread, "start", lambda self: pytest.fail("a thread is started"))
    writer = CheckpointWriter(tmp_path / "checkpoint.bin", thread=thread)
    thread.begin()
    writer.put(b"content")
    thread.close()
    assert writer.written == 1
