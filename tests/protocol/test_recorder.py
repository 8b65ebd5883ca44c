"""A recorder with its real writer process: what is put is in the file, and no trouble of the file reaches the loop."""

import errno
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest

from cogrip.protocol.io.recorder import RING_BYTES, Recorder, is_being_written, open_recorder, ring_for
from cogrip.protocol.recording.reader import RecordedMessage, RecordingError, open_recording
from cogrip.protocol.recording.records import Clock, Gap

from tests.protocol.test_recording_file import header

KINDS = ("event", "input", "gap", "clock")
EVENT, COMMAND, GAP, CLOCK = range(4)
MOST_TURNS = 50_000_000  # of a loop that waits for the writer: hours; a test that hangs is ended long before
TOO_SLOW = "recording of client-anna.mcap is too slow: messages are left out, and counted"
LIMIT_S, POLL_S = 600.0, 0.005

Words = list[str]
Start = Callable[..., Recorder]


def text(number: int) -> bytes:
    return b'{"text":"%d"}' % number


@pytest.fixture
def words() -> Words:
    """Reports to the session."""
    return []


@pytest.fixture
def start(words: Words, tmp_path: Path) -> Iterator[Start]:
    """Begin a recording at `tmp_path/run/client-anna.mcap`; whatever is open at the end is closed."""
    begun: list[Recorder] = []

    def begin(**arguments: int) -> Recorder:
        recorder = open_recorder(tmp_path / "run" / "client-anna.mcap", header(KINDS), words.append, **arguments)
        assert recorder is not None, words
        begun.append(recorder)
        return recorder

    yield begin
    for recorder in begun:
        if not ended(recorder):
            os.kill(writer_of(recorder), signal.SIGCONT)
            recorder.close()


def writer_of(recorder: Recorder) -> int:
    return recorder.process.pid


def ended(recorder: Recorder) -> bool:
    return recorder.process.poll() is not None


def stop(recorder: Recorder) -> None:
    """Stop the writer, and wait until it stands."""
    os.kill(writer_of(recorder), signal.SIGSTOP)
    os.waitid(os.P_PID, writer_of(recorder), os.WSTOPPED | os.WNOWAIT)


def put(recorder: Recorder, first: int, last: int) -> int:
    """Put these messages; gives the number of the next."""
    for number in range(first, last):
        recorder.put(EVENT, number, text(number))
    return last


def wait_for(reached: Callable[[], object]) -> None:
    for _ in range(round(LIMIT_S / POLL_S)):
        if reached():
            return
        time.sleep(POLL_S)
    raise AssertionError("never reached")


def put_until(recorder: Recorder, first: int, reached: Callable[[], object]) -> int:
    """Put one message after the other; gives the number of the next."""
    for number in range(first, first + MOST_TURNS):
        if reached():
            return number
        recorder.put(EVENT, number, text(number))
    raise AssertionError("never reached")


def numbers_in(path: Path, *, complete: bool | None = None) -> list[int]:
    """Return the numbers of our messages in the file, in order, and whether it was closed."""
    recording = open_recording(path)
    numbers = [message.time_ns for message in recording.messages() if message.topic == EVENT]
    if complete is not None:  # and nobody is writing it now
        assert recording.complete == complete
        assert not recording.damage
    return numbers


def ours(path: Path) -> list[RecordedMessage]:
    """Return all messages of the file but the clock's."""
    return [message for message in open_recording(path).messages() if message.topic != CLOCK]


def gaps(messages: list[RecordedMessage]) -> list[int]:
    """Return how many messages each gap stands for."""
    return [msgspec.json.decode(each.payload, type=Gap).messages for each in messages if each.topic == GAP]


def flushed(path: Path) -> list[int]:
    """Return `numbers_in` of a file that may not have its header yet; leave its writer time for more."""
    time.sleep(POLL_S)
    try:
        return numbers_in(path)
    except RecordingError:
        return []


def test_everything_that_is_put_is_in_the_file(start, words):
    recorder = start()
    put(recorder, 0, 5000)
    recorder.put(COMMAND, 5000, b'{"verb":"leave"}')
    recorder.close()
    assert ours(recorder.path) == [
        *(RecordedMessage(EVENT, number, text(number)) for number in range(5000)),
        RecordedMessage(COMMAND, 5000, b'{"verb":"leave"}'),
    ]
    recording = open_recording(recorder.path)
    list(recording.chunks())
    assert (recording.complete, recording.cut) == (True, False)
    assert recording.header == header(KINDS)
    assert (words, recorder.lost, recorder.trouble) == ([], 0, "")


