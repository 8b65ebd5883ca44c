"""The report of a run: complete, self-contained, escaped, and never at a loss for what is missing."""

import json
import math
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from rich.console import Console

from cogrip.cli.summary_table import terminal_summary
from cogrip.client.recorded import client_topics, start_text
from cogrip.devices.registry import make
from cogrip.protocol.recording.header import Header, versions_here
from cogrip.protocol.recording.reader import Message, RecordingError, open_recording
from cogrip.protocol.recording.records import Gap, Step, Tick, kind_of
from cogrip.protocol.recording.sink import encode
from cogrip.protocol.recording.writer import RecordingWriter
from cogrip.protocol.session import make_hello
from cogrip.protocol.settings import resolve
from cogrip.server.recorded import WHO, server_topics, step_topic
from cogrip.server.recorded import start_text as server_start_text
from cogrip.sim.lab_run import run_laboratory
from cogrip.sim.report import render, write_report
from cogrip.sim.run_folder import SERVER_RECORDING, client_recording
from cogrip.sim.traces import load_run
from cogrip.sim.verdict import energy, number, share, verdict

SCRIPT = "<script>alert(1)</script>"
PLOTS_IN_VIRTUAL_TIME = {"positions", "forces", "waves", "energy", "link", "coherence"}

SETTINGS: dict[str, Any] = {
    "name": "short",
    "seconds": 2.0,
    "link": {"delay_ms": 10, "jitter_ms": 5, "loss": 0.1},
    "playout": {"frames": 2, "tank_mj": 0.5},
    "users": [{"name": "anna", "hand": "reach"}, {"name": "ben", "hand": "hold"}],
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two people, a bad link, two seconds."""
    folder = tmp_path_factory.mktemp("run")
    run_laboratory(resolve(SETTINGS), folder)
    return folder


@pytest.fixture
def folder(finished: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(finished, tmp_path / "run"))


@contextmanager
def written(path: Path, header: Header) -> Iterator[RecordingWriter]:
    """A recording at `path`, closed at the end."""
    with path.open("wb") as file:
        writer = RecordingWriter(file, header)
        yield writer
        writer.finish()


def rewrite(path: Path, alter: Callable[[str, Message], bytes | None]) -> None:
    """Write a recording anew: a message's payload is what `alter` gives for its kind and it; None leaves it out."""
    recording = open_recording(path)
    messages = list(recording.messages())
    with written(path, recording.header) as writer:
        for message in messages:
            payload = alter(kind_of(recording.topics[message.topic]), message)
            if payload is not None:
                writer.put(message.topic, message.time_ns, payload)


class Page(HTMLParser):
    """Every tag with its attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))


def page_of(folder: Path) -> str:
    """The whole report, with its plots."""
    return write_report(folder).read_text(encoding="utf-8")


def text_of(folder: Path) -> str:
    """The report without plots, which take most of the time."""
    return render(load_run(folder), [])


def words(summary: dict[str, Any]) -> str:
    return " ".join(sentence for _, sentence in verdict(summary))


def printed(summary: dict[str, Any], width: int = 100) -> str:
    console = Console(width=width, color_system=None)
    with console.capture() as capture:
        console.print(terminal_summary(summary))
    return capture.get()


def test_report_and_plots_are_left_in_the_folder(folder: Path) -> None:
    report = write_report(folder)
    assert report == folder / "report.html"
    plots = {path.stem: path.read_bytes() for path in (folder / "plots").glob("*.png")}
    assert set(plots) == PLOTS_IN_VIRTUAL_TIME
    assert all(picture.startswith(b"\x89PNG") for picture in plots.values())
    text = report.read_text(encoding="utf-8")
    assert "Passive" in text
    assert "Not drawn: in virtual time no tick is late" in text
    assert text.count("data:image/png;base64,") == len(plots)


def test_report_fetches_nothing(folder: Path) -> None:
    text = page_of(folder)
    assert not re.search(r"https?:|url\(|@import", text)
    page = Page(text)
    assert not {tag for tag, _ in page.tags} & {"script", "link", "iframe", "object", "embed", "base"}
    sources = [str(attributes["src"]) for _, attributes in page.tags if "src" in attributes]
    assert len(sources) == len(PLOTS_IN_VIRTUAL_TIME)
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert not any("href" in attributes for _, attributes in page.tags)


@pytest.mark.parametrize(
    "more",
    [
        {"object": {"axes": 3}, "users": [{"name": name} for name in "abc"]},
        {"object": {"kind": "wall"}, "users": [{"name": "anna", "hand": "push"}]},
        {"coupling": {"kind": "coupling", "stiffness_npm": 2000.0}},
        {"users": [{"name": f"person {seat}"} for seat in range(14)], "seconds": 0.3},
    ],
    ids=["three axes", "wall", "virtual coupling", "a crowd for a moment"],
)
def test_every_kind_of_run_has_a_report(tmp_path: Path, more: dict[str, Any]) -> None:
    run_laboratory(resolve({**SETTINGS, "seconds": 1.2, **more}), tmp_path)
    assert "data:image/png" in page_of(tmp_path)
    assert (tmp_path / "plots" / "waves.png").exists() == ("coupling" not in more)


def test_live_loops_are_drawn(folder: Path) -> None:
    late_us = iter(np.geomspace(1.0, 900.0, 2048).round().astype(int).tolist())

    def of_a_live_loop(kind: str, message: Message) -> bytes:
        if kind != "tick":
            return message.payload
        tick = msgspec.json.decode(message.payload, type=Tick)
        return encode(msgspec.structs.replace(tick, late_us=next(late_us), work_us=40))

    rewrite(folder / client_recording("anna"), of_a_live_loop)
    write_report(folder)
    assert (folder / "plots" / "loops.png").exists()


def test_the_same_run_gives_the_same_report(folder: Path) -> None:
    assert page_of(folder) == page_of(folder)


def test_settings_that_are_not_the_default_are_marked(folder: Path) -> None:
    text = text_of(folder)
    assert "<tr><th>tank_mj</th><td class=changed>0.5</td></tr>" in text
    assert "<tr><th>redundancy</th><td>8</td></tr>" in text


def test_a_long_reason_is_shown_whole(folder: Path) -> None:
    summary = json.loads((folder / "summary.json").read_text())
    summary["users"][0] |= {"state": "fault", "reason": "because " * 30}
    (folder / "summary.json").write_text(json.dumps(summary))
    assert text_of(folder).count("because") == 60  # once in the verdict, once in the table


def test_every_text_from_outside_is_escaped(folder: Path) -> None:
    summary = json.loads((folder / "summary.json").read_text())
    settings = json.loads((folder / "settings.json").read_text())
    summary["name"] = settings["name"] = settings["object"]["kind"] = SCRIPT
    settings[SCRIPT] = {SCRIPT: SCRIPT}
    summary["users"][0] |= {"name": SCRIPT, "state": "fault", "reason": SCRIPT, "peak_force_n": SCRIPT}
    settings["users"][0] |= {"name": SCRIPT, SCRIPT: SCRIPT}
    summary["object"]["position_m"] = [SCRIPT]
    summary["server"]["dropped"] = {SCRIPT: SCRIPT}
    (folder / "summary.json").write_text(json.dumps(summary))
    (folder / "settings.json").write_text(json.dumps(settings))
    text = text_of(folder)
    assert "script" not in {tag for tag, _ in Page(text).tags}
    assert "<script" not in text
    assert text.count("&lt;script&gt;") >= 8
    assert SCRIPT[:8] in printed(summary)


def test_markup_and_tex_in_names_are_only_text(folder: Path) -> None:
    """Nothing forbids them to whoever writes the files by hand; matplotlib and rich have languages of their own."""
    name = "[red]_$x^$"
    for file in ("summary.json", "settings.json"):
        path = folder / file
        path.write_text(path.read_text().replace("anna", name))
    (folder / client_recording("anna")).unlink()
    assert name in page_of(folder)
    assert name in printed(json.loads((folder / "summary.json").read_text()))


def test_trace_columns_are_those_of_the_run(folder: Path) -> None:
    run = load_run(folder)
    trace = run.clients["anna"]
    assert (trace.who, trace.rate_hz, trace.rows, run.notes) == ("anna", 1024, 2048, ())
    assert trace.vector("position_m").shape == (2048, 1)
    assert np.array_equal(trace.columns["tick"], np.arange(2048.0))
    assert trace.time_s == pytest.approx(np.arange(2048) / 1024, abs=1e-9)
    with pytest.raises(KeyError):
        trace.vector("nonsense")


def test_columns_are_what_the_recording_holds_bit_by_bit(folder: Path) -> None:
    recording = open_recording(folder / client_recording("anna"))
    topic = client_topics("anna").index("/anna/tick")
    ticks = [msgspec.json.decode(each.payload, type=Tick) for each in recording.messages() if each.topic == topic]
    trace = load_run(folder).clients["anna"]
    for name in ("position_m", "velocity_mps", "force_n", "wave_up", "wave_down"):
        assert trace.vector(name).tolist() == [list(getattr(tick, name)) for tick in ticks]


@pytest.mark.parametrize("part", [0.3, 0.6, 0.95])
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


def _chunks(body: bytes | bytearray) -> list[tuple[int, int]]:
    """(offset, length) of every chunk record's content (MCAP: opcode u8, length u64)."""
    found, offset = [], 8
    while offset + 9 <= len(body):
        opcode, length = body[offset], int.from_bytes(body[offset + 1 : offset + 9], "little")
        if opcode == 6:
            found.append((offset + 9, length))
        offset += 9 + length
    return found


def test_recording_with_a_damaged_chunk_gives_the_rest_and_names_the_gap(folder: Path) -> None:
    path = folder / client_recording("ben")
    whole = load_run(folder).clients["ben"].columns["time_s"]
    body = bytearray(path.read_bytes())
    chunks = _chunks(body)
    offset, length = chunks[len(chunks) // 2]
    body[offset + length // 2] ^= 0xFF
    path.write_bytes(body)
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


def _header_end(body: bytes) -> int:
    """Where the metadata, which says what a recording is, ends."""
    offset = 8
    while True:
        opcode, length = body[offset], int.from_bytes(body[offset + 1 : offset + 9], "little")
        offset += 9 + length
        if opcode == 12:
            return offset


@pytest.mark.parametrize("missing", [None, 700, 100, 1])
def test_recording_without_a_whole_header_is_left_out(folder: Path, missing: int | None) -> None:
    path = folder / client_recording("ben")
    body = path.read_bytes()
    path.write_bytes(body[: _header_end(body) - missing] if missing else b"")
    with pytest.raises(RecordingError, match=r"client-ben\.mcap (is not a|ends before)"):
        open_recording(path)
    run = load_run(folder)
    assert set(run.clients) == {"anna"}
    assert any(re.search(r"client-ben\.mcap (is not a|ends before)", note) for note in run.notes)


@pytest.mark.parametrize(
    ("good", "bad"),
    [
        (b"\x07\x00\x00\x00rate_hz", b"\x07\x00\x00\x00hate_hz"),
        (b"1024", b"10x4"),
        (b"client", b"cl\xffent"),
        (b"\x06\x00\x00\x00topics", b"\x06\x00\x00\x7ftopics"),
        (b"\x06\x00\x00\x00format\x01\x00\x00\x001", b"\x06\x00\x00\x00format\x01\x00\x00\x009"),
    ],
    ids=["a field is missing", "no number", "no text", "a length beyond the end", "a newer format"],
)
def test_recording_with_a_damaged_header_is_left_out(folder: Path, good: bytes, bad: bytes) -> None:
    path = folder / client_recording("ben")
    body = path.read_bytes()
    head = body[: _header_end(body)]
    assert good in head
    path.write_bytes(head.replace(good, bad, 1) + body[len(head) :])
    with pytest.raises(RecordingError, match="client-ben"):
        open_recording(path)
    assert set(load_run(folder).clients) == {"anna"}
    assert "client-ben.mcap" in text_of(folder)


def test_recording_without_ticks_is_said(folder: Path) -> None:
    rewrite(folder / client_recording("ben"), lambda kind, message: None if kind == "tick" else message.payload)
    run = load_run(folder)
    assert set(run.clients) == {"anna"}
    (note,) = run.notes
    assert "client-ben.mcap" in note
    assert "is not here" not in note, "it is here"


SHORT = resolve({"name": "short", "users": [{"name": "anna"}]})


def _client_header(who: str) -> Header:
    hello = make_hello(
        software="x", nonce=1, room="", name=who, digest="", device="sim", axes=1, rate_hz=1024.0
    )  # fmt: skip
    start = start_text(hello, make("sim:phantom", axes=1).capability)
    return Header("client", who, start, 10, 1, 0, False, versions_here(), client_topics(who))


def _tick(number: int) -> Tick:
    one = (float(number),)
    return Tick(
        tick=number, late_us=0, work_us=0, position_m=one, velocity_mps=one, force_n=one, work_j=0.0, port_j=0.0,
        wave_up=one, wave_down=one, object_m=one,
    )  # fmt: skip


def _person(folder: Path, who: str, start_ns: int) -> None:
    """Two seconds of a client of ten ticks a second."""
    with written(folder / client_recording(who), _client_header(who)) as writer:
        for number in range(20):
            writer.put(0, start_ns + number * 100_000_000, encode(_tick(number)))


def _server(folder: Path, start_ns: int) -> None:
    topics = server_topics([SHORT.name])
    header = Header(
        "server", WHO, server_start_text([SHORT], "x"), 10, 1, 0, False, versions_here(), topics
    )  # fmt: skip
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
    assert trace.columns["position_m.0"].tolist() == [float(number) for number in [*range(20), *range(40, 50)]]
    assert trace.time_s == pytest.approx([number * 0.1 for number in [*range(20), *range(40, 50)]])
    (note,) = [note for note in run.notes if note.startswith("client-anna.mcap")]
    assert "20 messages were not recorded" in note


def test_recordings_of_one_clock_begin_with_the_first_client(tmp_path: Path) -> None:
    """A server may have been up before; its trace then begins before zero."""
    _person(tmp_path, "anna", 10_000_000_000)
    _person(tmp_path, "ben", 10_500_000_000)
    _server(tmp_path, 9_000_000_000)
    run = load_run(tmp_path)
    assert run.room is not None
    first = [run.clients["anna"].time_s[0], run.clients["ben"].time_s[0], run.room.time_s[0]]
    assert first == pytest.approx([0.0, 0.5, -1.0])


def test_recordings_of_other_clocks_keep_their_own_zero_and_it_is_said(tmp_path: Path) -> None:
    """Two machines' files in one folder that `cogrip merge` did not make: their steady clocks have nothing in common."""
    _person(tmp_path, "anna", 10_000_000_000)
    _server(tmp_path, 9_000_000_000_000)
    run = load_run(tmp_path)
    assert run.room is not None
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


@pytest.mark.parametrize(
    ("missing", "said", "plots"),
    [
        ({SERVER_RECORDING}, "server.mcap is not here", PLOTS_IN_VIRTUAL_TIME),
        ({client_recording("ben")}, "client-ben.mcap is not here", PLOTS_IN_VIRTUAL_TIME - {"coherence"}),
        (
            {client_recording("ben"), client_recording("anna")},
            "no client&#x27;s trace",
            {"positions", "forces", "energy", "link"},
        ),
        ({client_recording("ben"), client_recording("anna"), SERVER_RECORDING}, "no trace is here", set()),
        ({"summary.json"}, "There is no summary of this run", PLOTS_IN_VIRTUAL_TIME),
        ({"settings.json"}, "The settings are not known", PLOTS_IN_VIRTUAL_TIME),
        ({"summary.json", "settings.json"}, "cut short", PLOTS_IN_VIRTUAL_TIME),
        (
            {"summary.json", "settings.json", client_recording("ben"), client_recording("anna")},
            "cut short",
            {"positions"},
        ),
    ],
)
def test_what_is_missing_is_said(folder: Path, missing: set[str], said: str, plots: set[str]) -> None:
    (folder / "plots").mkdir()
    for name in PLOTS_IN_VIRTUAL_TIME:
        (folder / "plots" / f"{name}.png").touch()  # of an earlier report: must not outlive what it was drawn from
    for name in missing:
        (folder / name).unlink()
    assert said in page_of(folder)
    assert {path.stem for path in (folder / "plots").glob("*.png")} == plots


def test_folder_of_no_run(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="name the folder of a run"):
        write_report(tmp_path)


def test_damaged_json_is_said(folder: Path) -> None:
    (folder / "summary.json").write_text("{")
    (folder / "settings.json").write_text("[]")
    text = text_of(folder)
    assert "summary.json is not readable" in text
    assert "settings.json holds no table" in text


def without(value: Any) -> Any:
    """The same keys, and null wherever a value stood."""
    if isinstance(value, dict):
        return {key: without(inner) for key, inner in value.items()}
    return [without(inner) for inner in value] if isinstance(value, list) else None


def test_nulls_are_not_known(folder: Path) -> None:
    summary = without(json.loads((folder / "summary.json").read_text()))
    (folder / "summary.json").write_text(json.dumps(summary))
    text = text_of(folder)
    assert "not known" in text
    assert "was never heard" in text
    assert ">None<" not in text
    assert "None" not in printed(summary)


@pytest.mark.parametrize("summary", [{}, {"users": None}, {"users": [None, 3, {}]}, {"server": 7, "object": []}])
def test_strange_summaries_print(summary: dict[str, Any]) -> None:
    assert printed(summary)


def test_verdict_names_who_broke_passivity_and_by_how_much(finished: Path) -> None:
    summary = json.loads((finished / "summary.json").read_text())
    assert "Passive" in words(summary)
    assert "Nothing diverged" in words(summary)
    summary["passive"] = False
    summary["users"][1]["energy"]["down_margin_j"] = -0.0034
    assert "Not passive: the line down of ben gave out 3.4 mJ more than had been put in." in words(summary)


def test_verdict_says_why_it_diverged(finished: Path) -> None:
    summary = json.loads((finished / "summary.json").read_text())
    summary["diverged"] = True
    assert "The object left the workspace" in words(summary)
    summary["users"][0]["reason"] = "force at its limit"
    assert "Diverged. anna: force at its limit." in words(summary)


def test_verdict_counts_ticks(finished: Path) -> None:
    summary = json.loads((finished / "summary.json").read_text())
    assert "Every loop ran every tick." in words(summary)
    summary["users"][0]["ticks"] = {"due": 1000, "run": 990, "late_us": {"p99": 312.4}}
    assert "anna 99.00 %" in words(summary)
    assert "within 312 µs" in words(summary)


@pytest.mark.parametrize("width", [80, 100])
def test_terminal_table_fits(finished: Path, width: int) -> None:
    summary = json.loads((finished / "summary.json").read_text())
    for user in summary["users"]:
        user["position_m"] = [0.0123, -0.0123, 0.0]
        user["ticks"]["late_us"]["p99"] = 1234.5
    lines = printed(summary, width).splitlines()
    assert max(map(len, lines)) <= width
    if width == 100:
        table = "\n".join(lines[: 4 + len(summary["users"])])
        assert "…" not in table
        assert "12.3 −12.3 0.0" in table


@pytest.mark.parametrize(
    ("value_j", "text"),
    [
        (None, "not known"),
        (math.nan, "nan"),
        (0.0, "0 J"),
        (-3e-22, "0 J"),
        (-0.0034, "−3.4 mJ"),
        (12.0, "12 J"),
        (2.5e-8, "25 nJ"),
    ],
)
def test_energy_takes_the_unit_that_fits(value_j: float | None, text: str) -> None:
    assert energy(value_j) == text


def test_numbers_do_not_lie_by_rounding() -> None:
    assert share(0.999999) == "99.99 %"
    assert share(1.0) == "100 %"
    assert number(-0.0001) == "0.0"
    assert number(True) == "True"
