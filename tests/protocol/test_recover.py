"""Recovery of recordings that were cut short or damaged: all intact messages, nothing else, nothing changed."""

import platform
import shutil
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from cogrip.protocol.recording import recover as recover_module
from cogrip.protocol.recording.derived import DERIVED
from cogrip.protocol.recording.folder import recordings_of
from cogrip.protocol.recording.reader import MAGIC, RecordedMessage, Recording, RecordingError, open_recording
from cogrip.protocol.recording.records import Gap, kind_of
from cogrip.protocol.recording.recover import Recovered, recover
from cogrip.protocol.recording.writer import RecordingWriter
from cogrip.results.replay.verify import ReplayVerdict, verify

from tests.extent import every

RECORDINGS = Path(__file__).resolve().parents[1] / "recordings"
FILES = tuple(
    RECORDINGS / name
    for name in ("laboratory/client-anna.mcap", "laboratory/server.mcap", "live/client-ben.mcap", "live/server.mcap")
)


@dataclass(frozen=True)
class Chunk:
    """start, end: in the file, by its own index."""

    start: int
    end: int
    messages: tuple[RecordedMessage, ...]


def own(recording: Recording, messages: Iterable[RecordedMessage]) -> list[RecordedMessage]:
    """Return the messages but for those that are derived of others, which are made anew."""
    return [message for message in messages if kind_of(recording.topics[message.topic]) not in DERIVED]


def chunks_of(path: Path) -> list[Chunk]:
    """Return the chunks by the file's index, as the mcap package reads it."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    indices = sorted(summary.chunk_indexes, key=lambda index: index.chunk_start_offset)
    contents = [own(open_recording(path), chunk) for chunk in open_recording(path).chunks()]
    assert len(contents) == len(indices) > 2
    return [
        Chunk(index.chunk_start_offset, index.chunk_start_offset + index.chunk_length, tuple(content))
        for index, content in zip(indices, contents, strict=True)
    ]


CHUNKS = {path: chunks_of(path) for path in FILES}
files = st.sampled_from(FILES)


def messages_of(path: Path) -> list[RecordedMessage]:
    recording = open_recording(path)
    return own(recording, recording.messages())


def gaps_of(path: Path) -> list[tuple[int, Gap]]:
    """(time, gap) of every one in a file."""
    recording = open_recording(path)
    return [
        (message.time_ns, msgspec.json.decode(message.payload, type=Gap))
        for message in recording.messages()
        if kind_of(recording.topics[message.topic]) == "gap"
    ]


def joined(chunks: Sequence[Chunk]) -> list[RecordedMessage]:
    return [message for chunk in chunks for message in chunk.messages]


def played(path: Path) -> ReplayVerdict:
    """Return the verdict of a replay; skip files of other processors, whose last bits differ."""
    recording = open_recording(path)
    if recording.header.versions.machine != platform.machine():
        pytest.skip(f"recorded on {recording.header.versions.machine}, this is {platform.machine()}")
    return verify(recording)


def ticks_in(source: Path, messages: Sequence[RecordedMessage]) -> int:
    """Return the ticks of a client, or the steps of a server, those of deserted rooms too."""
    kinds = [kind_of(topic) for topic in open_recording(source).topics]
    inputs = [msgspec.json.decode(each.payload) for each in messages if kinds[each.topic] == "input"]
    idle: int = sum(msgspec.json.decode(each["value"])["steps"] for each in inputs if each["kind"] == "idle")
    return idle + sum(kinds[message.topic] in ("tick", "step") for message in messages)


def saved(source: Path, data: bytes, folder: Path) -> Recovered:
    """Recover these bytes under the source's name. They stay, and a whole file comes of them that says whether it was cut."""
    path = folder / source.name
    path.write_bytes(data)
    found = recover(path)
    assert path.read_bytes() == data
    assert found.path == folder / f"{source.stem}.recovered.mcap"
    recording = open_recording(found.path)
    messages = own(recording, recording.messages())
    assert recording.complete
    assert not recording.damage
    cut = len(data) < len(source.read_bytes()) or messages[-1:] != list(CHUNKS[source][-1].messages[-1:])
    assert recording.header == msgspec.structs.replace(open_recording(source).header, cut=cut)
    with found.path.open("rb") as file:  # and as the package that others read it with sees it
        summary = make_reader(file).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(list(recording.messages()))
    kept = [message for message in messages if kind_of(recording.topics[message.topic]) != "gap"]
    assert found.messages == len(kept)
    assert found.seconds == pytest.approx((kept[-1].time_ns - kept[0].time_ns) * 1e-9 if kept else 0.0, abs=1e-9)
    return found


def write(path: Path, recording: Recording, messages: Sequence[RecordedMessage], cut: bool | None) -> None:
    """Write a file with these messages of a recording; cut: whether it is closed as cut, None: it is not closed."""
    with path.open("wb") as file:
        writer = RecordingWriter(file, recording.header)
        for message in messages:
            writer.put(*message)
        if cut is None:
            writer.flush()
        else:
            writer.finish(cut)


