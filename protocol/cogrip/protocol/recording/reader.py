"""Reader of recordings: yields all that is intact, in order, and names the damage.

The file is read record by record (MCAP: opcode u8, length u64, content), so memory stays flat. A chunk that does not
decompress to its checksum is left out; where the lengths themselves are damaged, reading goes on at the next chunk.

    chunk: start u64, end u64, size u64, crc u32, "zstd" as u32 length and text, u64 length, compressed records
    message: channel u16, sequence u32, log_time u64, publish_time u64, JSON text
"""

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from struct import Struct, error
from typing import IO, NamedTuple

import msgspec
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.records import Metadata

from cogrip.protocol.foreign_file import ForeignFileError
from cogrip.protocol.recording.header import CUT, FORMAT, NAME, Header, header_of

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = range(0x01, 0x08)
ATTACHMENT, STATISTICS, METADATA, DATA_END = 0x09, 0x0B, 0x0C, 0x0F
_IN_DATA = (HEADER, SCHEMA, CHANNEL, CHUNK, MESSAGE_INDEX, ATTACHMENT, METADATA, DATA_END)
MOST_BYTES = 64 * 2**20  # longest record: more is a damaged length
MOST_CHUNK_BYTES = 8 * 2**20
"""Largest content of a chunk: the writer ends one at 64 KiB, and no tool makes them larger than 4 MiB."""
MOST_PACKED = 100
"""Most bytes that one packed byte gives: sessions are packed to a third, to a tenth where nothing moves."""
_FRAME = Struct("<BQ")
_CHUNK = Struct("<QQQI")
_MESSAGE = Struct("<HIQQ")
_LENGTH = Struct("<I")
_FOOTER = Struct("<QQI")
_STATISTICS = Struct("<QHIIIIQQ")
_SIGNATURE = b"\x04\x00\x00\x00zstd"
_SIGNATURE_AT = _FRAME.size + _CHUNK.size
_INNER = Struct("<Q")
_INDEX = Struct("<HI")
_BLOCK = 1 << 20


class RecordingError(ForeignFileError):
    """A file that cannot be read as a recording. The text names what it is, and the cure."""


class RecordedMessage(NamedTuple):
    topic: int  # place of the topic in the header's topics
    time_ns: int  # time on the recording's own clock
    payload: bytes


class Damage(NamedTuple):
    """Bytes that could not be read, and the times between which messages are missing (None: from the begin or to the end)."""

    offset: int
    length: int
    from_ns: int | None
    to_ns: int | None
    reason: str


