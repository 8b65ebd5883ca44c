"""A recording that was cut short or damaged, written anew with all of it that is whole; the old file is kept."""

from dataclasses import dataclass
from pathlib import Path

import msgspec

from cogrip.protocol.recording.folder import RECOVERED
from cogrip.protocol.recording.reader import MAGIC, Damage, open_recording
from cogrip.protocol.recording.records import Gap, kind_of
from cogrip.protocol.recording.writer import RecordingWriter


@dataclass(frozen=True, slots=True)
class Recovered:
    """What was saved: messages and seconds from the first to the last of them; what could not be, in `damage`."""

    path: Path
    messages: int
    seconds: float
    damage: tuple[Damage, ...]


def is_closed(path: Path) -> bool:
    """Whether its writer came to the end."""
    with path.open("rb") as file:
        file.seek(0, 2)
        file.seek(max(0, file.tell() - len(MAGIC)))
        return file.read() == MAGIC


def recover(path: Path) -> Recovered:
    """Write `<name>.recovered.mcap` beside `path`. What is missing in the middle is marked there as a gap.

    Raises RecordingError for what is no recording, FileExistsError where it was recovered before, OSError.
    """
    recording = open_recording(path)
    topics = recording.topics
    gap = next(number for number, topic in enumerate(topics) if kind_of(topic) == "gap")
    target = path.with_name(f"{path.name.removesuffix('.mcap')}{RECOVERED}")
    messages, first_ns, last_ns, known = 0, None, 0, 0
    with target.open("xb") as file:
        writer = RecordingWriter(file, recording.header)
        for chunk in recording.chunks():
            for damage in recording.damage[known:]:
                text = f"{damage.length} bytes of the recording were unreadable: {damage.reason}"
                writer.put(gap, chunk[0].time_ns, msgspec.json.encode(Gap(0, text)))
            known = len(recording.damage)
            for message in chunk:
                if message.topic < len(topics):
                    writer.put(*message)
                    messages += 1
            if first_ns is None:
                first_ns = chunk[0].time_ns
            last_ns = chunk[-1].time_ns
        writer.finish()
    return Recovered(
        target, messages, (last_ns - (first_ns or 0)) * 1e-9 if first_ns is not None else 0.0, tuple(recording.damage)
    )
