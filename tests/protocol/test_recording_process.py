"""The writer's task by itself: what it counts as saved is what is in the file, and only trouble of that file ends it."""

import errno
import os
import random
import resource
import shutil
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import pytest
from msgspec.msgpack import Ext

from cogrip.machine.ring import Ring, make_ring
from cogrip.protocol.io.recording_process import MOST_HELD_BYTES, RecordingTask
from cogrip.protocol.recording.reader import open_recording
from cogrip.protocol.recording.records import Event
from cogrip.protocol.recording.sink import pack

from tests.protocol.test_recording_file import header

KINDS = ("event", "gap", "clock")
EVENT = 0
TEXT_BYTES = 4096


@dataclass
class Desk:
    """A task whose ring we fill ourselves."""

    path: Path
    ring: Ring
    task: RecordingTask
    put_messages: int = 0

    def put(self, messages: int, text_bytes: int = TEXT_BYTES) -> None:
        chance = random.Random(self.put_messages)
        for _ in range(messages):
            self.ring.put(EVENT, self.put_messages, b'{"text":"%s"}' % chance.randbytes(text_bytes // 2).hex().encode())
            self.put_messages += 1

    def write(self, messages: int, text_bytes: int = TEXT_BYTES) -> None:
        """Put messages, and let the task bring them into the file."""
        self.put(messages, text_bytes)
        self.task.take()
        self.task.flush()

    def in_file(self) -> list[int]:
        """Return the numbers of our messages, in the file's order."""
        return [message.time_ns for message in open_recording(self.path).messages() if message.topic == EVENT]


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    path = tmp_path / "run" / "client-anna.mcap"
    path.parent.mkdir()
    fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL)
    ring = make_ring(8 * 2**20)
    yield Desk(path, ring, RecordingTask(ring, fd, {"path": str(path), "header": header(KINDS).metadata()}))
    os.close(fd)
    ring.close()


@pytest.fixture
def limit_files() -> Iterator[Callable[[int], None]]:
    """No file may have more bytes than that, until the test ends: a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda most_bytes: resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, hard))
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("most_bytes", [MOST_HELD_BYTES // 4, 5 * MOST_HELD_BYTES // 4, 5 * MOST_HELD_BYTES // 2])
def test_when_the_disk_fills_up_what_is_in_the_file_is_what_counts(desk, limit_files, most_bytes):
    """Several MOST_HELD_BYTES wait at once, as after a stall: pieces of them are in the file when the next finds no room."""
    desk.write(10)
    limit_files(most_bytes)
    desk.put(1500)
    desk.task.take()
    desk.task.finish(cut=False)
    there = desk.in_file()
    assert there == list(range(len(there)))
    assert len(there) == desk.ring.saved < desk.put_messages
    assert desk.path.stat().st_size <= most_bytes
    assert desk.ring.said == f"{desk.path}: {os.strerror(errno.EFBIG)}; what was written before stays readable"


def test_a_spool_that_finds_no_room_ends_no_recording(desk, monkeypatch):
    """Neither the run's folder nor that of temporary files takes a new file; the recording's own has all the room."""
    asked: list[object] = []

    def refuse(*_: object, **__: object) -> None:
        asked.append(None)
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(tempfile, "TemporaryFile", refuse)
    for _ in range(1000):  # chunks: some 120 bytes each
        desk.write(1, 10)
    assert asked
    desk.task.finish(cut=False)
    recording = open_recording(desk.path)
    assert [message.time_ns for message in recording.messages() if message.topic == EVENT] == list(range(1000))
    assert recording.complete
    assert (desk.ring.saved, desk.ring.said) == (1000, "")


@pytest.mark.parametrize(
    "payload", [b"", b"\x81\xa4text", pack(Event("two")) + b"\0", msgspec.msgpack.encode({"text": Ext(1, b"x")})]
)
def test_a_record_that_cannot_be_read_is_a_gap_and_ends_no_recording(desk, payload):
    desk.put(1)
    desk.ring.put(EVENT, 1, payload)
    desk.put_messages += 1
    desk.put(1)
    desk.task.take()
    desk.task.finish(cut=False)
    assert desk.in_file() == [0, 2]
    assert desk.ring.saved == 2
    (gap,) = [message for message in open_recording(desk.path).messages() if KINDS[message.topic] == "gap"]
    assert b"could not be read" in gap.payload


@pytest.mark.parametrize("noticed", ["flush", "finish"])
def test_of_a_file_that_cannot_be_put_back_nothing_counts_as_saved(desk, noticed):
    desk.write(100)
    assert desk.ring.saved == 100
    shutil.rmtree(desk.path.parent)
    desk.path.parent.write_text("something else has that name now")
    desk.put(100)
    desk.task.take()
    if noticed == "flush":
        desk.task.flush()
        assert desk.ring.saved == 0
        desk.put(100)
    desk.task.finish(cut=False)
    assert desk.ring.saved == 0
    assert desk.ring.said.startswith(f"{desk.path}: the file is gone: it was removed and cannot be put back: ")


def test_a_file_that_is_removed_after_the_disk_was_full_is_put_back(desk, limit_files):
    """The report says that what was written stays readable."""
    desk.write(100)
    limit_files(desk.path.stat().st_size + 100)
    desk.write(100)
    shutil.rmtree(desk.path.parent)
    desk.task.flush()
    assert desk.in_file() == list(range(100))
    assert desk.ring.saved == 100
