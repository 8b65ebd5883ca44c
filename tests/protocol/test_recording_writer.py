"""The writer of recordings: its files are those of the `mcap` library, byte for byte, and its memory does not grow."""

import gc
import io
import resource
import sys
import tempfile
from functools import partial
from itertools import pairwise
from pathlib import Path
from types import FunctionType, ModuleType

import pytest
import zstandard
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from cogrip.protocol.io import recording_process
from cogrip.protocol.io.recording_process import WholePieces
from cogrip.protocol.recording import summary as summary_module
from cogrip.protocol.recording.header import NAME, Header
from cogrip.protocol.recording.reader import RecordedMessage, Recording, open_recording
from cogrip.protocol.recording.records import KINDS, kind_of
from cogrip.protocol.recording.schema import json_schema
from cogrip.protocol.recording.summary import HELD_BYTES, Spool
from cogrip.protocol.recording.writer import CHUNK_BYTES, LEVEL, LIBRARY, RecordingWriter

from tests.protocol.test_recording_file import EPOCH_NS, header, written

THREE = ("event", "input", "tick")


@pytest.fixture(autouse=True, scope="module")
def same_level():
    """Let the library compress as we do: it takes no level."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(zstandard, "compress", partial(zstandard.compress, level=LEVEL))
        yield


class LibraryWriter:
    """The same by the library's own writer."""

    def __init__(self, stream: io.BytesIO, header: Header) -> None:
        self.writer = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._epoch_ns = header.epoch_ns
        self.flush, self.finish = self.writer.flush, self.writer.finish
        self.writer.start(library=LIBRARY)
        self.writer.add_metadata(NAME, header.metadata())
        schemas: dict[str, int] = {}
        self._channels = []
        for topic in header.topics:
            name = KINDS[kind_of(topic)].__name__
            if name not in schemas:
                data = json_schema(KINDS[kind_of(topic)])
                schemas[name] = self.writer.register_schema(f"cogrip.{name}", "jsonschema", data)
            self._channels.append(self.writer.register_channel(topic, "json", schemas[name]))

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        log_time = time_ns + self._epoch_ns
        self.writer.add_message(self._channels[topic], log_time, payload, log_time)


# -- byte for byte ----------------------------------------------------------------------------------------------------

long_payloads = st.builds(lambda text, times: text * times, st.binary(min_size=1, max_size=3), st.integers(0, 40_000))
payloads = st.one_of(st.binary(max_size=60), long_payloads)
some_messages = st.lists(
    st.builds(RecordedMessage, st.integers(0, 2), st.integers(-EPOCH_NS, 2**63 - 1 - EPOCH_NS), payloads), max_size=30
)