@pytest.mark.parametrize("messages", [0, 1])
def test_however_short_a_session_is_it_has_a_clock_anchor(start, messages, words):
    """Without one it cannot be aligned with the recordings of other machines; a recording of nothing is a whole file."""
    recorder = start()
    put(recorder, 0, messages)
    recorder.close()
    assert numbers_in(recorder.path, complete=True) == list(range(messages))
    assert not words
    anchors = [message for message in open_recording(recorder.path).messages() if message.topic == CLOCK]
    assert bool(anchors) == bool(messages)
    for message in anchors:
        assert msgspec.json.decode(message.payload, type=Clock).monotonic_ns == message.time_ns


@pytest.mark.parametrize("folder", ["/proc/cogrip", "/sys/kernel", "a file"])
def test_where_nothing_can_be_written_the_session_goes_on_without(words, folder, tmp_path):
    if folder == "a file":  # which is not called an existing recording
        folder = tmp_path / "run"
        folder.write_text("not a folder")
    elif not Path(folder).parents[-2].is_mount():
        pytest.skip(f"{Path(folder).parents[-2]} is not mounted here: a plain folder could be written to")
    existing = tmp_path / "client-anna.mcap"
    existing.write_bytes(b"somebody's only copy")
    for path in (Path(folder) / "client-anna.mcap", existing):
        assert open_recorder(path, header(KINDS), words.append) is None
    said, exists = words
    assert said.startswith(f"this session is not recorded: {folder}/client-anna.mcap: ")
    assert said.endswith("choose another folder with --runs")
    assert f"{existing} exists, and no recording is overwritten" in exists
    assert existing.read_bytes() == b"somebody's only copy"


def test_a_full_ring_costs_messages_that_are_counted_and_marked_at_their_place(start, words):
    """The writer is stopped twice while the loop goes on; the loop notices nothing but the count."""
    recorder = start(ring_bytes=16 * 1024)
    first = put_until(recorder, 0, lambda: flushed(recorder.path))
    stop(recorder)
    second = put_until(recorder, first, lambda: recorder.lost >= 100)
    assert len(words) == 1, "said at once"
    os.kill(writer_of(recorder), signal.SIGCONT)
    kept = recorder.lost + second  # one more is let in as soon as there is room
    third = put_until(recorder, second, lambda: second < max(flushed(recorder.path)))
    stop(recorder)
    fourth = put_until(recorder, third, lambda: recorder.lost >= kept)
    os.kill(writer_of(recorder), signal.SIGCONT)
    recorder.close()
    lost, found = recorder.lost, ours(recorder.path)
    assert sum(message.topic == EVENT for message in found) + lost == fourth
    assert sum(gaps(found)) == lost
    number = 0
    for message in found:
        if message.topic == GAP:
            number += gaps([message])[0]
        else:
            assert message == RecordedMessage(EVENT, number, text(number)), "a gap stands where they are missing"
            number += 1
    assert words == [TOO_SLOW], "said once"


def test_messages_lost_at_the_very_end_are_marked_too(start):
    recorder = start(ring_bytes=4096)
    stop(recorder)
    last = put_until(recorder, 0, lambda: recorder.lost >= 70_000)  # more than two bytes count
    os.kill(writer_of(recorder), signal.SIGCONT)
    recorder.close()
    found = ours(recorder.path)
    assert [message.time_ns for message in found if message.topic == EVENT] == list(range(last - recorder.lost))
    assert found[-1].topic == GAP
    assert sum(gaps(found)) == recorder.lost


def test_a_killed_writer_is_noticed_and_what_it_flushed_is_there(start, words):
    recorder = start(ring_bytes=1 << 20)
    put_until(recorder, put(recorder, 0, 1000), lambda: len(flushed(recorder.path)) > 1000)
    safe = len(numbers_in(recorder.path))
    os.kill(writer_of(recorder), signal.SIGKILL)
    last = put_until(recorder, 10**9, lambda: recorder.trouble)
    put(recorder, last, last + 50_000)  # and on, until the ring is full
    assert recorder.lost > 0
    recorder.close()
    since_the_kill = last - 10**9 + 50_000
    stopped = f"recording of client-anna.mcap has stopped: {recorder.trouble}"
    assert words in ([stopped], [TOO_SLOW, stopped]), "said once; the ring may be full before its writer is missed"
    assert "what it had written can be recovered" in recorder.trouble
    recording = open_recording(recorder.path)
    numbers = [message.time_ns for message in recording.messages() if message.topic == EVENT]
    assert not recording.complete
    assert len(numbers) >= safe
    assert numbers == list(range(len(numbers)))
    assert recorder.lost >= since_the_kill, "what never came into the file is counted"


def test_a_writer_that_is_asked_to_end_goes_on_to_the_loops_end(start, words):
    """Ctrl-C reaches every process of a terminal; the writer's end is that of its loop."""
    recorder = start()
    put_until(recorder, 0, lambda: flushed(recorder.path))
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(writer_of(recorder), number)
    put(recorder, 10**9, 10**9 + 1000)
    recorder.close()
    assert numbers_in(recorder.path)[-1000:] == list(range(10**9, 10**9 + 1000))
    assert not words


