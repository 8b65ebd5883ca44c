"""Traces of a run's recordings: every column as recorded, on one clock, and a note on everything that is missing."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

from cogrip.client.recorder import client_topics
from cogrip.protocol.recording.reader import RecordingError, open_recording
from cogrip.protocol.recording.records import Gap, Tick, kind_of
from cogrip.protocol.recording.sink import encode
from cogrip.results.reading.folder import SERVER_RECORDING, client_recording, write_warnings
from cogrip.results.reading.traces import load_run

from tests.extent import every
from tests.recording_files import rewrite, written
from tests.results.reported_runs import spoil_chunk, text_of


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


def test_messages_that_were_not_recorded_are_counted_where_they_are_missing(folder: Path) -> None:
    path = folder / client_recording("anna")
    recording = open_recording(path)
    kinds = [kind_of(topic) for topic in recording.topics]
    ticks = [message for message in recording.messages() if kinds[message.topic] == "tick"]
    with written(path, recording.header) as writer:
        for message in ticks[:20]:
            writer.put(*message)
        writer.put(kinds.index("gap"), ticks[40].time_ns, encode(Gap(20, "the ring was full")))
        for message in ticks[40:]:
            writer.put(*message)
    run = load_run(folder)
    kept = [*range(20), *range(40, 2048)]
    assert run.clients["anna"].columns["tick"].tolist() == kept
    assert run.clients["anna"].time_s == pytest.approx(np.array(kept) / 1024)
    (note,) = [note for note in run.notes if note.startswith("client-anna.mcap")]
    assert "20 messages were not recorded" in note


def test_recordings_of_one_clock_begin_with_the_first_client(folder: Path) -> None:
    """A server may have been up before; its trace then begins before zero."""
    before = load_run(folder).room.time_s[0]
    rewrite(folder / client_recording("anna"), late_ns=1_000_000_000)
    rewrite(folder / client_recording("ben"), late_ns=1_500_000_000)
    run = load_run(folder)
    first = [run.clients["anna"].time_s[0], run.clients["ben"].time_s[0], run.room.time_s[0]]
    assert first == pytest.approx([0.0, 0.5, before - 1.0])


def test_recordings_of_other_clocks_keep_their_own_zero_and_it_is_said(folder: Path) -> None:
    """Two machines' files in one folder that `cogrip merge` did not make: their steady clocks have nothing in common."""
    for name in (client_recording("anna"), client_recording("ben")):
        rewrite(folder / name, virtual=False)
    rewrite(folder / SERVER_RECORDING, late_ns=9_000_000_000_000, virtual=False)
    run = load_run(folder)
    assert run.room.time_s[0] == run.clients["anna"].time_s[0] == 0.0
    assert any("clock" in note and "cogrip merge" in note for note in run.notes)


@pytest.mark.parametrize(
    "strange",
    [
        lambda _: b"{}",
        lambda _: b"7",
        lambda _: b'{"tick":"one"}',
        lambda payload: encode(msgspec.json.decode(payload) | {"force_n": (1.0, 2.0)}),
    ],
    ids=["no fields", "no record", "another kind", "another number of axes"],
)
def test_recording_of_other_records_is_said(folder: Path, strange: Callable[[bytes], bytes]) -> None:
    """Whole chunks, but not what this version writes."""
    number = iter(range(10_000))
    rewrite(
        folder / client_recording("ben"),
        lambda kind, message: strange(message.payload) if kind == "tick" and next(number) == 100 else message.payload,
    )
    assert "client-ben.mcap" in text_of(folder)


def test_notes_have_what_a_clients_log_warned_of(folder: Path, tmp_path: Path) -> None:
    run = Path(shutil.copytree(folder, tmp_path / "logged"))
    lines = ["ben holds cube", "warning: K is \x1b[2Jhigh", "ben: dealt with: skipped tick 3", "ben: left"]
    (run / "client-ben.log").write_text("\n".join(lines) + "\n")
    assert [note for note in load_run(run).notes if note.startswith("ben: ")] == [
        "ben: warning: K is \\x1b[2Jhigh", "ben: dealt with: skipped tick 3",
    ]  # fmt: skip
    (run / "client-ben.log").write_text("warning: again\n" * 1000)
    assert len(load_run(run).notes) <= 20


def test_notes_have_what_was_warned_of_before_the_run(folder: Path, tmp_path: Path) -> None:
    run = Path(shutil.copytree(folder, tmp_path / "warned"))
    before = load_run(run).notes
    write_warnings(run, [])
    assert load_run(run).notes == before
    write_warnings(run, ["warning: it will feel soft"])
    write_warnings(run, ["warning: the hand is quick", "ben: dealt with: skipped tick 3"], "ben")
    assert set(load_run(run).notes) - set(before) == {
        "warning: it will feel soft", "ben: warning: the hand is quick", "ben: dealt with: skipped tick 3",
    }  # fmt: skip
