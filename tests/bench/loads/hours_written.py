"""Writing a recording for hours, as fast as it goes: what the writer's memory becomes."""

import os
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, cast

import msgspec

from cogrip.protocol.io.recording_process import FLUSH_EVERY_S, WholePieces
from cogrip.protocol.recording.derived import DERIVED
from cogrip.protocol.recording.reader import RecordedMessage, open_recording
from cogrip.protocol.recording.records import kind_of
from cogrip.protocol.recording.writer import RecordingWriter

from tests.bench.loads.process_memory import own_memory_kb

SETTLED_S = 60.0  # what the writer keeps at all it has by then


class HoursWritten(msgspec.Struct, frozen=True):
    """CPU time of writing, time of the end; memory [MB] after SETTLED_S, at the last message, and behind the end."""

    messages: int
    work_s: float
    end_s: float
    settled_mb: float
    last_mb: float
    end_mb: float


def write_hours(path: Path, seconds: float) -> HoursWritten:
    """Write the messages of `path` to nowhere, again and again for so long of their own time, flushed as in a live session."""
    recording = open_recording(path)
    kinds = [kind_of(topic) for topic in recording.topics]
    messages = [message for message in recording.messages() if kinds[message.topic] not in DERIVED]
    fd = os.open(os.devnull, os.O_WRONLY)
    try:
        stream = WholePieces(fd)
        writer = RecordingWriter(cast(IO[bytes], stream), recording.header, path.parent)
        count, settled_mb, flushed_ns = 0, 0.0, 0
        began = time.process_time()
        for message in _again(messages, round(seconds * 1e9)):
            if message.time_ns - flushed_ns >= FLUSH_EVERY_S * 1e9:
                flushed_ns = message.time_ns
                writer.flush()
                if not settled_mb and flushed_ns >= SETTLED_S * 1e9:
                    settled_mb = _memory_mb()
            writer.put(*message)
            count += 1
        work_s = time.process_time() - began
        last_mb = _memory_mb()
        began = time.perf_counter()
        writer.finish()
        stream.flush()
        return HoursWritten(count, work_s, time.perf_counter() - began, settled_mb, last_mb, _memory_mb())
    finally:
        os.close(fd)


def _again(messages: Sequence[RecordedMessage], until_ns: int) -> Iterator[RecordedMessage]:
    """From 0 on, lap after lap."""
    first_ns = messages[0].time_ns
    lap_ns = messages[-1].time_ns - first_ns + 1
    for start_ns in range(0, until_ns, lap_ns):
        for topic, time_ns, payload in messages:
            yield RecordedMessage(topic, time_ns - first_ns + start_ns, payload)


def _memory_mb() -> float:
    return own_memory_kb() * 1024 / 1e6