KILLED_LOOP = """
import json, os, signal, sys
from pathlib import Path
from cogrip.protocol.io.recorder import open_recorder
from cogrip.protocol.recording.header import header_of

recorder = open_recorder(Path(sys.argv[1]), header_of(json.loads(sys.argv[2])), print)
for number in range(5000):
    recorder.put(0, number, b'{"text":"%d"}' % number)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_the_recording_of_a_killed_loop_is_closed_and_says_that_its_end_is_missing(tmp_path):
    path = tmp_path / "client-anna.mcap"
    loop = subprocess.run(
        [sys.executable, "-c", KILLED_LOOP, str(path), json.dumps(header(KINDS).metadata())],
        check=False, capture_output=True, timeout=LIMIT_S,
    )  # fmt: skip
    assert loop.returncode == -signal.SIGKILL, loop.stderr
    wait_for(lambda: not is_being_written(path))
    assert numbers_in(path, complete=True) == list(range(5000))
    recording = open_recording(path)
    list(recording.chunks())
    assert recording.cut


def test_a_removed_folder_comes_back_whole(start, words):
    recorder = start()
    removed = put_until(recorder, put(recorder, 0, 1000), lambda: len(flushed(recorder.path)) > 1000)
    shutil.rmtree(recorder.path.parent)
    wait_for(recorder.path.exists)
    last = put_until(recorder, removed, lambda: removed < max(flushed(recorder.path), default=0))
    recorder.close()
    assert numbers_in(recorder.path, complete=True) == list(range(last))
    assert (words, recorder.lost) == ([], 0)


def test_a_folder_removed_at_the_last_moment_comes_back_too(start, words):
    """Between the last flush and the end: the writer stands still meanwhile, so that nothing else can come between."""
    recorder = start()
    last = put_until(recorder, put(recorder, 0, 1000), lambda: len(flushed(recorder.path)) > 1000)
    stop(recorder)
    shutil.rmtree(recorder.path.parent)
    closing = threading.Thread(target=recorder.close)
    closing.start()
    while not recorder.process.stdin.closed:  # the last that `close` does before it waits
        pass
    os.kill(writer_of(recorder), signal.SIGCONT)
    closing.join()
    assert numbers_in(recorder.path, complete=True) == list(range(last))
    assert not words


def test_a_folder_that_cannot_come_back_is_said(start, words):
    recorder = start()
    first = put_until(recorder, 0, lambda: flushed(recorder.path))
    stop(recorder)
    shutil.rmtree(recorder.path.parent)
    recorder.path.parent.write_text("something else has that name now")
    os.kill(writer_of(recorder), signal.SIGCONT)
    wait_for(lambda: recorder.ring.said)
    assert not words, "the loop looks at what the writer says only when it puts"
    put(recorder, 10**9, 10**9 + 64)
    assert words == [f"recording of client-anna.mcap has stopped: {recorder.trouble}"], "said at once"
    put(recorder, 10**9 + 64, 10**9 + 1000)
    recorder.close()
    assert len(words) == 1, "said once"
    assert f"{recorder.path}: the file is gone" in recorder.trouble
    assert recorder.lost == first + 1000, "what had been written before too"


@pytest.mark.parametrize("room_bytes", [200_000, 0])
def test_a_full_disk_is_said_once_and_what_was_written_stays_readable(start, words, room_bytes):
    """For about 600 kB the writer has room for 200 kB, or for none before the first byte."""
    recorder, chance = start(), random.Random(1)
    resource.prlimit(writer_of(recorder), resource.RLIMIT_FSIZE, (room_bytes, room_bytes))
    for number in range(600):
        recorder.put(EVENT, number, b'{"text":"%01024x"}' % chance.getrandbits(4096))
        if room_bytes and number == 100:
            wait_for(lambda: recorder.path.stat().st_size > 50_000)
    wait_for(lambda: recorder.ring.said)
    put(recorder, 10**9, 10**9 + 1000)
    recorder.close()
    assert recorder.trouble == f"{recorder.path}: {os.strerror(errno.EFBIG)}; what was written before stays readable"
    assert words == [f"recording of client-anna.mcap has stopped: {recorder.trouble}"], "said once"
    if not room_bytes:
        assert recorder.lost == 1600
    else:
        recording = open_recording(recorder.path)
        numbers = [message.time_ns for message in recording.messages() if message.topic == EVENT]
        assert len(numbers) > 100
        assert numbers == list(range(len(numbers)))
        assert not recording.damage, "no half a chunk is left"
        assert recorder.lost == 1600 - len(numbers)


@pytest.mark.parametrize(
    ("rate_hz", "rings"), [(1, 1), (128, 1), (1024, 1), (1025, 2), (3072, 3), (4096, 4), (8192, 4)]
)
def test_a_faster_loop_has_a_larger_ring(rate_hz: int, rings: int) -> None:
    assert ring_for(rate_hz) == rings * RING_BYTES
