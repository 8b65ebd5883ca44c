"""The report of a run: complete, self-contained, escaped, and never at a loss for what is missing."""

import json
import math
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from cogrip.cli.summary_table import terminal_summary
from cogrip.protocol.io.trace import HEADER_BYTES, TraceWriter
from cogrip.protocol.settings import resolve
from cogrip.sim.lab_run import run_laboratory
from cogrip.sim.report import render, write_report
from cogrip.sim.run_folder import ROOM_TRACE, client_trace
from cogrip.sim.traces import load_run, read_trace
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
    path = folder / client_trace("anna")
    trace = read_trace(path)
    rows = np.stack([trace.columns[name] for name in trace.columns], axis=1)
    late, work = (list(trace.columns).index(name) for name in ("late_us", "work_us"))
    rows[:, late] = np.geomspace(0.1, 900.0, len(rows))
    rows[1:, work] = 40.0
    path.unlink()
    writer = TraceWriter(path, tuple(trace.columns), rate_hz=1024, seconds=2.0, who="anna", start_ns=0)
    for row in rows.tolist():
        writer.append(row)
    writer.close()
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
    (folder / client_trace("anna")).unlink()
    assert name in page_of(folder)
    assert name in printed(json.loads((folder / "summary.json").read_text()))


def test_trace_columns_are_those_of_the_run(folder: Path) -> None:
    trace = read_trace(folder / client_trace("anna"))
    assert (trace.who, trace.rate_hz, trace.rows, trace.overwritten, trace.cut) == ("anna", 1024, 2048, 0, 0)
    assert trace.vector("position_m").shape == (2048, 1)
    assert np.array_equal(trace.columns["tick"], np.arange(2048.0))
    with pytest.raises(KeyError):
        trace.vector("nonsense")


def test_trace_that_is_cut_short_gives_what_is_whole(folder: Path) -> None:
    path = folder / client_trace("ben")
    whole = read_trace(path)
    expected, width = whole.columns["time_s"][:500], 8 * len(whole.columns)
    with path.open("r+b") as file:
        file.truncate(HEADER_BYTES + 500 * width + width // 2)
    trace = read_trace(path)
    assert (trace.rows, trace.cut) == (500, 2048 - 500)
    assert np.array_equal(trace.columns["time_s"], expected)
    assert "the last 1548 rows are cut off" in text_of(folder)


@pytest.mark.parametrize("size", [0, 10, 100, HEADER_BYTES - 1])
def test_trace_without_a_whole_header_is_left_out(folder: Path, size: int) -> None:
    path = folder / client_trace("ben")
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(ValueError, match="client-ben"):
        read_trace(path)
    assert "client-ben.trace is not a readable trace" in text_of(folder)


@pytest.mark.parametrize("header", [b"{", b"{}", b'{"columns": 3}', b"\xff\xff"])
def test_trace_with_a_damaged_header_is_left_out(folder: Path, header: bytes) -> None:
    path = folder / client_trace("ben")
    body = bytearray(path.read_bytes())
    body[16:20] = len(header).to_bytes(4, "little")
    body[20 : 20 + len(header)] = header
    path.write_bytes(body)
    with pytest.raises(ValueError, match="client-ben"):
        read_trace(path)


def test_trace_without_rows(folder: Path) -> None:
    path = folder / client_trace("ben")
    with path.open("r+b") as file:
        file.truncate(HEADER_BYTES)
    assert read_trace(path).rows == 0
    assert "client-ben.trace has no rows" in text_of(folder)


def test_ring_that_went_round_comes_in_time_order(tmp_path: Path) -> None:
    writer = TraceWriter(tmp_path / "a.trace", ("time_s", "x"), rate_hz=10, seconds=1.0, who="a", start_ns=0)
    for row in range(50):
        writer.append((row * 0.1, float(row)))
    writer.close()
    trace = read_trace(tmp_path / "a.trace")
    assert trace.rows + trace.overwritten == 50
    assert trace.overwritten == 20
    assert trace.columns["x"].tolist() == [float(row) for row in range(20, 50)]


def _starting(path: Path, who: str, start_ns: int, columns: tuple[str, ...] = ("time_s",)) -> None:
    writer = TraceWriter(path, columns, rate_hz=10, seconds=2.0, who=who, start_ns=start_ns)
    for row in range(20):
        writer.append((row * 0.1,) * len(columns))
    writer.close()


def test_traces_of_one_clock_begin_with_the_first_client(tmp_path: Path) -> None:
    """A server may have been up before; its trace then begins before zero."""
    _starting(tmp_path / client_trace("anna"), "anna", 10_000_000_000)
    _starting(tmp_path / client_trace("ben"), "ben", 10_500_000_000)
    _starting(tmp_path / ROOM_TRACE, "room", 9_000_000_000)
    run = load_run(tmp_path)
    assert run.room is not None
    first = [run.clients["anna"].time_s[0], run.clients["ben"].time_s[0], run.room.time_s[0]]
    assert first == pytest.approx([0.0, 0.5, -1.0])


def test_traces_of_other_clocks_keep_their_own_zero_and_it_is_said(tmp_path: Path) -> None:
    _starting(tmp_path / client_trace("anna"), "anna", 10_000_000_000)
    _starting(tmp_path / ROOM_TRACE, "room", 9_000_000_000_000)
    run = load_run(tmp_path)
    assert run.room is not None
    assert run.room.time_s[0] == run.clients["anna"].time_s[0] == 0.0
    assert any("clocks" in note for note in run.notes)


def test_trace_of_other_columns_is_said(tmp_path: Path) -> None:
    _starting(tmp_path / client_trace("anna"), "anna", 0)
    assert "a trace has no column" in page_of(tmp_path)


@pytest.mark.parametrize(
    ("missing", "said", "plots"),
    [
        ({ROOM_TRACE}, "room.trace is not here", PLOTS_IN_VIRTUAL_TIME),
        ({client_trace("ben")}, "client-ben.trace is not here", PLOTS_IN_VIRTUAL_TIME - {"coherence"}),
        (
            {client_trace("ben"), client_trace("anna")},
            "no client&#x27;s trace",
            {"positions", "forces", "energy", "link"},
        ),
        ({client_trace("ben"), client_trace("anna"), ROOM_TRACE}, "no trace is here", set()),
        ({"summary.json"}, "There is no summary of this run", PLOTS_IN_VIRTUAL_TIME),
        ({"settings.json"}, "The settings are not known", PLOTS_IN_VIRTUAL_TIME),
        ({"summary.json", "settings.json"}, "cut short", PLOTS_IN_VIRTUAL_TIME),
        ({"summary.json", "settings.json", client_trace("ben"), client_trace("anna")}, "cut short", {"positions"}),
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
