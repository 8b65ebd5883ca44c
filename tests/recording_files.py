"""Recordings as tests write them, and write them anew with something spoiled."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from cogrip.protocol.recording.derived import DERIVED
from cogrip.protocol.recording.header import Header
from cogrip.protocol.recording.reader import RecordedMessage, open_recording
from cogrip.protocol.recording.records import kind_of
from cogrip.protocol.recording.writer import RecordingWriter

Alter = Callable[[str, RecordedMessage], bytes | None]
"""The payload for a message of this kind; None leaves the message out."""


@contextmanager
def written(path: Path, header: Header, closed: bool = True) -> Iterator[RecordingWriter]:
    """A recording at `path`: closed at the end, or left as by a writer that came no further."""
    with path.open("wb") as file:
        writer = RecordingWriter(file, header)
        yield writer
        if closed:
            writer.finish()
        else:
            writer.flush()


def same(kind: str, message: RecordedMessage) -> bytes | None:
    return message.payload


def rewrite(path: Path, alter: Alter = same, closed: bool = True, late_ns: int = 0, **header: object) -> None:
    """Write a recording anew: other payloads, later, other fields of the header, perhaps not closed."""
    recording = open_recording(path)
    derived = {number for number, topic in enumerate(recording.topics) if kind_of(topic) in DERIVED}
    messages = [message for message in recording.messages() if message.topic not in derived]
    with written(path, msgspec.structs.replace(recording.header, **header), closed) as writer:
        for message in messages:
            payload = alter(kind_of(recording.topics[message.topic]), message)
            if payload is not None:
                writer.put(message.topic, message.time_ns + late_ns, payload)
