"""Commands on run folders: `cogrip runs`, `report`, `export`."""

import csv
import fcntl
import json
import os
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.io.recorder import is_being_written
from cogrip.protocol.settings.room import resolve
from cogrip.results.listing.listing import ListedRun, list_runs
from cogrip.results.reading.records import open_run
from cogrip.results.writing.laboratory_run import run_laboratory

from tests.cli.command import Cogrip
from tests.cli.spoiled_runs import damage

SETTINGS: dict[str, Any] = {
    "name": "short",
    "seconds": 1.0,
    "coupling": {"stiffness_npm": 100.0},  # felt as asked: the line is six times stiffer
    "link": {"delay_ms": 10, "loss": 0.1},
    "playout": {"frames": 2},
    "users": [{"name": "anna", "hand": "reach"}, {"name": "ben", "hand": "hold"}],
}
IDEAL = [{"name": "anna", "device": "sim:ideal"}, {"name": "ben", "hand": "hold", "device": "sim:ideal"}]
OTHERS: dict[str, dict[str, Any]] = {
    "20260101-120000-first": {},
    "20260101-120001-soft": {"coupling": {"stiffness_npm": 50.0}},
    "20251231-235959-spring": {"coupling": {"kind": "coupling", "stiffness_npm": 2000.0}},
    "20260101-090000-apart": {
        "coupling": {"stiffness_npm": 1e5, "server_step": "paper"}, "link": {"delay_ms": 31.25}, "playout": {},
        "users": IDEAL,
    },
    "20260101-100000-three": {"object": {"axes": 3}},
}  # fmt: skip
FIRST, SOFT, SPRING, APART, THREE = OTHERS


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five runs, none to be changed."""
    folder = tmp_path_factory.mktemp("runs")
    for name, more in OTHERS.items():
        (folder / name).mkdir()
        run_laboratory(resolve({**SETTINGS, **more}), folder / name)
    return folder


@pytest.fixture
def runs(base: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(base, tmp_path / "runs"))


def listed(base: Path) -> dict[str, ListedRun]:
    return {run.name: run for run in list_runs(base, is_being_written)}


def test_runs_are_listed_newest_first_with_a_line_each(base, cogrip, monkeypatch):
    monkeypatch.setenv("COLUMNS", "150")
    heading, *lines = cogrip.out("runs", base).splitlines()
    assert [line.split()[0] for line in lines] == [SOFT, FIRST, THREE, APART, SPRING]
    assert heading.split() == ["run", "age", "kind", "people", "verdict", "length", "size"]
    assert re.search(r" \d+ d +lab +anna, ben +✓ good +1\.0 s +[\d.]+ kB$", lines[1])
    assert re.search(r"✗ unstable\b", lines[3])
    assert re.search(r"✗ not passive\b", lines[4])


def test_a_folder_that_is_no_session_is_listed_as_what_it_is(runs, capsys):
    """A comparison of methods, a sweep, a what-if beside what it is compared with, a replay: none is a session that failed."""
    rows = [
        {
            "method": "partner",
            "network": "wan",
            "ours": True,
            "diverged": 0,
            "oscillates": 0,
            "not_passive": 0,
            "failed": 0,
        }
    ]
    summary = {"sessions": 8, "run": 8, "asked": {"settings": SETTINGS}, "rows": rows}

    def left(name: str, **files: str) -> Path:
        folder = runs / name
        folder.mkdir()
        for file, text in files.items():
            (folder / file.replace("_", ".")).write_text(text)
        return folder

    compared = left("20260103-080000-compare-short", comparison_json="{}", summary_json=json.dumps(summary))
    begun = left("20260103-080001-compare-begun", comparison_json="{}", cells_jsonl="{}\n" * 3)
    swept = left("20260103-080002-sweep", sweep_json="{}", cells_jsonl="{}\n" * 5)
    world = runs / "20260103-080003-short-what-if"
    shutil.copytree(runs / FIRST, world)
    shutil.copytree(runs / FIRST, world / "unchanged")
    (world / "comparison.html").write_text("")
    replayed = runs / "20260103-080004-again"
    shutil.copytree(runs / FIRST, replayed)
    table = json.loads((replayed / "settings.json").read_text())
    for user in table["users"]:
        user["device"] = "replay:run#user=0"
    (replayed / "settings.json").write_text(json.dumps(table))
    found = listed(runs)
    kinds = {name: (run.kind, run.tone, run.brief) for name, run in found.items() if name.startswith("20260103")}
    assert kinds == {
        replayed.name: ("replay", "good", "good"), f"{world.name}/unchanged": ("what-if", "good", "good"),
        world.name: ("what-if", "good", "good"), swept.name: ("comparison", "good", "5 cases"),
        begun.name: ("comparison", "warn", "3 sessions"), compared.name: ("comparison", "good", "8 sessions"),
    }  # fmt: skip
    assert found[compared.name].people == ("anna", "ben")
    assert found[compared.name].seconds == 1.0
    rows[0]["diverged"] = 1
    unsaid = json.dumps({**summary, "rows": [{key: value for key, value in rows[0].items() if key != "ours"}]})
    strange = {"{}": "unreadable", '{"sessions": 1, "run": 1, "rows": 5}': "unreadable", unsaid: "unreadable"}
    for text, brief in {json.dumps(summary): "partner failed", **strange}.items():
        (compared / "summary.json").write_text(text)
        assert listed(runs)[compared.name].brief == brief
        assert listed(runs)[compared.name].tone == "bad"
    rows[0]["ours"] = False
    (compared / "summary.json").write_text(json.dumps(summary))
    assert listed(runs)[compared.name].tone == "good", "that a baseline diverges is a result"


def test_runs_as_json(base, cogrip):
    answer = cogrip.answer("runs", base)
    rows = {row["run"]: row for row in answer["runs"]}
    assert list(rows) == [SOFT, FIRST, THREE, APART, SPRING]
    row = rows[FIRST]
    assert (row["seconds"], row["people"], row["tone"]) == (1.0, ["anna", "ben"], "good")
    assert row["when"].startswith("2026-01-01T12:00:00")
    assert row["size_bytes"] == sum(path.stat().st_size for path in (base / FIRST).iterdir())
    assert Path(row["folder"]) == base / FIRST
    assert (row["kind"], row["brief"]) == ("lab", "good")
    assert row["verdict"].startswith("passive, stable, felt as intended"), "the whole one"
    assert {name: rows[name]["tone"] for name in (APART, SPRING)} == {APART: "bad", SPRING: "bad"}
    alone = cogrip.answer("runs", base / FIRST)["runs"]
    assert [row["run"] for row in alone] == [FIRST], "a run named by itself"


def test_what_has_no_time_in_its_name_goes_by_its_files_time(runs):
    (runs / FIRST).rename(runs / "renamed")
    os.utime(runs / "renamed", (1.7e9, 1.7e9))  # in November 2023
    (runs / SOFT).rename(runs / "20269999-120000-no-such-day")
    os.utime(runs / "20269999-120000-no-such-day", (1.9e9, 1.9e9))
    names = list(listed(runs))
    assert names[0] == "20269999-120000-no-such-day"
    assert names[-1] == "renamed"


def test_folders_that_are_no_runs_are_left_out(runs, empty_folder, cogrip):
    for name in (".hidden", "empty", "settings of another program"):
        (runs / name).mkdir()
    (runs / "settings of another program" / "settings.json").write_text("{}")
    shutil.copy(runs / FIRST / "summary.json", runs / ".hidden")
    (runs / "a file").write_text("")
    assert set(listed(runs)) == set(OTHERS)
    assert cogrip("runs runs/empty") == (0, "", "no runs in runs/empty\n")


@pytest.mark.parametrize(
    ("spoil", "tone", "words"),
    [
        (lambda run: (run / "summary.json").unlink(), "bad", "cut short: no summary.json"),
        (lambda run: (run / "summary.json").write_text("{"), "bad", "summary.json is not readable"),
        (lambda run: (run / "summary.json").write_text("[]"), "bad", "summary.json holds no table"),
        (lambda run: (run / "summary.json").write_text("{}"), "bad", "summary.json holds no table"),
        (lambda run: (run / "settings.json").write_text("\xff"), "bad", "settings.json is not readable"),
        (lambda run: (run / "client-ben.mcap").write_text("x"), "bad", "client-ben.mcap is not a recording"),
        (lambda run: (run / "client-ben.mcap").write_bytes(b""), "bad", "client-ben.mcap is not a recording"),
        (lambda run: os.truncate(run / "client-ben.mcap", 40_000), "warn", "client-ben.mcap was not closed"),
        (lambda run: (run / "client-ben.mcap").unlink(), "good", "not recorded here: ben"),
        (lambda run: (run / "server.mcap").unlink(), "good", "not recorded here: the server"),
        (lambda run: [path.unlink() for path in run.glob("*.mcap")], "warn", "no recording is here"),
    ],
)
def test_what_is_wrong_with_a_run_is_said(runs, spoil, tone, words):
    spoil(runs / FIRST)
    run = listed(runs)[FIRST]
    assert words in run.verdict
    assert run.tone == tone
    assert run.people == ("anna", "ben")
    assert "name a run folder" not in run.verdict


def test_without_summary_and_settings_people_are_those_of_the_recordings(runs):
    for name in ("summary.json", "settings.json", "server.mcap"):
        (runs / FIRST / name).unlink()
        assert listed(runs)[FIRST].people == ("anna", "ben")


def test_a_run_that_is_being_written_still_runs(runs):
    """A writer holds a lock on its file while it lives."""
    (runs / FIRST / "summary.json").unlink()
    path = runs / FIRST / "client-anna.mcap"
    os.truncate(path, 40_000)
    with path.open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        run = listed(runs)[FIRST]
        assert (run.tone, run.verdict) == ("warn", "it still runs")
    assert listed(runs)[FIRST].verdict == "cut short: no summary.json; client-anna.mcap was not closed"


def test_what_was_not_recorded_is_counted(runs):
    path = runs / FIRST / "summary.json"
    summary = json.loads(path.read_text())
    summary["server"]["dropped"] = {"not recorded": 12, "recording stopped": 1}
    path.write_text(json.dumps(summary))
    assert listed(runs)[FIRST].verdict.startswith("12 messages not recorded; recording stopped; passive")


def test_rooms_of_one_server_are_runs_of_their_own(runs):
    """Their recording stands beside them; it counts for both."""
    folder = runs / "20260102-080000-rooms"
    for room in ("one", "two"):
        (folder / room).mkdir(parents=True)
        shutil.copy(runs / FIRST / "settings.json", folder / room)
    shutil.copy(runs / FIRST / "summary.json", folder / "one")
    shutil.move(runs / FIRST / "server.mcap", folder)
    found = listed(runs)
    assert list(found)[:2] == ["20260102-080000-rooms/two", "20260102-080000-rooms/one"]
    one, two = found["20260102-080000-rooms/one"], found["20260102-080000-rooms/two"]
    assert one.verdict == "passive, stable, felt as intended; not recorded here: anna, ben"
    assert two.verdict.startswith("cut short: no summary.json")
    shared = (folder / "server.mcap").stat().st_size
    assert one.size_bytes == shared + sum(path.stat().st_size for path in (folder / "one").iterdir())


anything = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=8,
)
users = st.lists(anything | st.fixed_dictionaries({}, optional=dict.fromkeys(
    ("name", "state", "reason", "energy", "ticks", "unstable", "saturated", "left"), anything
)), max_size=3)  # fmt: skip
strange = st.fixed_dictionaries({}, optional={
    **dict.fromkeys(("seconds", "passive", "diverged", "unstable", "left", "server"), anything), "users": users | anything,
})  # fmt: skip


@given(summary=strange)
def test_no_summary_is_too_strange_to_be_listed(tmp_path_factory, summary):
    folder = tmp_path_factory.mktemp("strange")
    (folder / "run").mkdir()
    (folder / "run" / "summary.json").write_text(json.dumps(summary))
    (run,) = list_runs(folder, is_being_written)
    assert run.verdict
    assert run.tone in ("warn", "bad")


def test_the_report_of_one_run_is_written_anew_and_several_are_compared_on_one_page(
    runs, tmp_path, empty_folder, cogrip
):
    report = runs / FIRST / "report.html"
    report.write_text("old")
    assert f"report: {report}" in cogrip.out("report", runs / FIRST)
    assert "Passive" in report.read_text(encoding="utf-8")
    assert (runs / FIRST / "plots" / "positions.png").exists()
    report.unlink()
    for more in ((), (runs / SPRING,)):  # an earlier comparison is replaced
        out = cogrip.out("report", runs / FIRST, runs / SOFT, *more)
    assert "report: comparison.html" in out
    assert "peak force [N]" in out
    page = (tmp_path / "comparison.html").read_text(encoding="utf-8")
    assert "3 runs compared" in page
    assert all(name in page for name in (FIRST, SOFT, SPRING))
    assert not report.exists()


def test_export_writes_tables_beside_the_recordings_or_elsewhere(runs, tmp_path, cogrip):
    folder = runs / FIRST
    out = cogrip.out("export", folder, "--to", "csv", "--datagrams")
    table = folder / "client-anna.tick.csv"
    assert f"{table}: 1024 rows" in out
    assert f"{table} exists, and nothing is overwritten" in cogrip.err("export", folder, "--to", "csv")
    assert (folder / "server.datagram_in.csv").exists()
    with table.open(newline="") as file:
        head, *rows = csv.reader(file)
    assert head[:2] == ["time_s", "tick"]
    recorded = open_run(folder).clients["anna"].columns("tick", "position_m")
    assert [float(row[head.index("position_m_x")]) for row in rows] == recorded["position_m"][:, 0].tolist()
    assert [float(row[0]) for row in rows] == recorded["time_s"].tolist()
    assert cogrip("export", folder / "client-ben.mcap", "--to", "csv", "--out", tmp_path / "a" / "b")[0] == 0
    there = {path.name for path in (tmp_path / "a" / "b").iterdir()}
    assert "client-ben.tick.csv" in there
    assert all(name.startswith("client-ben.") and "datagram" not in name for name in there)


def test_export_of_a_run_that_goes_on_gives_way_to_that_of_the_whole(runs, cogrip):
    folder = runs / FIRST
    before = set(folder.iterdir())
    recording = folder / "client-anna.mcap"
    whole = recording.read_bytes()
    with recording.open("r+b") as file:
        file.truncate(40_000)
        fcntl.flock(file, fcntl.LOCK_EX)  # as its writer does
        for _ in range(2):
            err = cogrip.err("export", folder, "--to", "csv", code=0)
            assert f"{FIRST} still goes on: these tables are what was there just now" in err
        tables = {path.name for path in set(folder.iterdir()) - before}
        assert {"client-anna.tick.partial.csv", "client-ben.tick.partial.csv", "server.step.partial.csv"} <= tables
        assert all(name.endswith(".partial.csv") for name in tables)
        assert 1 < len((folder / "client-anna.tick.partial.csv").read_text().splitlines()) < 1025
    recording.write_bytes(whole)
    assert f"{folder / 'client-anna.tick.csv'}: 1024 rows" in cogrip.out("export", folder, "--to", "csv")
    left = {path.name for path in set(folder.iterdir()) - before}
    assert left == {name.replace(".partial", "") for name in tables} | {"client-anna.account.csv"}


def test_export_recovers_what_was_cut_short_and_warns_of_a_damaged_chunk(runs, cogrip):
    """The old recording stays; the tables have their usual names."""
    cut = runs / FIRST / "client-anna.mcap"
    os.truncate(cut, 40_000)
    damage(runs / FIRST / "client-ben.mcap")
    err = cogrip.err("export", runs / FIRST, "--to", "csv", code=0)
    assert "client-anna.mcap was not closed" in err
    assert "warning: client-ben.mcap: damaged chunk" in err
    assert cut.stat().st_size == 40_000
    ticks = {}
    for name in ("anna", "ben"):
        with (runs / FIRST / f"client-{name}.tick.csv").open(newline="") as file:
            ticks[name] = [int(row["tick"]) for row in csv.DictReader(file)]
    assert 0 < len(ticks["anna"]) < 1024
    assert (ticks["ben"][0], ticks["ben"][-1]) == (0, 1023)
    assert 0 < 1024 - len(ticks["ben"]) < 400


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["runs", "nowhere"], "nowhere: there is no such folder"),
        (["runs"], "runs: there is no such folder"),
        (["report"], "name at least one run folder"),
        (["report", "RUNS"], "holds no summary.json, no settings.json and no recording"),
        (["report", f"RUNS/{FIRST}/server.mcap"], "is a file; name the run folder"),
        (["report", f"RUNS/{FIRST}", f"RUNS/{FIRST}/../{FIRST}"], "is named twice"),
        (["report", f"RUNS/{FIRST}", "--out", "x.html"], "is for several runs"),
        (["report", f"RUNS/{FIRST}", f"RUNS/{SOFT}", "--out", "no/x.html"], "there is no folder"),
        (["report", f"RUNS/{FIRST}", f"RUNS/{SOFT}", "--out", "/proc/x.html"], "/proc/x.html"),
        (["report", f"RUNS/{FIRST}", f"RUNS/{THREE}"], "its object.axes is 3, not 1"),
        (["report", f"RUNS/{FIRST}", f"RUNS/{SOFT}", "--out", f"RUNS/{FIRST}/summary.json"], "no comparison of ours"),
        (["export", "RUNS", "--to", "csv"], "no recording"),
        (["export", f"RUNS/{FIRST}"], "--to"),
        (["export", f"RUNS/{FIRST}", "--to", "xlsx"], "xlsx"),
        (["export", f"RUNS/{FIRST}/summary.json", "--to", "csv"], "is not a recording"),
        (["export", f"RUNS/{FIRST}", "--to", "csv", "--out", f"RUNS/{FIRST}/summary.json"], "summary.json"),
        (["export", f"RUNS/{FIRST}", "--to", "csv", "--out", "/proc/x"], "/proc/x"),
    ],
)
def test_bad_input_is_named_and_nothing_is_left(arguments, words, base, empty_folder, cogrip):
    before = {path: path.stat().st_mtime_ns for path in base.rglob("*")}
    cogrip.refuses(words, *(argument.replace("RUNS", str(base)) for argument in arguments))
    assert {path: path.stat().st_mtime_ns for path in base.rglob("*")} == before


def test_a_run_that_was_softer_than_asked_is_listed_so(tmp_path):
    folder = tmp_path / "20260101-120000-stiff"
    folder.mkdir()
    run_laboratory(resolve({**SETTINGS, "coupling": {"stiffness_npm": 1000.0}}), folder)
    found = listed(tmp_path)[folder.name]
    assert (found.tone, found.brief) == ("warn", "softer than asked")
    assert "softer than asked" in found.verdict


def test_runs_takes_its_folder_as_other_commands_do(cogrip: Cogrip, tmp_path: Path) -> None:
    (tmp_path / "others").mkdir()
    assert cogrip.answer("runs", "--runs", tmp_path / "others") == cogrip.answer("runs", tmp_path / "others")
    cogrip.refuses("give one of them", "runs", tmp_path / "others", "--runs", tmp_path)
    cogrip.refuses("there is no such folder", "runs", "--runs", tmp_path / "nowhere")
