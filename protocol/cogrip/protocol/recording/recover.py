"""Recovery of a recording that was cut short or damaged: all intact messages in a new file; the old one is kept."""

import errno
import os
from dataclasses import dataclass
from pathlib import Path

import msgspec

from cogrip.protocol.recording.derived import DERIVED
from cogrip.protocol.recording.folder import RECOVERED
from cogrip.protocol.recording.reader import Damage, Recording, open_recording
from cogrip.protocol.recording.reader import is_closed as ends_whole
from cogrip.protocol.recording.records import Gap, kind_of
from cogrip.protocol.recording.writer import RecordingWriter


@dataclass(frozen=True, slots=True)
class Recovered:
    """Result of a recovery: messages, seconds from the first to the last of them, and what could not be recovered."""

    path: Path
    messages: int
    seconds: float
    damage: tuple[Damage, ...]


def is_closed(path: Path) -> bool:
    """Return whether the writer closed the file."""
    with path.open("rb") as file:
        return ends_whole(file)


def recover(path: Path) -> Recovered:
    """Write `<name>.recovered.mcap` beside `path`. Its gaps mark missing messages, its header a missing end.

    Raises RecordingError for what is no recording, FileExistsError where it was recovered before, OSError.
    """
    recording = open_recording(path)
    target = path.with_name(f"{path.name.removesuffix('.mcap')}{RECOVERED}")
    if target.exists():
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(target))
    last = None
    for chunk in recording.chunks():  # the first pass: the header says whether the end is missing
        last = chunk[-1].time_ns
    cut = (
        recording.cut
        or not recording.complete
        or any(each.to_ns is None and each.from_ns == last for each in recording.damage)
    )
    unfinished = target.with_suffix(f".{os.getpid()}.part")  # half a recovery must not stand for the whole old file
    try:
        with unfinished.open("wb") as file:
            header = msgspec.structs.replace(recording.header, cut=cut)
            messages, seconds = _copy(recording, RecordingWriter(file, header, path.parent))
        unfinished.rename(target)
    except OSError:
        unfinished.unlink(missing_ok=True)
        raise
    return Recovered(target, messages, seconds, tuple(recording.damage))


def _copy(recording: Recording, writer: RecordingWriter) -> tuple[int, float]:
    """Copy the intact messages and close the new recording; return their number, and seconds from first to last.

    The writer derives pictures anew, so those are neither copied nor counted.
    """
    topics = recording.topics
    copied = [kind_of(topic) not in DERIVED for topic in topics]
    gap = next(number for number, topic in enumerate(topics) if kind_of(topic) == "gap")
    messages, first_ns, last_ns, known = 0, None, 0, 0
    for chunk in recording.chunks():
        for damage in recording.damage[known:]:
            text = f"{damage.length} bytes of the recording were unreadable: {damage.reason}"
            writer.put(gap, chunk[0].time_ns, msgspec.json.encode(Gap(0, text)))
        known = len(recording.damage)
        for message in chunk:
            if message.topic < len(topics) and copied[message.topic]:
                writer.put(*message)
                messages += 1
        first_ns = chunk[0].time_ns if first_ns is None else first_ns
        last_ns = chunk[-1].time_ns
    writer.finish()
    return messages, (last_ns - first_ns) * 1e-9 if first_ns is not None else 0.0
