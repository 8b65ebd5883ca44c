"""Tables at usual terminal widths, with long names, many people, three axes, and missing numbers."""

import inspect
import re
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.console import Console

from cogrip.cli.admin.who import people_tables
from cogrip.cli.devices.check import rows_table
from cogrip.cli.devices.listing import device_list
from cogrip.cli.runs import listing as runs
from cogrip.cli.runs.compared_table import compared_table
from cogrip.cli.runs.summary_table import terminal_summary
from cogrip.cli.serving.relay import flows_table, status
from cogrip.cli.session import live_views, observe
from cogrip.cli.session.live_views import FollowedRun, JoinTable, JoinView, LiveTable, ServeTable, ServeView, components
from cogrip.cli.study.compare import methods_table
from cogrip.cli.terminal.tables import say, wrapped
from cogrip.devices.arm.check import VerdictRow
from cogrip.devices.registry import describe, families
from cogrip.experiments.methods.table import TABLE
from cogrip.machine.stop import Stop
from cogrip.protocol.recording.records import SeatStep, Step, Tick
from cogrip.protocol.secure.channel import place_text
from cogrip.protocol.settings.link_profile import Link
from cogrip.results.comparison.differences import differences
from cogrip.results.listing.listing import ListedRun
from cogrip.server.admission.roster import RosterEntry
from cogrip.sim.io.relay_loop import LiveRelay
from cogrip.sim.link import configured_link
from cogrip.sim.relay import Relay

from tests.cli.command import printed
from tests.extent import long

WIDTHS = [80, 120]
PEOPLE = ("Maximiliana-Josephine von Hohenstein", "b", "日本語の名前とても長い", "d" * 40, "e f", "g", "h", "i")
IPV6 = "[2001:db8:1111:2222:3333:4444:5555:6666]:65535"
STATES = ("live", "degraded", "fault", None)
CUT_NUMBER = re.compile(r"\d…|…\d|[+−-]…")


