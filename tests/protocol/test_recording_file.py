"""Recording files: written, read by this and other readers, cut anywhere, damaged anywhere, or no recording."""

import io
import json
import struct
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import msgspec
import pytest
import zstandard
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from cogrip.protocol.drawing import Shape
from cogrip.protocol.recording import reader
from cogrip.protocol.recording.header import CHECK, FORMAT, NAME, Header, checksum, versions_here
from cogrip.protocol.recording.reader import MOST_PACKED, RecordedMessage, Recording, RecordingError, open_recording
from cogrip.protocol.recording.records import KINDS, Record
from cogrip.protocol.recording.sink import encode, topics
from cogrip.protocol.recording.writer import RecordingWriter

from tests.extent import every
from tests.protocol.test_recording_schema import fits
from tests.protocol.valid_values import valid

EPOCH_NS = 1_700_000_000_123_456_789
KINDS_SMALL = ("event", "input")


def header(kinds: Sequence[str] = KINDS_SMALL, **changes: Any) -> Header:
    whole = Header(
        "client", "anna", '{"hello": "hand"}', 1024, 7, EPOCH_NS, False, versions_here(), topics("anna", kinds)
    )
    return msgspec.structs.replace(whole, **changes)


def written(
    header: Header,
    chunks: Sequence[Sequence[RecordedMessage]],
    kind: Callable[[io.BytesIO, Header], Any] = RecordingWriter,
) -> bytes:
    """A file with these chunks, or smaller ones where they are larger than a chunk may be."""
    stream = io.BytesIO()
    writer = kind(stream, header)
    for chunk in chunks:
        for message in chunk:
            writer.put(*message)
        writer.flush()
    writer.finish()
    return stream.getvalue()


class File(NamedTuple):
    """A file, what is in each of its chunks, and the bytes of each by an independent reader."""

    data: bytes
    content: list[list[RecordedMessage]]
    places: list[range]


def file_of(chunks: int, messages: int, seed: int) -> File:
    """Return a file in which no two messages have the same time."""
    chance = Random(seed)
    content = [
        [
            RecordedMessage(chance.randrange(2), 1000 * chunk + number, b'{"text":"%030x"}' % chance.getrandbits(120))
            for number in range(messages)
        ]
        for chunk in range(chunks)
    ]
    data = written(header(), content)
    indexes = make_reader(io.BytesIO(data)).get_summary().chunk_indexes
    return File(data, content, [range(at := each.chunk_start_offset, at + each.chunk_length) for each in indexes])


SMALL, LARGE = file_of(8, 4, seed=1), file_of(30, 16, seed=2)
FILES = {"small": SMALL, "large": LARGE}
HEADER_END = SMALL.places[0].start


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Path of a test's file; the next example overwrites it."""
    return tmp_path_factory.mktemp("recordings") / "client-anna.mcap"


def read(path: Path, data: bytes) -> tuple[Recording, list[RecordedMessage]]:
    path.write_bytes(data)
    recording = open_recording(path)
    return recording, list(recording.messages())


def read_or_refused(path: Path, data: bytes) -> tuple[Recording | None, list[RecordedMessage]]:
    """Return `read`; None where the file is refused with an error that names it."""
    path.write_bytes(data)
    try:
        recording = open_recording(path)
    except RecordingError as error:
        if str(path) not in str(error):
            raise
        return None, []
    return recording, list(recording.messages())


# -- written and read -------------------------------------------------------------------------------------------------


turned = Shape("capsule", (0.1, 0.2, 0.0), 3, (0.1, 0.0, -0.1), (0.5, -0.5, 0.5, 0.5), (1.0, 0.5, 0.0, 1.0), 1, True)
shapes = st.sampled_from([Shape("box", (0.1, 0.2, 0.3)), turned])


@st.composite
def messages(draw: st.DrawFn) -> list[tuple[str, int, Record]]:
    """Some records of any kind, as (kind, time, record)."""
    kinds = draw(st.lists(st.sampled_from(sorted(KINDS)), max_size=12))
    times = st.integers(0, 2**63 - 1 - EPOCH_NS)
    return [(kind, draw(times), draw(valid(KINDS[kind], {Shape: shapes}))) for kind in kinds]


