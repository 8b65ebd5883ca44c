"""Index of one recording by time: seconds in the middle of a long file are read without all that is before them.

Only the heads of the file's records are read for it: a chunk says its times, the message indexes behind it say its topics.
It needs some 24 bytes of memory a chunk (1 MB an hour).
"""

from array import array
from collections.abc import Collection, Iterator
from struct import Struct, error

import numpy as np
import zstandard

from cogrip.protocol.recording.reader import (
    ATTACHMENT,
    CHANNEL,
    CHUNK,
    DATA_END,
    HEADER,
    MAGIC,
    MESSAGE_INDEX,
    METADATA,
    SCHEMA,
    RecordedMessage,
    RecordingError,
)
from cogrip.results.reading.records import End

_FRAME = Struct("<BQ")
_TIMES = Struct("<QQ")
_CHANNEL = Struct("<H")
_PASSED_OVER = (HEADER, SCHEMA, CHANNEL, ATTACHMENT, METADATA)
_ONE_S = 10**9


class FileIndex:
    """Places of the chunks of `end`, and which of them hold messages of the topics in `kinds` (last parts, or whole topics).

    damaged   chunks that could not be opened so far: their messages are missing
    Raises RecordingError where the file's structure is damaged; one that is cut off is read as far as it goes.
    """

    def __init__(self, end: End, kinds: Collection[str]) -> None:
        self.end = end
        self.damaged: set[int] = set()
        self._offsets, self._first_ns, self._last_ns = array("q"), array("q"), array("q")
        self._holding = {end.topic(kind): array("q") for kind in kinds}  # numbers of chunks
        self._walk()
        self._first, self._last = np.array(self._first_ns), np.array(self._last_ns)

    def _walk(self) -> None:
        path, epoch_ns = self.end.path, self.end.recording.header.epoch_ns
        size, offset = path.stat().st_size, len(MAGIC)
        with path.open("rb") as file:
            while True:
                file.seek(offset)
                head = file.read(_FRAME.size + _TIMES.size)
                if len(head) < _FRAME.size:
                    return
                opcode, length = _FRAME.unpack_from(head)
                following = offset + _FRAME.size + length
                if opcode == DATA_END or (following > size and opcode in (*_PASSED_OVER, CHUNK, MESSAGE_INDEX)):
                    return
                if opcode == CHUNK and len(head) == _FRAME.size + _TIMES.size:
                    first_ns, last_ns = _TIMES.unpack_from(head, _FRAME.size)
                    self._offsets.append(offset)
                    self._first_ns.append(min(max(first_ns - epoch_ns, -(2**62)), 2**62))
                    self._last_ns.append(min(max(last_ns - epoch_ns, -(2**62)), 2**62))
                elif opcode == MESSAGE_INDEX and self._offsets and len(head) >= _FRAME.size + _CHANNEL.size:
                    holding = self._holding.get(_CHANNEL.unpack_from(head, _FRAME.size)[0] - 1)
                    if holding is not None:
                        holding.append(len(self._offsets) - 1)
                elif opcode not in _PASSED_OVER:
                    raise RecordingError(
                        f"{path} is damaged at byte {offset}; `cogrip recover {path}` keeps all that is intact"
                    )
                offset = following

    def messages(self, kind: str, from_s: float = -1e9, to_s: float = 1e9) -> Iterator[tuple[float, RecordedMessage]]:
        """Yield (time [s] of the run, message) of one of the topics, in the order of the file, from_s <= time < to_s."""
        topic, shift_s = self.end.topic(kind), self.end.offset_s
        from_ns, to_ns = round((from_s - shift_s) * _ONE_S) - 1, round((to_s - shift_s) * _ONE_S) + 1
        for number in self._holding[topic]:
            if self._last[number] < from_ns or self._first[number] > to_ns:
                continue
            for message in self._open(number):
                if message.topic == topic:
                    time_s = message.time_ns * 1e-9 + shift_s
                    if from_s <= time_s < to_s:
                        yield time_s, message

    def first_and_last(self, kind: str) -> tuple[float, float] | None:
        """Return the times [s] of the first and the last message of one of the topics; None where there is none."""
        topic, shift_s = self.end.topic(kind), self.end.offset_s
        found: list[int] = []
        for numbers in (self._holding[topic], reversed(self._holding[topic])):
            for number in numbers:
                times = [message.time_ns for message in self._open(number) if message.topic == topic]
                if times:
                    found.append(times[-1] if found else times[0])
                    break
        return (found[0] * 1e-9 + shift_s, found[1] * 1e-9 + shift_s) if found else None

    def _open(self, number: int) -> list[RecordedMessage]:
        with self.end.path.open("rb") as file:
            file.seek(self._offsets[number])
            _, length = _FRAME.unpack(file.read(_FRAME.size))
            content = file.read(length)
        try:
            return self.end.recording.open_chunk(content)
        except (ValueError, zstandard.ZstdError, error):
            self.damaged.add(number)
            return []