# Cut off -------------------------------------------------------------------------------------------------------------


@settings(max_examples=60)
@given(source=files, where=st.floats(0.0, 1.0))
@example(source=FILES[0], where=0.0)
@example(source=FILES[0], where=1.0)
def test_of_a_file_that_was_cut_every_whole_chunk_is_saved(
    tmp_path_factory: pytest.TempPathFactory, source: Path, where: float
) -> None:
    data, chunks = source.read_bytes(), CHUNKS[source]
    cut = chunks[0].start + int(where * (len(data) - chunks[0].start))
    found = saved(source, data[:cut], tmp_path_factory.mktemp("cut"))
    expected = joined([chunk for chunk in chunks if chunk.end <= cut])
    assert messages_of(found.path) == expected
    lost = sum(damage.length for damage in found.damage)
    assert lost <= max(chunk.end - chunk.start for chunk in chunks)
    if found.damage:
        assert cut < len(data)
        assert [damage.reason for damage in found.damage] == ["the end is cut off"]


@settings(max_examples=25)
@given(source=files, where=st.floats(0.0, 1.0))
@example(source=FILES[0], where=1.0)
@example(source=FILES[1], where=1.0)
@example(source=FILES[2], where=1.0)
@example(source=FILES[3], where=1.0)
def test_it_plays_again_up_to_the_cut(tmp_path_factory: pytest.TempPathFactory, source: Path, where: float) -> None:
    """Every tick that is there, and that its end is missing is no difference."""
    data, chunks = source.read_bytes(), CHUNKS[source]
    cut = chunks[0].end + int(where * (len(data) - chunks[0].end))
    found = saved(source, data[:cut], tmp_path_factory.mktemp("cut"))
    verdict = played(found.path)
    messages = messages_of(found.path)
    assert (verdict.exact, verdict.difference, verdict.hole) == (True, None, None)
    assert verdict.cut == (cut < len(data))
    assert verdict.ticks == ticks_in(source, messages)