@dataclass
class Recording:
    """One file, read anew by every pass over it.

    damage    known once a pass is over
    complete  its writer closed the file; known once a pass is over
    cut       the last messages may be missing, though the file is closed; known once a pass is over
    """

    path: Path
    header: Header
    damage: list[Damage] = field(default_factory=list)
    complete: bool = False
    cut: bool = False

    @property
    def topics(self) -> tuple[str, ...]:
        return self.header.topics

    def chunks(self) -> Iterator[list[RecordedMessage]]:
        """Yield intact chunks, oldest first."""
        self.damage, self.complete, self.cut, known = [], False, self.header.cut, 0
        last_ns: int | None = None  # of the newest intact chunk
        with self.path.open("rb") as file:
            for chunk in self._read(file):
                if chunk:  # all damage found since the last intact one ends here
                    for number in range(known, len(self.damage)):
                        self.damage[number] = self.damage[number]._replace(to_ns=chunk[0].time_ns)
                    known, last_ns = len(self.damage), chunk[-1].time_ns
                    yield chunk
                elif len(self.damage) > known:
                    self.damage[-1] = self.damage[-1]._replace(from_ns=last_ns)

    def _read(self, file: IO[bytes]) -> Iterator[list[RecordedMessage]]:
        """Yield chunks; an empty one stands for the damage that was found last, or is one without messages."""
        size = self.path.stat().st_size
        offset = len(MAGIC)
        while True:
            opcode, length = _frame_at(file, offset) or (0, 0)
            end = offset + _FRAME.size + length
            reason, here = "", False
            if opcode == CHUNK and end <= size:
                try:
                    yield self.open_chunk(file.read(length))
                    offset = end
                    continue
                except (ValueError, zstandard.ZstdError, error) as problem:
                    reason = f"damaged chunk ({problem})"
                    here = _agrees(file, offset)
            elif opcode not in _IN_DATA or length > MOST_BYTES or end > size:
                reason = "damaged"
            else:
                here = _agrees(file, offset)  # a chunk all the same, with a damaged opcode
                # or a length that would pass over one, which may be damaged itself
                if here or not _fits(file, offset) or _next_chunk(file, offset + 1, end) is not None:
                    reason = "damaged"
                elif opcode == METADATA:
                    self.cut = self.cut or _named(file, offset, length, CUT)
            if here:
                self.damage.append(Damage(offset, end - offset, None, None, reason))
                yield []
            if here or (not reason and opcode != DATA_END):
                offset = end
                continue
            following = _next_chunk(file, offset + 1, size)
            if following is None:
                self.complete = is_closed(file)
                if reason and offset < size:
                    reason = reason if self.complete else "the end is cut off"
                    self.damage.append(Damage(offset, size - offset, None, None, reason))
                    yield []
                return
            self.damage.append(Damage(offset, following - offset, None, None, reason or "damaged"))
            yield []
            offset = following

    def open_chunk(self, content: bytes) -> list[RecordedMessage]:
        """Return the messages in a chunk record. Raises ValueError, ZstdError or struct.error for one that is damaged, or that
        would take more time and memory to open than any that was written."""
        _, _, size, crc = _CHUNK.unpack_from(content)
        (name_length,) = _LENGTH.unpack_from(content, _CHUNK.size)
        at = _CHUNK.size + _LENGTH.size + name_length
        if content[at - name_length : at] != b"zstd":
            raise ValueError(f"compressed as {content[at - name_length : at][:20]!r}")
        most = min(MOST_CHUNK_BYTES, MOST_PACKED * len(content))
        if size > most:
            raise ValueError(f"{len(content)} bytes that say they hold {size}, and {most} is the most that is opened")
        if _INNER.unpack_from(content, at)[0] != len(content) - at - _INNER.size:
            raise ValueError("length")
        if zstandard.frame_content_size(content[at + 8 :]) != size:  # asked first: that much memory will be taken
            raise ValueError("size")
        records = zstandard.decompress(content[at + 8 :])
        if len(records) != size or (crc and zlib.crc32(records) != crc):
            raise ValueError("checksum")
        return self._messages(records)

    def _messages(self, records: bytes) -> list[RecordedMessage]:
        found, position, end, epoch_ns = [], 0, len(records), self.header.epoch_ns
        frame, head, body = _FRAME.unpack_from, _MESSAGE.unpack_from, _FRAME.size + _MESSAGE.size
        while position < end:
            opcode, length = frame(records, position)
            following = position + _FRAME.size + length
            if opcode == MESSAGE:
                channel, _, time_ns, _ = head(records, position + _FRAME.size)
                found.append(RecordedMessage(channel - 1, time_ns - epoch_ns, records[position + body : following]))
            position = following
        return found

    def last_ns(self) -> int:
        """Return the time of the last message: from the statistics of a closed file, else by reading it; 0 if there is none."""
        with self.path.open("rb") as file:
            said_ns = _end_in_statistics(file, self.path.stat().st_size)
        if said_ns is not None:
            return said_ns - self.header.epoch_ns
        return max((chunk[-1].time_ns for chunk in self.chunks()), default=0)

    def messages(self) -> Iterator[RecordedMessage]:
        """Yield every intact message, in the order of the file."""
        for chunk in self.chunks():
            yield from chunk


class Follower:
    """The newest message of every topic of a recording that is still being written.

    each: called with topic and message, for every message in turn
    """

    def __init__(self, path: Path, each: Callable[[str, RecordedMessage], None] | None = None) -> None:
        """Raises as `open_recording` does."""
        self._recording = open_recording(path)
        self._each = each
        self._offset = len(MAGIC)
        self.newest: dict[str, RecordedMessage] = {}

    def look(self) -> dict[str, RecordedMessage]:
        """Read what was written since the last call; return `newest`."""
        recording = self._recording
        with recording.path.open("rb") as file:
            size = recording.path.stat().st_size
            while True:
                opcode, length = _frame_at(file, self._offset) or (0, MOST_BYTES)
                if self._offset + _FRAME.size + length > size or not 0 < opcode < DATA_END:
                    return self.newest
                if opcode == CHUNK:
                    for message in recording.open_chunk(file.read(length)):
                        topic = recording.topics[message.topic]
                        self.newest[topic] = message
                        if self._each is not None:
                            self._each(topic, message)
                self._offset += _FRAME.size + length