@settings(max_examples=48)
@given(messages(), st.sets(st.integers(0, 12)))
def test_what_is_written_is_read_again_by_us_and_by_others(path, content, ends):
    """Messages of any kind and time, flushed anywhere: three readers agree, and every message fits its schema."""
    kinds = sorted(KINDS)
    put = [RecordedMessage(kinds.index(kind), time_ns, encode(record)) for kind, time_ns, record in content]
    borders = [0, *sorted(end for end in ends if end < len(put)), len(put)]
    head = header(kinds)
    data = written(head, [put[start:end] for start, end in pairwise(borders)])
    recording, found = read(path, data)
    assert found == put
    assert recording.complete
    assert not recording.damage
    assert recording.header == head
    for (kind, _, record), message in zip(content, found, strict=True):
        again = msgspec.json.decode(message.payload, type=KINDS[kind])
        assert encode(again) == encode(record), "typed, it is what it was"

    by_topic = [(head.topics[message.topic], message.time_ns + EPOCH_NS, message.payload) for message in put]
    streamed = list(StreamReader(io.BytesIO(data), validate_crcs=True).records)
    channels = {each.id: each for each in streamed if type(each).__name__ == "Channel"}
    theirs = [each for each in streamed if type(each).__name__ == "Message"]
    assert [(channels[each.channel_id].topic, each.log_time, each.data) for each in theirs] == by_topic
    indexed = list(make_reader(io.BytesIO(data), validate_crcs=True).iter_messages(log_time_order=False))
    assert sorted((channel.topic, each.log_time, each.data) for _, channel, each in indexed) == sorted(by_topic)
    for schema, channel, each in indexed:
        assert schema is not None
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        table = json.loads(schema.data)
        assert table["type"] == "object"
        assert fits(json.loads(each.data), table), (
            f"{channel.topic}: {each.data.decode()} is not {schema.data.decode()}"
        )


def test_a_follower_sees_what_was_flushed(path):
    """The newest of each topic; a chunk of which only a part is there is waited for."""
    path.write_bytes(SMALL.data[: SMALL.places[0].start])
    follower = reader.Follower(path)
    assert not follower.look()
    done: list[RecordedMessage] = []
    for chunk, place in zip(SMALL.content, SMALL.places, strict=True):
        path.write_bytes(SMALL.data[: place.stop - 1])
        assert follower.look() == newest(done)
        done += chunk
        path.write_bytes(SMALL.data[: place.stop])
        assert follower.look() == newest(done)
    path.write_bytes(SMALL.data)
    assert follower.look() == newest(done)


def newest(messages: Sequence[RecordedMessage]) -> dict[str, RecordedMessage]:
    return {header().topics[message.topic]: message for message in messages}