@pytest.fixture(params=WIDTHS)
def width(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """Return the columns of a terminal."""
    monkeypatch.setenv("COLUMNS", str(request.param))
    return request.param


@pytest.fixture(params=[1, 3])
def axes(request: pytest.FixtureRequest) -> int:
    return request.param


def check(text: str, width: int, *whole: str, each: str = "") -> None:
    """No line is wider than the terminal, no number or state is cut, and no word that matters is broken."""
    for line in text.splitlines():
        assert cell_len(line.rstrip()) <= width, line
    assert not CUT_NUMBER.search(text), text
    for word in (*whole, *each.split()):
        assert word in text, f"{word!r} is broken, cut or missing in:\n{text}"


# --- session ----------------------------------------------------------------------------------------------------------


def person(number: int) -> dict[str, Any]:
    """One that is hard to show."""
    nan = float("nan")
    return {
        "name": PEOPLE[number],
        "state": STATES[number % 4],
        "position_m": [None, [-0.1234, 0.2222, -0.9999], [nan] * 3, [0.1, None, -0.1]][number % 4],
        "peak_force_n": [12.34, None, nan, 100.0][number % 4],
        "felt_stiffness_npm": [None, 20000.0, 1.0, nan][number % 4],
        "predicted_stiffness_npm": [20000.0, None, 1.0, nan][number % 4],
        "energy": {"up_margin_j": -1.23e-4, "down_margin_j": None, "line_margin_j": 0.0, "device_margin_j": 0.275},
        "link": [None, {"lost": 12345, "late": 12345, "duplicate": 12345, "rtt_ms": {"p99": 1234.5}}][number % 2],
        "delay": {"up_ms": {"p50": 123.4}, "down_ms": {"p50": None}},
        "ticks": {"due": 100000, "run": 99321, "late_us": {"p99": 123456.0}} if number % 3 else None,
    }


SUMMARY: dict[str, Any] = {
    "name": "a session with a name that is longer than most are " * 2,
    "seconds": 3.0,
    "passive": True,
    "unstable": False,
    "saturated": False,
    "left": False,
    "object": {"position_m": [-0.1234, 0.2222, -0.9999], "travel_m": None},
    "users": [person(number) for number in range(8)],
    "server": {"ticks": {"due": 100, "run": 100, "late_us": {"p99": None}}},
}


def test_a_session_of_eight_on_three_axes(width: int) -> None:
    text = printed(terminal_summary(SUMMARY), width)
    headings = ("person", "hand", "peak", "felt/calc.", "lost/late", "/dupl.", "rtt99 ms", "ticks", "late p99", "state")
    check(text, width, *headings, "degraded", "fault", "−123.4 222.2 −999.9", "12345/12345/12345", "99.32 %")
    table = text.partition("\n\n")[0]
    assert table.count("degraded") == 2
    assert len([line for line in table.splitlines() if line.startswith("b ")]) == (1 if width == 120 else 2)
    users = [{**person(0), "name": name, "position_m": [0.02]} for name in ("anna", "ben")]
    usual = printed(terminal_summary({**SUMMARY, "users": users, "object": {"position_m": [0.02]}}), width)
    assert len([line for line in usual.partition("\n\n")[0].splitlines() if line.startswith("anna ")]) == 1


class Followed(FollowedRun):
    """Recordings that hold hard numbers."""

    def __init__(self, axes: int = 3, people: tuple[str, ...] = PEOPLE) -> None:
        self.axes, self.people = axes, people

    def tick(self, name: str) -> Tick | None:
        number = self.people.index(name)
        row = (-0.1234, 0.2222, -0.9999)[: self.axes]
        return None if number == 7 else Tick(
            1, 2, 3, row if number % 2 == 0 else None, row, tuple(1e2 * each for each in row), 0.0, 0.0, (), (), row,
            -0.12345 if number % 3 else None, 1234.5 if number % 3 else None, 12345, STATES[number % 4] or "degraded", 12345,
            256, up_ms=123.4, down_ms=None,
        )  # fmt: skip

    def step(self, room: str) -> Step:
        row = (-0.1234, 0.2222, -0.9999)[: self.axes]
        force = tuple(1e2 * each for each in row)
        seats = [SeatStep(name, True, row, force, -0.1, None, None, None, 12345) for name in self.people]
        return Step(1234567, row, row, tuple(seats), late_us=123456, skipped=12345)


def test_the_live_table_of_a_demo(width: int, axes: int) -> None:
    table = LiveTable(Path("nowhere"), "room", PEOPLE, Followed(axes))
    text = printed(table.table(), width)
    check(text, width, "mJ: up", "ms: up", each="person state hand force reserve rtt delay lost ticks degraded joining")
    assert len(text.splitlines()) <= 23, "it fits a terminal of 24 lines"


class Usual(Followed):
    """Recordings of one person, whom nothing troubles."""

    def tick(self, name: str) -> Tick:
        row = (0.0123,) * self.axes
        return Tick(
            1, 2, 3, row, row, row, 0.0, 0.0, (), (), row, 0.0112, 39.8, 1, "live", 2, 3, up_ms=19.9, down_ms=20.1,
            reserve_j=0.0, device_reserve_j=0.28,
        )  # fmt: skip


NUMBER = re.compile(r"([xyz] +)?[+-]?\d+(?:\.\d+)?(?=\s|$)")  # one behind its axis has its own name


def test_every_number_of_a_live_table_ends_below_the_end_of_a_heading(width: int, axes: int) -> None:
    """Tables of a demo, a server and a join."""
    run = Usual(axes, ("anna",))
    demo = LiveTable(Path("nowhere"), "room", ["anna"], run)
    server = ServeTable(ServeView("nowhere", {"room": ("anna",)}), run)
    join = JoinTable(JoinView("nowhere", "room", "anna"), run)
    for table in (demo.table(), server.table(width, 23), join.table(width, 23)):
        lines = printed(table, width).splitlines()
        heads = [number for number, line in enumerate(lines) if re.match(r"person|name|state| *mJ: up", line)]
        assert heads
        for number in heads:
            above = {found.end() for line in lines[number - 1 : number + 1] for found in re.finditer(r"\S+", line)}
            below = {found.end() for found in NUMBER.finditer(lines[number + 1]) if not found[1]}
            assert below <= above, "\n".join(lines)


def test_the_live_table_of_a_join(width: int, axes: int) -> None:
    for name in PEOPLE:
        table = JoinTable(JoinView("nowhere", "room", name), Followed(axes))
        text = printed(table.table(width, 23), width)
        if name == PEOPLE[7]:
            assert "nothing is recorded yet" in text
            continue
        check(text, width, "mJ: up", "ms: up", each="state hand force reserve rtt delay lost ticks playout 12345")
        signs = re.findall(r"([xyz]) +([+-]\d+\.\d+)", text)
        if name == PEOPLE[0]:  # hand and force of each axis, with its sign
            numbers = {"x": ("-123.4", "-12.34"), "y": ("+222.2", "+22.22"), "z": ("-999.9", "-99.99")}
            assert set(signs) == {(axis, text) for axis in "xyz"[:axes] for text in numbers[axis]}


@pytest.mark.parametrize(("width", "height"), [(80, 24), (120, 40)])
@pytest.mark.parametrize("rooms", [1, 3, 30])
def test_the_live_table_of_a_server(width: int, height: int, rooms: int) -> None:
    names = [f"room-{number}" for number in range(rooms)]
    table = ServeTable(ServeView("nowhere", dict.fromkeys(names, PEOPLE), "nowhere"), Followed(3))
    table.roster = [RosterEntry(name, names[0], IPV6, 4e5, seat, rtt_ms=1234.5, lost=123456, holds=seat > 1)
               for seat, name in enumerate(PEOPLE[:3])]  # fmt: skip
    text = printed(table.table(width, height - 1), width)
    check(text, width, each="name state since rtt lost proxy force holds comes 111:06:40 1234.5")
    assert len(text.splitlines()) < height
    assert ("more seats" in text, "more rooms" in text) == (rooms > 1, rooms > 10)
    assert "room-0: -123.4 +222.2 -999.9 mm, step 1234567, 123456 µs late, 12345 skipped" in text.replace("object ", "")


# --- runs -------------------------------------------------------------------------------------------------------------

NOW = datetime(2026, 1, 2, 12, tzinfo=UTC)


def listed(number: int, name: str = "") -> ListedRun:
    briefs = (("good", "good"), ("warn", "not as intended"), ("bad", "not passive"), ("bad", "cut short"))
    tone, brief = briefs[number % 4]
    ago = timedelta(seconds=(1.0, 100.0, 1e4, 1e6, 1e8)[number % 5])
    kinds = ("session", "lab", "replay", "what-if", "comparison")
    folder = name or f"20260101-1200{number % 60:02}-demo-what-if"
    return ListedRun(
        folder, Path(folder), kinds[number % 5], NOW - ago, [None, 3.0, 12345.6][number % 3], PEOPLE[: number % 9],  # type: ignore[arg-type]
        tone, brief, "a verdict " * 40, 10 ** (number % 10),  # type: ignore[arg-type]
    )  # fmt: skip


def test_a_hundred_runs_are_a_line_each_but_for_one_with_a_long_name(width: int) -> None:
    long_name = "20260101-120000-" + "n" * 30
    found = [*(listed(number) for number in range(100)), listed(3, long_name)]
    lines = [line.plain for line in runs.lines_of(found, width, NOW)]
    check("\n".join(lines), width, "✗ not passive", "✗ cut short", each="run age kind people verdict +7")
    assert len(lines) == (103 if width == 80 else 102)
    assert long_name in lines[101].split()
    for run, line in zip(found[:100], lines[1:101], strict=True):
        assert line.startswith(run.name)
        assert run.kind in line
        assert run.brief in line


def test_ages_and_sizes_have_the_unit_that_fits() -> None:
    ages = {-5.0: "0 s", 59.9: "59 s", 60.0: "1 min", 3599.0: "59 min", 3600.0: "1 h", 86399.0: "23 h", 1e6: "11 d"}
    assert {seconds: runs.age(seconds) for seconds in ages} == ages
    sizes = {0: "0 B", 999: "999 B", 1000: "1 kB", 2_180_000: "2.18 MB", 999_999: "1 MB", 3.1e9: "3.1 GB"}
    assert {size_bytes: runs.size(size_bytes) for size_bytes in sizes} == sizes


# --- networks and servers ---------------------------------------------------------------------------------------------


def relay_of(host: str) -> LiveRelay:
    core = Relay(lambda number, direction, origin_ns: configured_link(Link(), direction, "", (), origin_ns), 8, 10**9)
    for port in (65533, 65534, 65535):
        core.from_client(b"x", (host, port), 0)
    return LiveRelay(core, ("", 0), ("", 0), Stop(), print)


@pytest.mark.parametrize("width", [*WIDTHS, 300])
@pytest.mark.parametrize("host", ["127.0.0.1", "2001:db8:1111:2222:3333:4444:5555:6666"])
def test_a_relays_table(width: int, host: str) -> None:
    text = printed(flows_table(relay_of(host)), width)
    headings = "flow client direction sent delivered lost outage dropped duplicated held reordered"
    check(text, width, *(place_text((host, port)) for port in (65533, 65535)), each=headings)
    if width == 300:
        assert len(text.splitlines()) == 10, "one table for a file"


@pytest.mark.parametrize("width", [40, *WIDTHS])
@pytest.mark.parametrize("count", [0, 1234567])
def test_a_relays_status_is_one_line(monkeypatch: pytest.MonkeyPatch, width: int, count: int) -> None:
    live = relay_of("127.0.0.1")
    total = dict.fromkeys(("sent", "delivered", "lost", "outage"), count)
    monkeypatch.setattr(live.relay, "totals", lambda direction: total)
    line = status(live, width).replace("\r", "").replace("\x1b[K", "")
    assert len(line) < width
    assert "flows: up " in line
    if width >= 80:
        assert f"down {count} in, {count} out" in line


def test_who_is_there(width: int) -> None:
    room, device = "room-" + "r" * 30, f"sim:phantom?hand={'reach&' * 8}"
    people = [
        RosterEntry(name, room, IPV6, 123456.7, number, device, 1234.5, None, 12.3, 99999)
        for number, name in enumerate(PEOPLE)
    ]
    text = printed(people_tables(people), width)
    check(text, width, "rtt ms", "up ms", IPV6, each="name room seat address since lost device 34:17:36")
    assert text.count("d" * 40) >= 1


# --- devices ----------------------------------------------------------------------------------------------------------


def test_devices_are_a_line_each_in_an_order_that_helps(capsys, width: int) -> None:
    assert device_list() == 0
    text = capsys.readouterr().out
    check(" ".join(text.split()), len(text), *(f"{scheme}: {summary}" for scheme, summary in families().items()))
    check(
        text, width, *(listing.address for listing in describe(axes=3)), each="address axes peak stiffness damping rate"
    )
    most = 4 + len(describe(axes=3)) + 2 * len(families())  # a heading and a line more for each family
    assert "…" not in text, "nothing is cut off"
    assert len(text.splitlines()) <= most
    heads = [line.partition(":")[0] for line in text.splitlines() if re.match(r"[a-z]+: ", line)]
    assert heads[0] == "sim"
    assert heads[-2:] == ["emulated", "replay"]
    (phantom,) = [line for line in text.splitlines() if line.startswith("sim:phantom ")]
    assert phantom.split()[1:] == ["3", "8.5", "1000", "38.4", "8192"]


@pytest.mark.parametrize(
    ("name", "verbose"), [("", True), ("sim", False), ("omega", False), ("sim:phantom?hand=hold", False)]
)
def test_whole_records_of_devices(capsys, width: int, name: str, verbose: bool) -> None:
    assert device_list(name, verbose=verbose) == 0
    text = capsys.readouterr().out
    check(text, width, "workspace", "continuous", "slope", "felt mass", "own losses")
    addresses = re.findall(r"^  ([a-z]+:\S*)$", text, re.MULTILINE)
    if name == "omega":
        assert [address.rpartition("=")[2] for address in addresses] == ["omega3", "omega6", "omega7"]
    if name.startswith("sim:"):
        assert addresses == [name]


def test_what_a_check_found(width: int) -> None:
    rows = [VerdictRow(f"noise of axis {n}, at rest", f"{n}2345.6 counts rms", "at most 1 count, none alone", n % 2 == 0, "x")
            for n in range(8)]  # fmt: skip
    check(printed(rows_table(rows), width), width, "measured", "found", "wanted", "12345.6", "✓", "✗")


# --- comparisons ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("many", [2, long(3), 4, long(6)])
def test_runs_side_by_side(width: int, many: int) -> None:
    summaries = [{**SUMMARY, "seconds": 3.0 + number, "unstable": None} for number in range(many)]
    labels = [f"20260101-1200{number:02}-a-name-that-is-long-enough-to-be-cut-somewhere" for number in range(many)]
    text = printed(compared_table(differences(summaries), labels), width)
    check(text, width, "difference", "least margin of the device port", "not measured", *labels)


def test_methods(width: int) -> None:
    numbers = {"runs": 20, "failed": 0, "diverged": 3, "diverged_s": {"median": 1.3, "first": 0.2}, "oscillates": 2}
    more = {"active": 1, "not_passive": 4, "not_felt": 5, "felt": None, "credit_mj": 1.0, "errors": {}, "reasons": {}}
    spread = {"median": 12345.6, "worst": 1e9, "low": 0.0, "high": 1e9, "n": 20, "of": 20}
    rows = [
        {"network": network, "method": method, **numbers, **more, **{column.measure: spread for column in TABLE}}
        for network in ("clean", "satellite") for method in ("wave", "paper", "coupling", "tdpa")
    ]  # fmt: skip
    summary = {"rows": rows, "asked": {"seeds": list(range(20))}, "run": 160, "sessions": 160}
    text = printed(methods_table(summary), width)
    check(text, width, "method", "verdict", "created", "coupling", "satellite", "diverged 3/20")


# --- lines ------------------------------------------------------------------------------------------------------------


def test_long_lines_break_between_words_below_a_hanging_indent_but_not_in_a_file(
    width: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    console, words = Console(width=width), "warning: " + "a felt-stiffness of 1438 N/m " * 12
    first, *further = wrapped(words, console).splitlines()
    assert all(len(line) <= width for line in (first, *further))
    assert all(line.startswith("  ") and line[2] != " " for line in further)
    assert " ".join([first, *(line.strip() for line in further)]).split() == words.split()
    path = "/a/path/" + "x" * 200
    assert path in wrapped(f"report: {path}", console), "what is copied stays whole"
    monkeypatch.delenv("COLUMNS")
    with (tmp_path / "file").open("w") as file:
        say(Console(file=file), words)
    assert len((tmp_path / "file").read_text().splitlines()) == 1


def test_stability_says_it_in_lines_that_fit(cogrip, tmp_path: Path, width: int) -> None:
    (tmp_path / "pair.toml").write_text('[link]\ndelay_ms = 20.0\n[[users]]\nname = "anna"\n[[users]]\nname = "ben"\n')
    out, err = cogrip.texts("stability", "radius", tmp_path / "pair.toml")
    check(out + err, width, "structural eigenvalues at 1: device position of anna")


@given(st.floats(-1.0, 1.0), st.sampled_from(["+z.1f", "+z6.1f", "+z5.2f"]))
def test_what_is_0_as_it_is_shown_has_no_minus(value: float, form: str) -> None:
    (text,) = components((value * 1e-3,), 1.0, form)
    assert float(text) != 0.0 or "-" not in text
    assert float(text) == pytest.approx(value * 1e-3, abs=0.051)


def test_no_table_in_the_terminal_is_written_with_a_signed_0() -> None:
    for module in (live_views, observe):
        assert not re.findall(r"\+\d?\.\df", inspect.getsource(module)), module


def test_a_wrapped_text_keeps_its_lines_and_its_words() -> None:
    console = Console(width=20, force_terminal=True)
    text = "cogrip: one two three four five\n/a/path/that/is/longer/than/the/terminal and more"
    assert wrapped(text, console).splitlines() == [
        "cogrip: one two", "  three four five", "/a/path/that/is/longer/than/the/terminal", "  and more",
    ]  # fmt: skip
