"""Traces of a run's recordings: every column as recorded, on one clock, and a note on everything that is missing."""

import re
from pathlib import Path

import msgspec
import numpy as np
import pytest

from cogrip.client.recorder import client_topics, start_text
from cogrip.devices.registry import make
from cogrip.protocol.recording.header import Header, versions_here
from cogrip.protocol.recording.reader import RecordingError, open_recording
from cogrip.protocol.recording.records import Gap, Step, Tick
from cogrip.protocol.recording.sink import encode
from cogrip.protocol.session import make_hello
from cogrip.protocol.settings import resolve
from cogrip.server.recorder import WHO, server_topics, step_topic
from cogrip.server.recorder import start_text as server_start_text
from cogrip.sim.runs.folder import SERVER_RECORDING, client_recording
from cogrip.sim.runs.traces import load_run

from tests.extent import every
from tests.recording_files import rewrite, written
from tests.sim.reported_runs import spoil_chunk, text_of


def test_trace_columns_are_those_of_the_run(folder: Path) -> None:
    run = load_run(folder)
    trace = run.clients["anna"]
    assert (trace.who, trace.rate_hz, trace.rows, run.notes) == ("anna", 1024, 2048, ())
    assert trace.columns["position_m"].shape == (2048, 1)
    assert np.array_equal(trace.columns["tick"], np.arange(2048.0))
    assert trace.time_s == pytest.approx(np.arange(2048) / 1024, abs=1e-9)
    with pytest.raises(KeyError):
        trace.columns["nonsense"]
    recording = open_recording(folder / client_recording("anna"))
    topic = client_topics("anna").index("/anna/tick")
    ticks = [msgspec.json.decode(each.payload, type=Tick) for each in recording.messages() if each.topic == topic]
    for name in ("position_m", "velocity_mps", "force_n", "wave_up", "wave_down"):
        assert trace.columns[name].tolist() == [list(getattr(tick, name)) for tick in ticks]


@pytest.mark.parametrize("part", every(3, (0.6, 0.3, 0.95)))
def test_recording_that_is_cut_short_gives_what_is_whole(folder: Path, part: float) -> None:
    path = folder / client_recording("ben")
    whole = load_run(folder).clients["ben"].columns["time_s"]
    body = path.read_bytes()
    path.write_bytes(body[: round(part * len(body))])
    run = load_run(folder)
    trace = run.clients["ben"]
    assert 0 < trace.rows < 2048
    assert np.array_equal(trace.columns["time_s"], whole[: trace.rows])
    (note,) = run.notes
    assert re.fullmatch(r"client-ben\.mcap: the end is cut off \(\d+ bytes at \d+\)\.", note)
    assert note in text_of(folder)


@pytest.mark.long
def test_recording_with_a_damaged_chunk_gives_the_rest_and_names_the_gap(folder: Path) -> None:
    path = folder / client_recording("ben")
    whole = load_run(folder).clients["ben"].columns["time_s"]
    spoil_chunk(path, 1)
    run = load_run(folder)
    kept = run.clients["ben"].columns["time_s"]
    lost = np.setdiff1d(whole, kept)
    assert kept.size > 1000
    assert 0 < lost.size < 1000
    assert np.all(np.isin(kept, whole))
    (note,) = run.notes
    said = re.match(r"client-ben\.mcap: damaged chunk \(.*\), from (\S+) s to (\S+) s \(\d+ bytes at \d+\)", note)
    assert said, note
    assert float(said[1]) - 1e-3 <= lost.min() <= lost.max() <= float(said[2]) + 1e-3
    assert np.array_equal(lost, whole[(whole >= lost.min()) & (whole <= lost.max())]), "only this one chunk is missing"
    assert note in text_of(folder)


@pytest.mark.parametrize(("size", "words"), [(0, "is not a"), (400, "ends before")])
def test_recording_without_a_whole_header_is_left_out(folder: Path, size: int, words: str) -> None:
    path = folder / client_recording("ben")
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(RecordingError, match=rf"client-ben\.mcap {words}"):
        open_recording(path)
    run = load_run(folder)
    assert set(run.clients) == {"anna"}
    assert any(f"client-ben.mcap {words}" in note for note in run.notes)