# -- cut --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FILES)
def test_a_file_cut_at_any_byte_gives_what_was_whole(path, name):
    """At any byte of header and first chunk of the small one, beside any border, and all over the rest.

    Only RecordingError is raised, and all of what was whole is there, and nothing else.
    """
    data, content, places = FILES[name]
    borders = {end + off for place in places for end in (place.start, place.stop) for off in (-1, 0, 1)}
    first = range(places[0].stop if name == "small" else 0)
    rest = range(places[1].start, len(data), 13 if name == "small" else len(data) // 500)
    for size in {*first, *borders, *rest, *range(len(data) - 30, len(data) + 1)}:
        whole = [chunk for chunk, place in zip(content, places, strict=True) if place.stop <= size]
        recording, found = read_or_refused(path, data[:size])
        if recording is None:
            assert size < places[0].start, f"{size} bytes hold the header, but it is refused"
            continue
        assert found == [message for chunk in whole for message in chunk]
        assert recording.complete == (size == len(data))
        for damage in recording.damage:
            assert damage.reason == "the end is cut off"
            assert damage.offset + damage.length == size
            assert (damage.from_ns, damage.to_ns) == (whole[-1][-1].time_ns if whole else None, None)
        if any(place.start < size < place.stop for place in places):
            assert len(recording.damage) == 1, "half a chunk is not passed over in silence"


# -- damaged ----------------------------------------------------------------------------------------------------------

Flips = dict[int, int]  # at which byte, by which bits


def flips(first: int, last: int, most: int = 6) -> st.SearchStrategy[Flips]:
    return st.dictionaries(st.integers(first, last - 1), st.integers(1, 255), min_size=1, max_size=most)


def flipped(data: bytes, flips: Flips) -> bytes:
    damaged = bytearray(data)
    for at, bits in flips.items():
        damaged[at] ^= bits
    return bytes(damaged)


def check_damage(path: Path, file: File, flips: Flips) -> None:
    """Nothing is raised; nothing is wrong; nothing is missing but what was hit; what is missing is named with its time."""
    recording, found = read(path, flipped(file.data, flips))
    original = [message for chunk in file.content for message in chunk]
    given_times = [message.time_ns for message in found]
    assert given_times == sorted(set(given_times)), "in the order of the file, none twice"
    there = set(found)
    assert there <= set(original)
    hit = {number for number, place in enumerate(file.places) if any(at in place for at in flips)}
    for number, chunk in enumerate(file.content):
        if number not in hit:
            assert there.issuperset(chunk), f"chunk {number} was not hit, but is not there"
        missing = [message.time_ns for message in chunk if message not in there]
        if missing:
            assert any(
                (damage.from_ns is None or damage.from_ns < missing[0])
                and (damage.to_ns is None or missing[-1] < damage.to_ns)
                for damage in recording.damage
            ), f"chunk {number} is missing, but the damage named is {recording.damage}"
    for damage in recording.damage:
        assert 0 < damage.offset < len(file.data)
        assert damage.offset + damage.length <= len(file.data)
        assert damage.from_ns is None or damage.to_ns is None or damage.from_ns < damage.to_ns


damages = st.one_of(
    st.tuples(st.just("small"), flips(HEADER_END, len(SMALL.data))),
    st.tuples(st.just("large"), flips(LARGE.places[0].start, len(LARGE.data), most=12)),
)


@settings(max_examples=1500)
@given(damages)
def test_flipped_bytes_cost_only_the_chunks_that_they_hit(path, damage):
    name, flips = damage
    check_damage(path, FILES[name], flips)


@pytest.mark.sample(1)
@pytest.mark.parametrize("bits", every(4, [0x01, 0x02, 0x04, 0x08, 0x10, 0x20, 0x40, 0x80, 0xFF]))
def test_every_byte_of_one_chunk_and_its_index_flipped_costs_at_most_that_chunk(path, bits):
    """Its length, its checksum, the length of its index: reading goes on at the next chunk."""
    for at in range(SMALL.places[3].start, SMALL.places[4].start):
        check_damage(path, SMALL, {at: bits})


@pytest.mark.parametrize("size", [0, 1, 2**16, 2**31, 2**40, 2**63, 2**64 - 1])
def test_a_chunk_that_says_it_is_of_any_size_costs_no_more_than_itself(path, size):
    """The size is set in the record, in its frame and in the compressed data's own frame header."""
    place = SMALL.places[3]
    data = place.start + 9 + 28 + 8 + 8
    assert SMALL.data[data : data + 4] == b"\x28\xb5\x2f\xfd", "a zstd frame begins here"
    number = size.to_bytes(8, "little")  # behind 0xE0 in zstd's frame: a single segment with its size in eight bytes
    for at, new in (*((place.start + at, number) for at in (1, 25, 45)), (data + 4, b"\xe0" + number)):
        check_damage(path, SMALL, {at + n: SMALL.data[at + n] ^ byte for n, byte in enumerate(new)})


@settings(max_examples=1000)
@given(flips(0, HEADER_END))
@example({HEADER_END - 1: 1})
def test_a_damaged_header_is_refused_or_changes_nothing(path, flips):
    """Topics, epoch and settings stand there: a message must not be given another topic or another time."""
    recording, found = read_or_refused(path, flipped(SMALL.data, flips))
    if recording is None:
        return
    assert recording.header == header()
    assert found == [message for chunk in SMALL.content for message in chunk]


def test_a_hole_in_the_middle_is_named_by_its_time(path):
    """64 bytes of a chunk overwritten, and a whole disk block of zeros."""
    place = LARGE.places[20]
    for hole in (range(place.start + 100, place.start + 164), range(place.start + 50, place.start + 50 + 4096)):
        data = bytearray(LARGE.data)
        data[hole.start : hole.stop] = bytes(len(hole))
        recording, found = read(path, bytes(data))
        lost = {number for number, each in enumerate(LARGE.places) if each.start < hole.stop and each.stop > hole.start}
        assert found == [
            message for number, chunk in enumerate(LARGE.content) if number not in lost for message in chunk
        ]
        span = LARGE.content[19][-1].time_ns, LARGE.content[max(lost) + 1][0].time_ns
        assert {(damage.from_ns, damage.to_ns) for damage in recording.damage} == {span}


@given(st.binary(max_size=400))
@example(SMALL.data[:8])
def test_garbage_after_the_header_is_no_message(path, garbage):
    recording, found = read(path, SMALL.data[:HEADER_END] + garbage)
    assert not found
    assert not recording.complete


# -- not a recording --------------------------------------------------------------------------------------------------


def foreign(write: Callable[[Writer], None]) -> bytes:
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start()
    write(writer)
    writer.finish()
    return stream.getvalue()


def with_metadata(**changes: str | None) -> bytes:
    """A file of ours whose metadata was changed."""
    table: dict[str, str | None] = {**header().metadata(), **changes}
    kept = {key: value for key, value in table.items() if value is not None}
    return foreign(lambda writer: writer.add_metadata(NAME, kept))


NEWER = str(FORMAT + 1)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "not a recording"),
        (b"time_s,x_m\n0,0\n", "not a recording"),
        (SMALL.data[:7], "not a recording"),
        (SMALL.data[:8], "ends before it says what it is"),
        (SMALL.data[:40], "nothing of it can be saved"),
        (SMALL.data[: HEADER_END - 20], "nothing of it can be saved"),
        (foreign(lambda writer: None), "no recording of cogrip's"),
        (foreign(lambda writer: writer.add_attachment(0, 0, "a", "b", b"c") and None), "no recording of cogrip's"),
        (foreign(lambda writer: writer.add_metadata("rosbag", {"distro": "x"})), "header is not cogrip's"),
        (with_metadata(format=NEWER), f"format {NEWER}, newer than {FORMAT}"),
        (with_metadata(format=NEWER, topics=None, role=None, more="{}"), f"format {NEWER}, newer than {FORMAT}"),
        (with_metadata(format="soon"), "header is not cogrip's"),
        (with_metadata(epoch_ns="1e400"), "header is not cogrip's"),
        (with_metadata(versions="[]"), "header is not cogrip's"),
        (with_metadata(topics="{}"), "header is not cogrip's"),
        (with_metadata(topics=None), "header is not cogrip's"),
    ],
)  # fmt: skip
def test_what_is_no_recording_is_refused_with_the_reason(path, data, words):
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=words) as raised:
        open_recording(path)
    assert str(path) in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_file_that_is_not_there_is_not_called_damaged(tmp_path):
    with pytest.raises(FileNotFoundError):
        open_recording(tmp_path / "nothing.mcap")


