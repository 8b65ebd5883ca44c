"""Tables of a run's recordings: every number as recorded, bit for bit, and never more in memory than a chunk."""

import csv
import json
import math
import re
import struct
import sys
import tracemalloc
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.recorder import client_topics
from cogrip.protocol.recording.header import Header, versions_here
from cogrip.protocol.recording.records import (
    KINDS,
    Datagram,
    Geoms,
    Ledger,
    Poses,
    Record,
    SeatStep,
    Sensors,
    Step,
    Tick,
    kind_of,
)
from cogrip.protocol.recording.schema import DESCRIPTIONS, unit_of
from cogrip.protocol.recording.sink import encode
from cogrip.protocol.settings.room import resolve
from cogrip.results.reading import export as export_module
from cogrip.results.reading.columns import layout_of
from cogrip.results.reading.export import ExportError, Format, export
from cogrip.results.reading.records import open_run
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.server.recorder import server_topics

from tests.extent import long
from tests.recording_files import written

SETTINGS: dict[str, Any] = {
    "name": "short",
    "seconds": 1.0,
    "object": {"axes": 2},
    "link": {"delay_ms": 10, "jitter_ms": 5, "loss": 0.1},
    "users": [{"name": "anna", "hand": "reach"}, {"name": "ben r", "hand": "hold"}],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two people on two axes, for a second, over a bad link."""
    made = tmp_path_factory.mktemp("run")
    run_laboratory(resolve(SETTINGS), made)
    return made


def header(who: str, topics: tuple[str, ...], role: str = "client") -> Header:
    return Header(role, who, "{}", 1024, 1, 0, True, versions_here(), topics)


def write_recording(path: Path, head: Header, messages: Sequence[tuple[str, float, Record]], flush: int = 0) -> None:
    """Write messages given as (topic's kind or whole name, time [s], record); `flush` ends a chunk after so many."""
    with written(path, head) as writer:
        for number, (kind, time_s, record) in enumerate(messages, 1):
            topic = next(place for place, topic in enumerate(head.topics) if kind in (topic, kind_of(topic)))
            writer.put(topic, round(time_s * 1e9), encode(record))
            if flush and number % flush == 0:
                writer.flush()


def a_tick(number: int = 0, axes: int = 1, **fields: Any) -> Tick:
    row = tuple(0.1 * axis + number for axis in range(axes))
    vectors = dict.fromkeys(("position_m", "velocity_mps", "force_n", "wave_up", "wave_down", "object_m"), row)
    return Tick(**{"tick": number, "late_us": 3, "work_us": 40, "work_j": 0.5, "port_j": -0.25, **vectors, **fields})


def read_csv(path: Path) -> dict[str, list[str]]:
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    return {name: [row[place] for row in rows] for place, name in enumerate(head)}


def same(text: str, value: Any) -> bool:
    """Return True if a cell holds a value, a float to the last bit."""
    if value is None:
        return text == ""
    if isinstance(value, float):
        return struct.pack("<d", float(text)) == struct.pack("<d", value) or (math.isnan(value) and text == "nan")
    return text == str(int(value) if isinstance(value, bool) else value)


def cells(record: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (column, value) of all that a record holds, written down independently of the code under test."""
    for name in record.__struct_fields__:
        value = getattr(record, name)
        if name == "seats":
            for seat in value:
                yield from cells(seat, f"{seat.user}.")
        elif name in ("edges", "edge_ticks"):
            yield prefix + name, " ".join(map(str, value))
        elif isinstance(value, tuple):
            axes = ("qw", "qx", "qy", "qz") if name == "orientation" else "xyz"
            yield from ((f"{prefix}{name}_{axis}", one) for axis, one in zip(axes, value, strict=False))
        elif name != "user" and not (value is None and name in ("given_mps", "unfit", "orientation")):
            yield prefix + name, value


@pytest.fixture(scope="module")
def tables(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Path, int]]:
    """The run's tables as CSV files, each with its number of rows."""
    return export(open_run(folder), "csv", tmp_path_factory.mktemp("tables"))


@pytest.fixture(scope="module")
def exported(tables: list[tuple[Path, int]]) -> Path:
    """The folder of the tables."""
    return tables[0][0].parent


def test_a_file_for_each_end_and_kind_of_message(tables: list[tuple[Path, int]], exported: Path) -> None:
    names = {path.name: rows for path, rows in tables}
    assert set(names) == {path.name for path in exported.iterdir()}
    assert names["client-anna.tick.csv"] == names["client-ben+r.tick.csv"] == 1024
    assert names["server.step.csv"] == 128
    assert {"client-anna.account.csv", "client-anna.event.csv", "server.event.csv"} <= set(names)
    assert {"server.asked.csv", "server.answer.csv"} & set(names)
    assert not any("datagram" in name or "gap" in name for name in names)
    for path, rows in tables:
        columns = read_csv(path)
        assert next(iter(columns)) == "time_s"
        assert {len(column) for column in columns.values()} == {rows}


def test_every_number_reads_back_as_the_same_bits(folder: Path, exported: Path) -> None:
    """Those of a tick; those of a step, with a seat's under its person's name."""
    run = open_run(folder)
    recorded = {"client-anna.tick": run.clients["anna"].records("tick"), "server.step": run.steps()}
    recorded["client-ben+r.tick"] = run.clients["ben r"].records("tick")
    for name, timed in recorded.items():
        columns = read_csv(exported / f"{name}.csv")
        for number, (time_s, record) in enumerate(timed):
            for column, value in [("time_s", time_s), *cells(record)]:
                assert same(columns[column][number], value), (name, column, number)


def test_datagrams_only_when_asked_for_and_whole(folder: Path, tmp_path: Path) -> None:
    run = open_run(folder)
    export(run, "csv", tmp_path, datagrams=True)
    columns = read_csv(tmp_path / "server.datagram_in.csv")
    recorded = [timed.record for timed in run.server.records("datagram_in")]
    assert [bytes.fromhex(text) for text in columns["data_hex"]] == [datagram.data for datagram in recorded]
    assert columns["address"] == [json.loads(datagram.address) for datagram in recorded]
    assert (tmp_path / "client-anna.datagram_out.csv").exists()


@pytest.mark.parametrize(
    ("address", "text"),
    [
        ("", None),
        ('"person 0"', "person 0"),
        ('["127.0.0.1",47800]', "127.0.0.1:47800"),
        ('["fe80::1",47800,0,2]', "[fe80::1]:47800"),
    ],
)
def test_addresses_are_written_as_one_types_them(address: str, text: str | None) -> None:
    datagram = Datagram(b"\x01\xff", address)
    assert layout_of(datagram).table([0.5], [datagram]) == [[0.5], [text], ["01ff"]]


A_SEAT = SeatStep("anna", True, (0.0,), (0.0,), 0.0, 0.0, 0.0, 0.0, 0)
A_STEP = Step(step=1, object_m=(0.0,), object_mps=(0.0,), seats=(A_SEAT,))
SAMPLES: dict[str, Record] = {
    "Tick": a_tick(axes=3),
    "Step": A_STEP,
    "Poses": Poses(1, (0.0,) * 7),
    "Sensors": Sensors(1, ("touch",), (0.0,)),
}


@pytest.mark.parametrize(
    "record", sorted(set(KINDS.values()) - {Datagram, Geoms, Ledger}, key=lambda each: each.__name__)
)
def test_no_field_of_a_record_is_forgotten(record: type[Record]) -> None:
    """A field that is added to a record has a column without anybody thinking of it; `unfit` stands in the sample's."""
    sample = SAMPLES.get(record.__name__)
    if sample is None:
        kinds: dict[Any, Any] = {int: 1, str: "x", float: 1.0}
        fields = msgspec.structs.fields(record)
        sample = record(**{each.name: "" if each.name == "ticks" else kinds.get(each.type, 1.0) for each in fields})
    layout = layout_of(sample)
    bare = {column.name.rpartition(".")[2] for column in layout.columns}
    bare |= {name.removesuffix("_x") for name in bare} | {name.partition("_")[0] for name in bare}
    assert set(record.__struct_fields__) - {"unfit", "seats", "names"} <= bare
    if record is Step:
        assert set(SeatStep.__struct_fields__) - {"user"} <= bare
        assert {column.name.partition(".")[0] for column in layout.columns if "." in column.name} == {"anna"}
    assert [len(values) for values in layout.table([0.0], [sample])] == [1] * len(layout.columns)


def test_accounts_are_spread_over_columns(folder: Path, exported: Path) -> None:
    """Every number of the accounts, as the summary has it, under a name with its unit; a row for each seat of a server."""
    summary = json.loads((folder / "summary.json").read_text())
    for user, file in zip(summary["users"], ("client-anna", "client-ben+r"), strict=True):
        (account,) = read_csv_rows(exported / f"{file}.account.csv")
        assert float(account["peak_force_n"]) == user["peak_force_n"]
        assert [float(account[f"position_m_{axis}"]) for axis in "xy"] == user["position_m"]
        assert int(account["link_down_lost"]) == user["link"]["down"]["lost"]
        assert float(account["rtt_ms_p50"]) >= 20.0
        assert float(account["device_port_leak_j"]) >= 0.0
    seats = read_csv_rows(exported / "server.account.csv")
    assert [(seat["room"], seat["user"]) for seat in seats] == [("short", "anna"), ("short", "ben r")]
    for user, seat in zip(summary["users"], seats, strict=True):
        assert int(seat["link_up_lost"]) == user["link"]["up"]["lost"]
        assert [float(seat[f"room_position_m_{axis}"]) for axis in "xy"] == summary["object"]["position_m"]
        assert "room_ticks_late_us_p99" in seat


def read_csv_rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


WORDS = {
    "state", "verb", "reason", "text", "room", "user", "ticket", "kind", "limited_reasons", "room_dropped_reasons",
}  # fmt: skip
JSON_TEXTS = {"grant", "value"}


def test_every_table_is_plain_numbers_but_for_columns_of_words(tables: list[tuple[Path, int]]) -> None:
    """No list, no object, no flag as a word in any cell: whatever reads a CSV file takes the columns for numbers."""
    for path, _ in tables:
        for name, cases in read_csv(path).items():
            if name not in WORDS | JSON_TEXTS:
                assert all(case == "" or math.isfinite(float(case)) for case in cases), (path.name, name)
            if name not in JSON_TEXTS:
                assert not any(case.startswith(("[", "{")) for case in cases), (path.name, name)


def test_the_docs_tell_of_every_column(exported: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "recordings.md").read_text(encoding="utf-8")
    for kind in ("client-anna.tick", "server.step", "client-anna.account", "server.account"):
        for name in read_csv(exported / f"{kind}.csv"):
            bare = re.sub(r"_(x|y|q[wxyz]|p50|p99|p999|max)$", "", name.rpartition(".")[2])
            told = {bare, name, bare.replace("link_up_", "link_down_"), f"{bare}_p50"}
            assert any(f"`{each}`" in page for each in told), name
    for record in (Tick, Step, SeatStep):
        for name in set(record.__struct_fields__) - {"seats", "user"}:
            line = f"| `{name}` | {unit_of(name)} | {DESCRIPTIONS[name]} |"
            assert line in page, f"docs/recordings.md, Exported tables, needs the line {line}"


def ledger_file(path: Path, account: str) -> Path:
    write_recording(
        path, header("anna", client_topics("anna")), [("tick", 0.0, a_tick()), ("account", 0.0, Ledger(account))]
    )
    return path


def test_an_account_that_is_shorter_or_has_nulls_has_empty_cells(tmp_path: Path) -> None:
    """One of an earlier cogrip, or of a session that diverged."""
    export(open_run(ledger_file(tmp_path / "client-anna.mcap", "[[null],[0.5],null,0.25]")), "csv", tmp_path)
    (account,) = read_csv_rows(tmp_path / "client-anna.account.csv")
    known = {name: value for name, value in account.items() if value and name != "time_s"}
    assert known == {"force_n_x": "0.5", "travel_m": "0.25"}
    assert {"position_m_x", "peak_force_n"} <= set(account)


@pytest.mark.parametrize("account", ["", "7", "[]", "[7]", "{}", '{"room":"a","seats":[1]}'])
def test_an_account_that_is_none_is_refused_by_name(account: str, tmp_path: Path) -> None:
    path = ledger_file(tmp_path / "client-anna.mcap", account)
    with pytest.raises(ExportError, match=r"client-anna\.account\.csv: a message is not what its topic says"):
        export(open_run(path), "csv", tmp_path / "out")


numbers = st.floats(allow_nan=False, allow_infinity=False)
anything = st.floats()


@st.composite
def ticks(draw: st.DrawFn, axes: int) -> Tick:
    """Draw ticks of all kinds: with a sample, without, with its own velocity, with one that is not finite."""
    row = st.tuples(*[numbers] * axes)
    texts = st.tuples(*[anything.map(repr)] * axes)
    vectors = {name: draw(row) for name in ("velocity_mps", "force_n", "wave_up", "wave_down", "object_m")}
    unfit = draw(st.none() | st.tuples(texts, st.none() | texts))
    return Tick(
        tick=draw(st.integers(0, 2**40)),
        late_us=draw(st.integers(0, 10**6)),
        work_us=draw(st.integers(0, 10**6)),
        position_m=None if unfit else draw(st.none() | row),
        work_j=draw(numbers),
        port_j=draw(numbers),
        margin_j=draw(st.none() | numbers),
        rtt_ms=draw(st.none() | numbers),
        state=draw(st.sampled_from(["live", "fault"])),
        given_mps=None if unfit else draw(st.none() | row),
        unfit=unfit,
        **vectors,
    )


@given(data=st.data(), axes=st.integers(1, 3))
def test_any_ticks_come_back_from_csv(data: st.DataObject, axes: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    made = data.draw(st.lists(ticks(axes), min_size=1, max_size=6))
    folder = tmp_path_factory.mktemp("any")
    head = header("anna", client_topics("anna"))
    write_recording(
        folder / "client-anna.mcap", head, [("tick", 0.01 * place, each) for place, each in enumerate(made)]
    )
    export(open_run(folder), "csv", folder)
    columns = read_csv(folder / "client-anna.tick.csv")
    for number, tick in enumerate(made):
        position, given_mps = tick.position_m, tick.given_mps
        if tick.unfit:  # as it was read
            position = tuple(map(float, tick.unfit[0]))
            given_mps = tuple(map(float, tick.unfit[1])) if tick.unfit[1] else None
        for name, row in (("position_m", position), ("given_mps", given_mps), ("force_n", tick.force_n)):
            for axis in range(axes):
                assert same(columns[f"{name}_{'xyz'[axis]}"][number], row[axis] if row else None)
        for name in ("tick", "work_j", "margin_j", "rtt_ms", "state", "late_us"):
            assert same(columns[name][number], getattr(tick, name))


def test_parquet_holds_what_csv_holds(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    monkeypatch.setattr(export_module, "ROWS_HELD", 300)
    run = open_run(folder)
    export(run, "csv", tmp_path, datagrams=True)
    tables = export(run, "parquet", tmp_path, datagrams=True)
    assert {path.stem for path, _ in tables} == {path.stem for path in tmp_path.glob("*.csv")}
    for path, rows in tables:
        table, columns = parquet.read_table(path), read_csv(path.with_suffix(".csv"))
        assert (table.num_rows, table.column_names) == (rows, list(columns))
        for name, texts in columns.items():
            values = table.column(name).to_pylist()
            assert all(map(same, texts, values)), (path.name, name)
    ticks_file = parquet.ParquetFile(tmp_path / "client-anna.tick.parquet")
    assert ticks_file.num_row_groups > 1
    assert str(ticks_file.schema_arrow.field("position_m_x").type) == "double"
    assert str(ticks_file.schema_arrow.field("tick").type) == "int64"
    assert str(ticks_file.schema_arrow.field("state").type) == "string"


def test_parquet_without_pyarrow_names_the_extra(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ExportError, match=r"pip install 'cogrip\[parquet\]'"):
        export(open_run(folder), "parquet", tmp_path / "new")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("to", ["csv", "parquet"])
def test_nothing_is_overwritten(folder: Path, tmp_path: Path, to: Format) -> None:
    """Not even the files that would come before the one that is in the way."""
    there = tmp_path / f"server.step.{to}"
    there.write_text("mine")
    with pytest.raises(ExportError, match=r"server\.step.*nothing is overwritten"):
        export(open_run(folder), to, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [there.name]
    assert there.read_text() == "mine"


def test_what_was_begun_is_removed_when_it_cannot_be_finished(tmp_path: Path) -> None:
    messages = [("event", 0.0, KINDS["event"]("hello")), ("tick", 0.0, a_tick(0, 1)), ("tick", 0.1, a_tick(1, 2))]
    path = tmp_path / "client-anna.mcap"
    write_recording(path, header("anna", client_topics("anna")), messages, flush=1)
    out = tmp_path / "out"
    with pytest.raises(ExportError, match="as many axes"):
        export(open_run(path), "csv", out)
    assert list(out.iterdir()) == []


def test_a_server_has_a_table_for_each_room_and_a_room_its_own_steps_only(tmp_path: Path) -> None:
    def step(number: int) -> Step:
        nothing = SeatStep("anna", False, (0.0,), (0.0,), None, None, None, None, 0)
        return msgspec.structs.replace(A_STEP, step=number, seats=(nothing,))

    messages = [("/room/one/step", 0.0, step(1)), ("/room/two b/step", 0.0, step(7)), ("/room/one/step", 0.1, step(2))]
    head = header("server", server_topics(["one", "two b"]), "server")
    write_recording(tmp_path / "server.mcap", head, messages)
    export(open_run(tmp_path), "csv", tmp_path / "all")
    assert {path.name for path in (tmp_path / "all").iterdir()} == {"server.one.step.csv", "server.two+b.step.csv"}
    assert read_csv(tmp_path / "all" / "server.one.step.csv")["step"] == ["1", "2"]
    columns = read_csv(tmp_path / "all" / "server.two+b.step.csv")
    assert (columns["anna.seated"], columns["anna.up_margin_j"]) == (["0"], [""])
    room = tmp_path / "two b"
    room.mkdir()
    export(open_run(room), "csv", room)
    assert {path.name for path in room.iterdir()} == {"server.step.csv"}
    assert read_csv(room / "server.step.csv")["step"] == ["7"]


def test_a_hostile_recording_stays_in_its_folder(tmp_path: Path) -> None:
    """Names in a recording were written by anybody."""
    inside = tmp_path / "inside"
    inside.mkdir()
    head = header("../../evil", ("/../../evil/tick", "/../../evil/gap"))
    write_recording(inside / "client-anna.mcap", head, [("tick", 0.0, a_tick())])
    steps = header("server", ("/server/gap", "/room/../../evil/step", "/room/b/step"), "server")
    write_recording(inside / "server.mcap", steps, [("/room/../../evil/step", 0.0, A_STEP)])
    run = open_run(inside)
    before = set(tmp_path.iterdir())
    tables = export(run, "csv", inside / "out")
    assert {path.parent for path, _ in tables} == {inside / "out"}
    assert set(tmp_path.iterdir()) == before
    assert len(list((inside / "out").iterdir())) == len(tables) == 2


@pytest.mark.long
@pytest.mark.parametrize("to", ["csv", long("parquet")])
def test_memory_does_not_grow_with_the_recording(tmp_path: Path, to: Format, monkeypatch: pytest.MonkeyPatch) -> None:
    if to == "parquet":
        pytest.importorskip("pyarrow.parquet")
    monkeypatch.setattr(export_module, "ROWS_HELD", 500)
    peaks = []
    for rows in (1000, 1000, 3000):  # the first time is for what is imported and cached
        folder = tmp_path / f"{len(peaks)}"
        folder.mkdir()
        messages = [("tick", number / 1024, a_tick(number, 3)) for number in range(rows)]
        write_recording(folder / "client-anna.mcap", header("anna", client_topics("anna")), messages)
        del messages
        run = open_run(folder)
        tracemalloc.start()
        try:
            export(run, to, folder)
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    assert peaks[2] < 1.3 * peaks[1]