@settings(max_examples=100)
@given(some_messages, st.sets(st.integers(0, 30)), st.integers(1, 400))
@example([], {0}, 1)
@example([RecordedMessage(0, 0, b"")], {0, 1}, 1)
@example(
    [
        RecordedMessage(0, 0, b""),
        *[RecordedMessage(0, 1, bytes(CHUNK_BYTES // 2 - 31))] * 2,
        RecordedMessage(0, 1, b""),
    ],
    {1},
    1,
)
@example([RecordedMessage(2, -EPOCH_NS, b"x" * CHUNK_BYTES), RecordedMessage(1, 5, b"")], set(), 1)
def test_a_file_is_what_the_library_would_write(content, ends, held_bytes):
    """Whatever is written and wherever it is flushed, and however early what is kept goes to its file."""
    borders = [0, *sorted(end for end in ends if end < len(content)), len(content)]
    chunks = [content[start:end] for start, end in pairwise(borders)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(summary_module, "HELD_BYTES", held_bytes)
        assert written(header(THREE), chunks) == written(header(THREE), chunks, LibraryWriter)


@pytest.mark.parametrize("kinds", [(), ("event",), ("datagram_in", "datagram_out"), tuple(KINDS)])
def test_topics_of_one_kind_share_a_schema_as_the_library_has_it(kinds):
    chunks = [[RecordedMessage(number, number, b"{}")] for number in range(len(kinds))]
    assert written(header(kinds), chunks) == written(header(kinds), chunks, LibraryWriter)


def test_a_topic_that_is_not_in_the_header_is_refused():
    writer = RecordingWriter(io.BytesIO(), header(("event",)))
    writer.put(0, 0, b"{}")
    with pytest.raises(IndexError):
        writer.put(1, 0, b"{}")


# -- a long recording -------------------------------------------------------------------------------------------------

CHUNKS = 1500
"""Two and a half minutes of a live session: enough for the index to leave memory twice."""


def fill(writer: RecordingWriter | LibraryWriter, first: int, last: int) -> None:
    for number in range(first, last):
        for topic in range(3):
            writer.put(topic, 10**8 * number + topic, b'{"tick":%d}' % number)
        writer.flush()


def size_of(root: object, *apart: object) -> int:
    """Bytes of an object and of all that it holds, without `apart`; code and modules are no part of it."""
    seen = {id(each) for each in apart}
    waiting, total = [root], 0
    while waiting:
        each = waiting.pop()
        if id(each) in seen or isinstance(each, type | ModuleType | FunctionType):
            continue
        seen.add(id(each))
        total += sys.getsizeof(each)
        waiting += gc.get_referents(each)
    return total


def growth(kind: type[RecordingWriter] | type[LibraryWriter]) -> float:
    """Bytes that a writer keeps for each further chunk."""
    stream = io.BytesIO()
    writer = kind(stream, header(THREE))
    fill(writer, 0, CHUNKS)
    before = size_of(writer, stream)
    fill(writer, CHUNKS, 2 * CHUNKS)
    after = size_of(writer, stream)
    writer.finish()
    return (after - before) / CHUNKS


def test_what_a_writer_keeps_does_not_grow_with_the_chunks():
    """But for what is waiting to be let go: at most HELD_BYTES, with what a `bytearray` has in reserve.

    The library's keeps every chunk: the reason for a writer of our own, and the measure sees what grows.
    """
    assert abs(growth(RecordingWriter)) * CHUNKS <= 1.2 * HELD_BYTES
    assert growth(LibraryWriter) > 300.0


class Noting(io.BytesIO):
    """Notes the largest piece that is written."""

    largest = 0

    def write(self, data: bytes) -> int:  # type: ignore[override]
        self.largest = max(self.largest, len(data))
        return super().write(data)


def test_the_end_of_a_long_recording_is_written_piece_by_piece():
    stream = Noting()
    writer = RecordingWriter(stream, header(THREE))
    fill(writer, 0, CHUNKS)
    before, stream.largest = stream.tell(), 0
    writer.finish()
    assert stream.tell() - before > 2 * HELD_BYTES
    assert 0 < stream.largest <= HELD_BYTES


def test_a_long_recording_is_opened_by_those_who_seek(tmp_path):
    path = tmp_path / "client-anna.mcap"
    with path.open("wb") as file:
        writer = RecordingWriter(file, header(THREE), tmp_path)
        fill(writer, 0, CHUNKS)
        assert list(tmp_path.iterdir()) == [path], "what is kept meanwhile has no name: a killed process leaves nothing"
        writer.finish()
    assert list(tmp_path.iterdir()) == [path]
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert len(summary.chunk_indexes) == summary.statistics.chunk_count == CHUNKS
        assert summary.statistics.channel_message_counts == {1: CHUNKS, 2: CHUNKS, 3: CHUNKS}
        start = EPOCH_NS + 10**8 * 700
        found = [
            (each.log_time - EPOCH_NS, each.data)
            for _, _, each in reader.iter_messages("/anna/input", starting_at=start, ending_before=start + 10**9)
        ]
    assert found == [(10**8 * number + 1, b'{"tick":%d}' % number) for number in range(700, 710)]
    recording = open_recording(path)
    assert recording.last_ns() == 10**8 * (CHUNKS - 1) + 2
    assert sum(1 for _ in recording.messages()) == 3 * CHUNKS
    assert recording.complete
    assert not recording.damage


def test_a_long_recording_cut_in_its_summary_loses_nothing_but_that(tmp_path):
    """Killed while it wrote the end: every message is there, and it is known not to be closed."""
    stream = io.BytesIO()
    writer = RecordingWriter(stream, header(THREE))
    fill(writer, 0, CHUNKS)
    data_end = stream.tell()
    writer.finish()
    data, path = stream.getvalue(), tmp_path / "client-anna.mcap"
    for size in (data_end, data_end + 13, (data_end + len(data)) // 2, len(data) - 1):
        path.write_bytes(data[:size])
        recording = Recording(path, header(THREE))
        assert sum(1 for _ in recording.messages()) == 3 * CHUNKS
        assert not recording.complete


# -- what is kept -----------------------------------------------------------------------------------------------------


@given(st.lists(st.binary(max_size=50)), st.integers(1, 100))
def test_a_spool_gives_back_what_it_was_given(records, held_bytes):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(summary_module, "HELD_BYTES", held_bytes)
        spool = Spool(None)
        for record in records:
            spool.append(record)
            assert spool.held_bytes <= held_bytes
        pieces = list(spool.pieces())
        assert b"".join(pieces) == b"".join(records)
        assert max(map(len, pieces)) <= held_bytes
        assert spool.length == sum(map(len, records))
        spool.close()


def test_what_fits_in_memory_makes_no_file_one_byte_more_makes_one_and_where_the_folder_is_gone_it_lies_elsewhere(
    tmp_path,
):
    for folder in (tmp_path, tmp_path / "not there", None):
        spool = Spool(folder)
        spool.append(bytes(HELD_BYTES))
        assert spool.held_bytes == spool.length
        assert list(spool.pieces()) == [bytes(HELD_BYTES)]
        spool.append(b"x")
        assert spool.held_bytes == 0
        assert b"".join(spool.pieces()) == bytes(HELD_BYTES) + b"x"
        spool.append(b"y")
        assert b"".join(spool.pieces()) == bytes(HELD_BYTES) + b"xy", "it goes on where it was"
        assert not list(tmp_path.iterdir())
        spool.close()


def test_a_spool_without_a_place_keeps_all_and_goes_there_when_it_can(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "no temporary files"))
    spool, rest = Spool(tmp_path / "not there"), b""
    for number in range(10):
        spool.append(bytes([number]) * (HELD_BYTES // 2))
        rest += bytes([number]) * (HELD_BYTES // 2)
    assert spool.held_bytes == spool.length
    assert spool.held_bytes == len(rest)
    pieces = list(spool.pieces())
    assert b"".join(pieces) == rest
    assert max(map(len, pieces)) <= HELD_BYTES
    (tmp_path / "not there").mkdir()
    for number in range(3):  # HELD_BYTES and one half: it was tried with the last but one
        spool.append(bytes([number]) * (HELD_BYTES // 2))
        rest += bytes([number]) * (HELD_BYTES // 2)
    assert spool.held_bytes < HELD_BYTES, "one try took all"
    assert b"".join(spool.pieces()) == rest
    spool.close()


def test_half_a_write_to_a_full_spool_is_taken_back(tmp_path):
    """A file may have three pieces and a half; then it may have more."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    spool, rest = Spool(tmp_path), b""
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (7 * HELD_BYTES // 2, limits[1]))
        for number in range(12):
            spool.append(bytes([number]) * (HELD_BYTES // 2 + 1))
            rest += bytes([number]) * (HELD_BYTES // 2 + 1)
        assert len(rest) - spool.held_bytes == 3 * HELD_BYTES + 6
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    spool.append(bytes(HELD_BYTES + 1))
    assert spool.held_bytes == 0
    assert b"".join(spool.pieces()) == rest + bytes(HELD_BYTES + 1)
    spool.close()


# -- on the way to the disk -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Path of a test's file; the next example overwrites it."""
    return tmp_path_factory.mktemp("pieces") / "file"


MOST = 40  # instead of MOST_HELD_BYTES


@settings(max_examples=60)
@given(st.lists(st.one_of(st.none(), st.integers(0, MOST + 1)), max_size=12))
@example([MOST - 1, None])
@example([MOST - 1, 1])
@example([MOST, 1])
def test_what_waits_for_the_disk_is_bounded_and_goes_there_whole(path, sizes):
    """None: a flush. What is written at once reaches the file at once, or not at all."""
    with path.open("wb", buffering=0) as file, pytest.MonkeyPatch.context() as patch:
        patch.setattr(recording_process, "MOST_HELD_BYTES", MOST)
        stream = WholePieces(file.fileno())
        put, ends = 0, {0}
        for size in sizes:
            if size is None:
                stream.flush()
                assert path.stat().st_size == put
            else:
                assert stream.write(bytes(size)) == size
                put += size
                ends.add(put)
            assert stream.tell() == put
            assert path.stat().st_size in ends
            assert put - path.stat().st_size < MOST