def test_recording_without_ticks_is_said(folder: Path) -> None:
    rewrite(folder / client_recording("ben"), lambda kind, message: None if kind == "tick" else message.payload)
    run = load_run(folder)
    assert set(run.clients) == {"anna"}
    (note,) = run.notes
    assert "client-ben.mcap" in note
    assert "is not here" not in note, "it is here"


SHORT = resolve({"name": "short", "users": [{"name": "anna"}]})


def _client_header(who: str) -> Header:
    hello = make_hello(software="x", nonce=1, room="", name=who, digest="", device="sim", axes=1, rate_hz=1024.0)
    start = start_text(hello, make("sim:phantom", axes=1).capability)
    return Header("client", who, start, 10, 1, 0, False, versions_here(), client_topics(who))


def _tick(number: int) -> Tick:
    one = (float(number),)
    return Tick(
        tick=number, late_us=0, work_us=0, position_m=one, velocity_mps=one, force_n=one, work_j=0.0, port_j=0.0,
        wave_up=one, wave_down=one, object_m=one,
    )  # fmt: skip


def _person(folder: Path, who: str, start_ns: int) -> None:
    """Write two seconds of a client of ten ticks a second."""
    with written(folder / client_recording(who), _client_header(who)) as writer:
        for number in range(20):
            writer.put(0, start_ns + number * 100_000_000, encode(_tick(number)))


def _server(folder: Path, start_ns: int) -> None:
    topics = server_topics([SHORT.name])
    header = Header("server", WHO, server_start_text([SHORT], "x"), 10, 1, 0, False, versions_here(), topics)
    with written(folder / SERVER_RECORDING, header) as writer:
        for number in range(20):
            step = Step(number, (0.0,), (0.0,), ())
            writer.put(topics.index(step_topic(SHORT.name)), start_ns + number * 100_000_000, encode(step))


def test_messages_that_were_not_recorded_are_counted_where_they_are_missing(tmp_path: Path) -> None:
    gap = client_topics("anna").index("/anna/gap")
    with written(tmp_path / client_recording("anna"), _client_header("anna")) as writer:
        for number in [*range(20), *range(40, 50)]:
            if number == 40:
                writer.put(gap, 4_000_000_000, encode(Gap(20, "the ring was full")))
            writer.put(0, number * 100_000_000, encode(_tick(number)))
    run = load_run(tmp_path)
    trace = run.clients["anna"]
    assert trace.rows == 30
    assert trace.columns["position_m"][:, 0].tolist() == [float(number) for number in [*range(20), *range(40, 50)]]
    assert trace.time_s == pytest.approx([number * 0.1 for number in [*range(20), *range(40, 50)]])
    (note,) = [note for note in run.notes if note.startswith("client-anna.mcap")]
    assert "20 messages were not recorded" in note


def test_recordings_of_one_clock_begin_with_the_first_client(tmp_path: Path) -> None:
    """A server may have been up before; its trace then begins before zero."""
    _person(tmp_path, "anna", 10_000_000_000)
    _person(tmp_path, "ben", 10_500_000_000)
    _server(tmp_path, 9_000_000_000)
    run = load_run(tmp_path)
    first = [run.clients["anna"].time_s[0], run.clients["ben"].time_s[0], run.room.time_s[0]]
    assert first == pytest.approx([0.0, 0.5, -1.0])


def test_recordings_of_other_clocks_keep_their_own_zero_and_it_is_said(tmp_path: Path) -> None:
    """Two machines' files in one folder that `cogrip merge` did not make: their steady clocks have nothing in common."""
    _person(tmp_path, "anna", 10_000_000_000)
    _server(tmp_path, 9_000_000_000_000)
    run = load_run(tmp_path)
    assert run.room.time_s[0] == run.clients["anna"].time_s[0] == 0.0
    assert any("clock" in note and "cogrip merge" in note for note in run.notes)


@pytest.mark.parametrize(
    "strange",
    [b"{}", b"7", b'{"tick":"one"}', encode(msgspec.structs.replace(_tick(0), force_n=(1.0, 2.0)))],
    ids=["no fields", "no record", "another kind", "another number of axes"],
)
def test_recording_of_other_records_is_said(folder: Path, strange: bytes) -> None:
    """Whole chunks, but not what this version writes."""
    number = iter(range(10_000))
    rewrite(
        folder / client_recording("ben"),
        lambda kind, message: strange if kind == "tick" and next(number) == 100 else message.payload,
    )
    assert "client-ben.mcap" in text_of(folder)