@pytest.mark.parametrize(
    ("source", "end"),
    every(5, [(source, end) for source in FILES for end in ("open", "recovered", "closed as cut")]),
    ids=lambda value: f"{value.parent.name}-{value.stem}" if isinstance(value, Path) else value,
)
def test_no_cut_is_a_difference(source: Path, tmp_path: Path, end: str) -> None:
    """At every place between two messages: outputs stand before the tick or step that they are of, or behind their input."""
    chunks = CHUNKS[source]
    recording, messages = open_recording(source), joined(chunks)
    kinds = [kind_of(recording.topics[message.topic]) for message in messages]
    outs = [place for place, kind in enumerate(kinds) if kind in ("datagram_out", "input", "event")]
    found = []
    for place in (*outs[:2], *outs[len(outs) // 2 :][:2], *outs[-2:]):
        path = tmp_path / f"{place}.mcap"
        write(path, recording, messages[: place + 1], cut=True if end == "closed as cut" else None)
        found.append(played(recover(path).path if end == "recovered" else path))
    assert [verdict.difference for verdict in found] == [None] * len(found)
    assert all(verdict.exact and verdict.cut for verdict in found)


def test_a_recording_whose_loop_was_killed_before_a_tick_was_recorded_says_that_it_is_cut(tmp_path: Path) -> None:
    """The datagram is there, the tick that sent it is not: taken for whole, that is a difference; closed as cut, it is none."""
    source = next(source for source in FILES if source.stem.startswith("client"))
    recording, messages = open_recording(source), joined(CHUNKS[source])
    kinds = [kind_of(recording.topics[message.topic]) for message in messages]
    place = max(place for place, kind in enumerate(kinds) if kind == "datagram_out" and "tick" in kinds[place:])
    found = {}
    for cut in (False, True):
        path = tmp_path / f"{cut}.mcap"
        write(path, recording, messages[: place + 1], cut)
        found[cut] = played(path)
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
        assert summary is not None
        assert [index.name for index in summary.metadata_indexes] == ["cogrip", "cogrip.cut"][: 1 + cut]
        assert summary.statistics is not None
        assert summary.statistics.metadata_count == 1 + cut
    assert (found[False].exact, found[False].cut) == (False, False)
    assert (found[True].exact, found[True].cut) == (True, True)
    again = recover(tmp_path / "True.mcap")
    assert open_recording(again.path).header.cut, "a copy of it says so too"


# Damaged in the middle -----------------------------------------------------------------------------------------------


@settings(max_examples=60)
@given(source=files, where=st.floats(0.0, 1.0), length=st.integers(1, 3000))
def test_of_a_damaged_file_every_chunk_that_was_not_touched_is_saved(
    tmp_path_factory: pytest.TempPathFactory, source: Path, where: float, length: int
) -> None:
    """Wherever the damage is, in contents, lengths or what stands between chunks: nothing foreign, and the gap is marked."""
    data, chunks = bytearray(source.read_bytes()), CHUNKS[source]
    first, last = chunks[0].start, chunks[-1].end
    at = first + int(where * (last - first - 1))
    until = min(at + length, last)
    data[at:until] = bytes(byte ^ 0xFF for byte in data[at:until])
    found = saved(source, bytes(data), tmp_path_factory.mktemp("damaged"))
    every = joined(chunks)
    recorded = set(every)
    messages = [message for message in messages_of(found.path) if message in recorded]
    kept = set(messages)
    assert messages == [message for message in every if message in kept], "in their order"
    assert kept >= set(joined([chunk for chunk in chunks if chunk.end <= at or chunk.start >= until]))
    assert found.messages == len(messages), "nothing that was never recorded"
    if len(messages) < len(every):
        assert found.damage
        assert any(damage.offset <= until and at <= damage.offset + damage.length for damage in found.damage)


def spoiled(source: Path, *numbers: int) -> bytes:
    """A file with these chunks damaged where their contents are."""
    data = bytearray(source.read_bytes())
    for number in numbers:
        chunk = CHUNKS[source][number]
        middle = (chunk.start + chunk.end) // 2
        data[middle : middle + 50] = bytes(50)
    return bytes(data)


HITS = [(source, hit) for source in FILES for hit in ((0,), (1,), (1, 3)) if hit[-1] + 1 < len(CHUNKS[source])]


@pytest.mark.parametrize(("source", "hit"), HITS, ids=lambda value: getattr(value, "stem", None))
def test_gaps_are_marked_where_they_are_and_replay_stops_at_the_first(
    source: Path, hit: tuple[int, ...], tmp_path: Path
) -> None:
    """A damaged beginning too costs one chunk alone: the topics are in the header."""
    chunks = CHUNKS[source]
    found = saved(source, spoiled(source, *hit), tmp_path)
    gaps = gaps_of(found.path)
    for number, (time_ns, gap), damage in zip(hit, gaps, found.damage, strict=True):
        chunk, before, after = chunks[number], chunks[number - 1] if number else None, chunks[number + 1]
        size = chunk.end - chunk.start
        assert gap.reason.startswith(f"{size} bytes of the recording were unreadable: damaged chunk")
        assert time_ns == after.messages[0].time_ns
        assert damage[:4] == (chunk.start, size, before and before.messages[-1].time_ns, time_ns)
    assert found.messages == len(joined([chunk for number, chunk in enumerate(chunks) if number not in hit]))
    assert messages_of(found.path)[: len(joined(chunks[: hit[0]]))] == joined(chunks[: hit[0]])
    if hit[0]:
        verdict = played(found.path)
        assert not verdict.exact
        assert (verdict.hole_ns, verdict.hole) == gaps[0]
        assert verdict.ticks == ticks_in(source, joined(chunks[: hit[0]]))


@pytest.mark.parametrize("source", [path for path in FILES if len(CHUNKS[path]) > 3], ids=lambda path: path.parent.name)
def test_damaged_and_cut(source: Path, tmp_path: Path) -> None:
    chunks = CHUNKS[source]
    found = saved(source, spoiled(source, 1)[: chunks[3].start + 100], tmp_path)
    assert found.messages == len(chunks[0].messages) + len(chunks[2].messages)
    assert [each.reason.partition(" (")[0] for each in found.damage] == ["damaged chunk", "the end is cut off"]


# Again, and nothing --------------------------------------------------------------------------------------------------


def test_what_was_recovered_is_not_recovered_over(tmp_path: Path) -> None:
    source = FILES[0]
    found = saved(source, source.read_bytes()[:40_000], tmp_path)
    before = found.path.read_bytes()
    with pytest.raises(FileExistsError):
        recover(tmp_path / source.name)
    assert found.path.read_bytes() == before
    assert {path.name for path in tmp_path.iterdir()} == {source.name, found.path.name}


def test_a_run_is_read_from_its_recovery(tmp_path: Path) -> None:
    for path in FILES[:2]:
        shutil.copy2(path, tmp_path)
    source = FILES[0]
    found = saved(source, source.read_bytes()[:40_000], tmp_path)
    assert recordings_of(tmp_path) == [found.path, tmp_path / "server.mcap"]
    assert recordings_of(tmp_path / source.name) == [tmp_path / source.name], "unless it is named itself"


@pytest.mark.parametrize(
    "data", [b"", b"RIFF of somebody else's, and long enough", MAGIC + b"\x01\x00", MAGIC + bytes(40)]
)
def test_of_what_is_no_recording_nothing_can_be_saved(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=r"is not a recording|nothing of it can be saved|no recording of cogrip's"):
        recover(path)
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_leaves_no_half_recovery(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = FILES[0]
    path = tmp_path / source.name
    path.write_bytes(source.read_bytes()[:-100])

    class FullDisk(RecordingWriter):
        def finish(self) -> None:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(recover_module, "RecordingWriter", FullDisk)
    with pytest.raises(OSError, match="No space left"):
        recover(path)
    assert recordings_of(tmp_path) == [path]
    assert list(tmp_path.iterdir()) == [path]