@given(st.binary(max_size=200))
def test_any_bytes_are_a_recording_or_are_refused(path, data):
    path.write_bytes(SMALL.data[:8] + data)
    with pytest.raises(RecordingError):
        open_recording(path)


@pytest.mark.parametrize(("unpacked", "chunks"), [(1 << 20, 200), (60 << 20, 40)])
def test_chunks_that_unpack_to_far_more_than_was_ever_written_are_not_opened(path, unpacked, chunks, monkeypatch):
    """Work is counted: bytes that are unpacked, for each of the file. The chunks hold empty records, packed to nothing."""
    packed = zstandard.compress(bytes(unpacked))
    body = struct.pack("<QQQII4sQ", 0, 0, unpacked, 0, 4, b"zstd", len(packed)) + packed
    whole = written(header(), [])
    data = whole[:HEADER_END] + (struct.pack("<BQ", 6, len(body)) + body) * chunks + whole[HEADER_END:]
    taken = []
    whole = zstandard.decompress
    monkeypatch.setattr(zstandard, "decompress", lambda packed: taken.append(len(out := whole(packed))) or out)
    recording, found = read(path, data)
    assert sum(taken) <= MOST_PACKED * len(data)
    assert found == []
    assert len(recording.damage) == chunks
    most = min(reader.MOST_CHUNK_BYTES, MOST_PACKED * (recording.damage[0].length - 9))
    assert f"bytes that say they hold {unpacked}, and {most} is the most that is opened" in recording.damage[0].reason


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rate_hz": "0"}, "rate_hz"),
        ({"rate_hz": "1e308"}, "rate_hz"),
        ({"rate_hz": "20001"}, "rate_hz"),
        ({"epoch_ns": "9223372036854775808"}, "epoch_ns"),
        ({"who": "anna\x1b[2J"}, "its who holds control characters"),
        ({"room": "lab\u202e"}, "its room holds control characters"),
        ({"start": "[" * 200_000 + "]" * 200_000}, "its start is nested too deep"),
    ],
)
def test_a_header_that_no_session_has_is_refused(path, changes, words):
    texts = {key: value for key, value in header().metadata().items() if key != CHECK} | changes
    path.write_bytes(foreign(lambda writer: writer.add_metadata(NAME, {**texts, CHECK: checksum(texts)})))
    with pytest.raises(RecordingError) as refused:
        open_recording(path)
    assert words in str(refused.value)
    assert str(refused.value).isprintable()