def open_recording(path: Path) -> Recording:
    """Open a recording. Raises RecordingError for what is none, or is of a newer format; FileNotFoundError, OSError."""
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise RecordingError(f"{path} is not a recording (no MCAP file); name a run folder or its .mcap file")
        opcode, content = HEADER, b""
        while opcode != METADATA:
            frame = file.read(_FRAME.size)
            opcode, length = _FRAME.unpack(frame) if len(frame) == _FRAME.size else (HEADER, 1)
            if opcode not in (HEADER, METADATA) or length > MOST_BYTES:
                raise RecordingError(f"{path} is an MCAP file, but no recording of cogrip's")
            content = file.read(length)
            if len(content) < length:
                raise RecordingError(f"{path} ends before it says what it is; nothing of it can be saved")
    try:
        found = Metadata.read(ReadDataStream(BytesIO(content)))
        written = int(found.metadata.get("format", "0"))
        if found.name == NAME and written > FORMAT:
            raise RecordingError(
                f"{path} is a recording of format {written}, newer than {FORMAT}, the newest known here; update cogrip"
            )
        header = header_of(found.metadata)
    except (msgspec.MsgspecError, McapError, ValueError, RecursionError, error) as problem:
        raise RecordingError(f"{path} is an MCAP file, but its header is not cogrip's: {problem}") from None
    return Recording(path, header)


def _frame_at(file: IO[bytes], offset: int) -> tuple[int, int] | None:
    """Return opcode and length of the record at `offset`, behind whose frame the file then stands; None at the end."""
    file.seek(offset)
    frame = file.read(_FRAME.size)
    return _FRAME.unpack(frame) if len(frame) == _FRAME.size else None


def _end_in_statistics(file: IO[bytes], size: int) -> int | None:
    """Return log_time of the last message from the summary at the end of the file; None where that is not intact."""
    if not is_closed(file):
        return None
    file.seek(-_FOOTER.size - len(MAGIC), 2)
    start, _, _ = _FOOTER.unpack(file.read(_FOOTER.size))
    if not 0 < start < size:
        return None
    file.seek(start)
    while file.tell() + _FRAME.size < size:
        opcode, length = _FRAME.unpack(file.read(_FRAME.size))
        if opcode == STATISTICS and length >= _STATISTICS.size:
            messages, *_, end_ns = _STATISTICS.unpack(file.read(_STATISTICS.size))
            return end_ns if messages else None
        if not SCHEMA <= opcode <= DATA_END or length > MOST_BYTES:
            return None
        file.seek(length, 1)
    return None


def _next_chunk(file: IO[bytes], offset: int, end: int) -> int | None:
    """Return the next chunk's begin in `offset` to `end`, by its signature and lengths that agree; None if there is none."""
    start = offset
    while start < end:
        file.seek(start)
        block = file.read(min(_BLOCK, end - start + _SIGNATURE_AT + len(_SIGNATURE)))
        at = block.find(_SIGNATURE)
        while at >= 0:
            begin = start + at - _SIGNATURE_AT
            if offset <= begin < end and _agrees(file, begin):
                return begin
            at = block.find(_SIGNATURE, at + 1)
        if len(block) < _BLOCK:
            return None
        start += _BLOCK - _SIGNATURE_AT - len(_SIGNATURE)
    return None


def _agrees(file: IO[bytes], begin: int) -> bool:
    """Return whether a chunk begins here, by its signature and lengths that agree; its opcode may be damaged."""
    file.seek(begin)
    head = file.read(_SIGNATURE_AT + len(_SIGNATURE) + _INNER.size)
    if len(head) < _SIGNATURE_AT + len(_SIGNATURE) + _INNER.size:
        return False
    _, length = _FRAME.unpack_from(head)
    (inner,) = _INNER.unpack_from(head, _SIGNATURE_AT + len(_SIGNATURE))
    signed = head[_SIGNATURE_AT : _SIGNATURE_AT + len(_SIGNATURE)] == _SIGNATURE
    return bool(signed and length <= MOST_BYTES and length == len(head) - _FRAME.size + inner)


def _named(file: IO[bytes], begin: int, length: int, name: str) -> bool:
    """Return whether the metadata record here has this name."""
    file.seek(begin + _FRAME.size)
    text = name.encode()
    return file.read(min(length, _LENGTH.size + len(text))) == _LENGTH.pack(len(text)) + text


def _fits(file: IO[bytes], begin: int) -> bool:
    """Return whether an index (channel u16, u32 bytes of entries) or the data's end has its proper length."""
    opcode, length = _frame_at(file, begin) or (0, 0)
    if opcode == MESSAGE_INDEX:
        head = file.read(_INDEX.size)
        return len(head) == _INDEX.size and length == _INDEX.size + _INDEX.unpack(head)[1]
    return bool(opcode != DATA_END or length == 4)


def is_closed(file: IO[bytes]) -> bool:
    """Return whether the writer closed the file: it ends with a footer and the magic bytes."""
    size = file.seek(0, 2)
    footer = _frame_at(file, max(0, size - _FRAME.size - _FOOTER.size - len(MAGIC)))
    return footer == (FOOTER, _FOOTER.size) and file.read()[_FOOTER.size :] == MAGIC
