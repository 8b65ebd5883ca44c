"""Runs compared: the numbers and their differences, what cannot be compared, and a page that is whole and safe."""

import json
import re
import shutil
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.colors import to_hex

from cogrip.protocol.settings.room import resolve
from cogrip.results.comparison.common_stretch import common_stretch_s, summary_of_first
from cogrip.results.comparison.differences import (
    MOST_RUNS,
    NOT_SET,
    ComparisonError,
    RunDifference,
    check_comparable,
    differences,
    differences_of_runs,
    labels_of,
    settings_differences,
)
from cogrip.results.plots import compared as plots
from cogrip.results.plots.style import colour, shade
from cogrip.results.reading.traces import Columns, EndTrace, TracedRun, load_run
from cogrip.results.report.compared import compare, is_comparison, write_comparison
from cogrip.results.report.page import render
from cogrip.results.writing.laboratory_run import run_laboratory

from tests.results.reported_runs import SETTINGS as TWO_SECONDS
from tests.results.reported_runs import Page, assert_self_contained

pytestmark = pytest.mark.usefixtures("blank")
THREE = ["first", "soft", "spring"]
SCRIPT = "<script>alert(1)</script>"
SETTINGS: dict[str, Any] = {**TWO_SECONDS, "seconds": 1.0}
BRIEF = {"seconds": 0.25}
OTHERS: dict[str, dict[str, Any]] = {
    "first": {},
    "again": {},
    "soft": {"coupling": {"stiffness_npm": 200.0}},
    "spring": {"coupling": {"kind": "coupling", "stiffness_npm": 2000.0}},
    "axes": {**BRIEF, "object": {"axes": 3}},
    "wall": {**BRIEF, "object": {"kind": "wall"}, "users": [{"name": "anna", "hand": "push"}]},
    "others": {**BRIEF, "users": [{"name": "carl"}, {"name": "dora"}]},
    "anna alone": {**BRIEF, "users": [{"name": "anna", "hand": "reach"}]},
    "ben and carl": {**BRIEF, "users": [{"name": "ben", "hand": "reach"}, {"name": "carl"}]},
}


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One run, the same again, and others."""
    base = tmp_path_factory.mktemp("runs")
    made = {}
    for name, more in OTHERS.items():
        made[name] = base / name
        made[name].mkdir()
        run_laboratory(resolve({**SETTINGS, **more}), made[name])
    return made


@pytest.fixture(scope="module")
def runs(folders: dict[str, Path]) -> dict[str, TracedRun]:
    return {name: load_run(folder) for name, folder in folders.items()}


@pytest.fixture(scope="module")
def page_of_three(blank: None, runs: dict[str, TracedRun]) -> str:
    return compare([runs[name] for name in THREE], THREE)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the plots, which take most of a page's time."""
    monkeypatch.setattr(plots, "compared_plots", lambda *_: iter(()))


def spoilt(folder: Path, base: Path, *missing: str) -> Path:
    """Return a copy of a run without the files of these patterns."""
    copy = Path(shutil.copytree(folder, base / folder.name))
    for pattern in missing:
        for file in copy.glob(pattern):
            file.unlink()
    return copy


def row_of(rows: list[RunDifference], who: str, key: str) -> RunDifference:
    return next(row for row in rows if (row.who, row.quantity.key) == (who, key))


def text_of(page: str) -> str:
    """The page's words, without its pictures and tags."""
    bare = re.sub(r"<style>.*?</style>|<[^>]*>", " ", page, flags=re.DOTALL)
    return unescape(re.sub(r"\s+", " ", bare))


def test_numbers_are_those_of_the_summaries_and_differences_their_differences(runs: dict[str, TracedRun]) -> None:
    summaries = [runs["first"].summary, runs["soft"].summary]
    rows = differences(summaries)
    peak = row_of(rows, "anna", "peak_force_n")
    stiff, soft = (summary["users"][0]["peak_force_n"] for summary in summaries)
    assert peak.values == (stiff, soft)
    assert peak.change(1) == soft - stiff < 0.0
    assert peak.shown()[0] == f"{stiff:.2f}"
    assert re.fullmatch(r"−[\d.]+ \(−[\d.]+ %\)", peak.shown_change(1))
    travel = row_of(rows, "", "object.travel_m")
    assert travel.values[0] == summaries[0]["object"]["travel_m"]
    assert travel.shown()[0] == f"{1e3 * summaries[0]['object']['travel_m']:.1f}"
    assert {row.who for row in rows} == {"", "anna", "ben"}


def test_the_same_run_again_differs_in_nothing(runs: dict[str, TracedRun]) -> None:
    rows = differences([runs["first"].summary, runs["again"].summary])
    assert {row.shown_change(1) for row in rows if row.values[0] is not None} == {"="}
    assert settings_differences([runs["first"].settings, runs["again"].settings]) == []


def test_energies_take_their_unit_and_rounding_is_no_difference() -> None:
    def summary(margin_j: float | None) -> dict[str, Any]:
        return {"users": [{"name": "anna", "energy": {"line_margin_j": margin_j}}]}

    rows = differences([summary(-1e-14), summary(2e-14), summary(-0.0125), summary(None)])
    row = row_of(rows, "anna", "energy.line_margin_j")
    assert row.shown() == ["0 J", "0 J", "−12.5 mJ", "not known"]
    assert [row.shown_change(number) for number in (1, 2, 3)] == ["=", "−12.5 mJ", ""]


values = st.none() | st.floats() | st.booleans() | st.text(max_size=3) | st.lists(st.integers(), max_size=2)
users = st.fixed_dictionaries(
    {"name": st.sampled_from(["anna", "ben"])},
    optional={"peak_force_n": values, "travel_m": values, "energy": values | st.dictionaries(st.text(), values),
              "link": st.fixed_dictionaries({}, optional={"lost": values, "rtt_ms": values})},
)  # fmt: skip
strange = st.fixed_dictionaries({}, optional={"seconds": values, "object": values, "users": values | st.lists(users)})


@given(summaries=st.lists(strange, min_size=2, max_size=4))
def test_no_summary_is_too_strange(summaries: list[dict[str, Any]]) -> None:
    for row in differences(summaries):
        assert len(row.values) == len(row.shown()) == len(summaries)
        for number in range(1, len(summaries)):
            known = row.values[0] is not None and row.values[number] is not None
            assert (row.change(number) is not None) == known == bool(row.shown_change(number))


@given(first=st.floats(1e-3, 1e3), change=st.floats(-1e3, 1e3))
def test_a_difference_has_the_sign_of_the_change(first: float, change: float) -> None:
    row = RunDifference("anna", differences([{"users": [{"name": "anna"}]}] * 2)[2].quantity, (first, first + change))
    shown = row.shown_change(1)
    moved = (first + change) - first
    assert shown[0] == ("=" if not moved else "+" if moved > 0.0 else "−")


KEYS: dict[str, Any] = {
    "seed": 7,
    "coupling.impedance_nspm": 55.0,
    "coupling.encoder": "velocity",
    "object.mass_kg": 3.5,
    "link.loss": 0.25,
    "link.up.delay_ms": 33.0,
    "playout.frames": 5,
    "users.1.stiffness_npm": 77.0,
    "users.0.hand": "hold",
}


@given(changes=st.sets(st.sampled_from(sorted(KEYS)), max_size=4))
def test_exactly_what_was_changed_differs_by_the_name_that_set_has_for_it(changes: set[str]) -> None:
    before = msgspec.to_builtins(resolve(SETTINGS))
    after = msgspec.to_builtins(resolve(SETTINGS, {key: KEYS[key] for key in changes}))
    rows = {row.key: row.values for row in settings_differences([before, after])}
    assert set(rows) == changes
    assert all(rows[key][1] == KEYS[key] for key in changes)


@pytest.mark.usefixtures("undrawn")
def test_settings_are_rounded_for_people_and_say_whose_they_are(runs: dict[str, TracedRun]) -> None:
    """JSON stays exact; a page has six digits. A value that a user does not set is as in its section."""
    first = runs["first"]
    users = [{"name": "anna", "stiffness_npm": None, "force_n": None}]
    other = [{"name": "anna", "stiffness_npm": 250.0, "force_n": 1.5}]
    exact = replace(first, settings={**first.settings, "seconds": 10.585902250499885, "users": users})
    page = text_of(compare([exact, replace(first, settings={**first.settings, "users": other})], ["a", "b"]))
    assert "10.5859 1.0" in page
    assert "10.585902" not in page
    assert "users.0.stiffness_npm as in [coupling] 250.0" in page
    assert "users.0.force_n not set 1.5" in page


def test_a_person_more_is_a_difference(runs: dict[str, TracedRun]) -> None:
    rows = {row.key: row.values for row in settings_differences([runs["anna alone"].settings, runs["first"].settings])}
    assert rows["users.1.name"] == (NOT_SET, "ben")


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["first", "axes"], "its object.axes is 3, not 1"),
        (["first", "soft", "axes"], "axes cannot be compared with first"),
        (["first", "wall"], "its object.kind is 'wall', not 'cube'"),
        (["first", "others"], "nobody held on in both; its people are carl, dora, not anna, ben"),
        (["first", "anna alone", "ben and carl"], "nobody held on in all of them"),
        (["first"], "1 runs cannot be compared"),
        (["first"] * (MOST_RUNS + 1), f"name 2 to {MOST_RUNS}"),
    ],
)
def test_what_cannot_be_compared_is_refused(runs: dict[str, TracedRun], names: list[str], said: str) -> None:
    with pytest.raises(ComparisonError, match=re.escape(said)):
        compare([runs[name] for name in names], names)


@pytest.mark.parametrize(
    ("names", "common"),
    [
        (["first", "soft"], ["anna", "ben"]),
        (["first", "anna alone"], ["anna"]),
        (["first", "ben and carl"], ["ben"]),
        (["first", "spring"], ["anna", "ben"]),
        (["first"] * MOST_RUNS, ["anna", "ben"]),
    ],
)
def test_what_can_be_compared_is(runs: dict[str, TracedRun], names: list[str], common: list[str]) -> None:
    assert check_comparable([runs[name] for name in names], names) == common


def test_what_is_not_known_is_no_reason_to_refuse(
    folders: dict[str, Path], runs: dict[str, TracedRun], tmp_path: Path
) -> None:
    """Without settings the recordings tell the axes, but not the kind of the object."""
    axes, first = (load_run(spoilt(folders[name], tmp_path, "settings.json")) for name in ("axes", "first"))
    assert check_comparable([runs["first"], first], ["a", "b"]) == ["anna", "ben"]
    with pytest.raises(ComparisonError, match="axes is 3, not 1"):
        check_comparable([runs["first"], axes], ["a", "b"])


def test_the_page_has_everything_and_fetches_nothing(page_of_three: str) -> None:
    page, words = page_of_three, text_of(page_of_three)
    assert_self_contained(page, pictures=3)  # positions, forces, energy
    assert "Differences are against the first, first." in words
    assert words.count("no number grew out of bounds") == 2
    assert "the force on ben oscillated" in words, "anna's sat at its limit before"
    assert "coupling.stiffness_npm 1000.0 200.0 2000.0" in words
    assert words.count("peak force [N]") == 2
    assert len(set(re.findall(r'style="color:(#\w+)"', page))) == 3


def test_the_same_runs_give_the_same_page(runs: dict[str, TracedRun], page_of_three: str) -> None:
    assert compare([runs[name] for name in THREE], THREE) == page_of_three


@pytest.mark.usefixtures("undrawn")
def test_people_who_are_not_everywhere_are_left_out_and_named(runs: dict[str, TracedRun]) -> None:
    page = compare([runs["first"], runs["ben and carl"]], ["a", "b"])
    assert "Not in all runs, so left out: anna, carl." in text_of(page)
    assert re.findall(r"<tr class=group><th>(.*?)</th>", page) == ["object and run", "ben"]


@pytest.mark.parametrize(
    ("missing", "said"),
    [(["server.mcap", "settings.json"], "The settings of b are not known."), (["*.mcap"], "no recording")],
)
def test_what_is_missing_of_one_run_is_said(
    folders: dict[str, Path], runs: dict[str, TracedRun], tmp_path: Path, missing: list[str], said: str
) -> None:
    page = compare([runs["first"], load_run(spoilt(folders["soft"], tmp_path, *missing))], ["a", "b"])
    assert said in text_of(page)
    assert page.count("data:image/png") == 3


def test_without_any_recording_there_are_words_in_place_of_plots(folders: dict[str, Path], tmp_path: Path) -> None:
    bare = [load_run(spoilt(folders[name], tmp_path, "*.mcap")) for name in ("first", "soft")]
    page = compare(bare, ["a", "b"])
    assert page.count("Not drawn: ") == 3
    assert "peak force" in page


@pytest.mark.usefixtures("undrawn")
def test_every_text_from_outside_is_escaped(
    folders: dict[str, Path], runs: dict[str, TracedRun], tmp_path: Path
) -> None:
    folder = spoilt(folders["first"], tmp_path)
    files = {name: folder / f"{name}.json" for name in ("summary", "settings")}
    summary, settings = (json.loads(file.read_text()) for file in files.values())
    summary["name"] = settings["name"] = SCRIPT
    settings[SCRIPT] = {SCRIPT: SCRIPT}
    for table in (summary, settings):
        table["users"].append({"name": f"{SCRIPT}$x^$", "state": "fault", "reason": SCRIPT})
    files["summary"].write_text(json.dumps(summary))
    files["settings"].write_text(json.dumps(settings))
    run = load_run(folder)
    for others in (runs["first"], run):
        page = compare([run, others], [SCRIPT, f"{SCRIPT}$x^$"])
        assert "script" not in {tag for tag, _ in Page(page).tags}
        assert "<script" not in page
        assert page.count("&lt;script&gt;") > 5


def test_labels_are_short_where_that_tells_runs_apart(tmp_path: Path) -> None:
    assert labels_of([tmp_path / "a" / "x", tmp_path / "a" / "y"]) == ["x", "y"]
    same = [tmp_path / "a" / "x", tmp_path / "b" / "x"]
    assert labels_of(same) == [str(folder) for folder in same]


@pytest.mark.usefixtures("undrawn")
def test_a_comparison_is_replaced_by_runs_that_can_be_compared_and_nothing_else_is(
    folders: dict[str, Path], tmp_path: Path
) -> None:
    out = tmp_path / "comparison.html"
    pair = [folders["first"], folders["soft"]]
    page, rows, notes = write_comparison(out, pair)
    assert notes == []
    assert page == out
    assert row_of(rows, "anna", "peak_force_n").change(1)
    assert is_comparison(out)
    assert "2 runs compared" in out.read_text(encoding="utf-8")
    write_comparison(out, [*pair, folders["again"]], ["x", "y", "z"])
    assert "3 runs compared" in (before := out.read_text(encoding="utf-8"))
    with pytest.raises(ComparisonError):
        write_comparison(out, [folders["first"], folders["axes"]])
    assert out.read_text(encoding="utf-8") == before, "refused runs leave the page that was there"
    run = spoilt(folders["first"], tmp_path)
    mine = tmp_path / "notes.html"
    mine.write_text("<html>what I thought of it</html>")
    (report := run / "report.html").write_text(render(load_run(run), []))
    for other in (report, mine, tmp_path):
        before = other.read_bytes() if other.is_file() else None
        with pytest.raises(FileExistsError, match="is no comparison of ours"):
            write_comparison(other, pair)
        assert before == (other.read_bytes() if other.is_file() else None)


def test_a_long_run_is_drawn_in_detail_too(runs: dict[str, TracedRun]) -> None:
    """A second drawn out over half a minute."""

    def lasting(seconds: float) -> TracedRun:
        def slowed(trace: Any) -> Any:
            return replace(trace, columns={**trace.columns, "time_s": seconds * trace.columns["time_s"]})

        run = runs["first"]
        return replace(run, clients={who: slowed(one) for who, one in run.clients.items()}, room=slowed(run.room))

    loaded = [lasting(31.0), lasting(33.0), lasting(29.0)]
    headings = [
        [plot.heading for plot in plots.compared_plots(pair, ["a", "b"], ["anna", "ben"])]
        for pair in (loaded[:2], loaded[1:])
    ]
    assert headings[0] == ["Positions", "Positions, in detail", "Forces", "Forces, in detail", "Energy"]
    assert headings[1] == ["Positions", "Forces", "Energy"]
    detail = list(plots.compared_plots(loaded[:2], ["a", "b"], ["anna"]))[1].draw()
    start, end = detail.axes[0].get_xlim()
    assert (start + end) / 2 == pytest.approx(15.5, abs=0.1)
    assert end - start == pytest.approx(5.0)


def test_curves_are_those_of_the_recordings(runs: dict[str, TracedRun]) -> None:
    """A row for each person in their colour, then the object; the first run is broad and pale, the last fine and full."""
    pair = [runs["first"], runs["soft"]]
    positions, forces, _ = (plot.draw() for plot in plots.compared_plots(pair, ["a", "b"], ["anna", "ben"]))
    assert [len(panel.lines) for panel in positions.axes] == [2, 2, 2]
    for panel, name in zip(forces.axes, ("anna", "ben"), strict=True):
        assert panel.get_ylabel() == f"{name}: force [N]"
        for line, run in zip(panel.lines, pair, strict=True):
            values = run.clients[name].columns["force_n"][:, 0]
            assert line.get_ydata()[-1] == values[-1]
            assert np.max(np.abs(line.get_ydata())) == np.max(np.abs(values))
    for number, panel in enumerate(forces.axes):
        first, last = panel.lines
        assert to_hex(last.get_color()) == to_hex(colour(number))
        assert to_hex(first.get_color()) == to_hex(shade(colour(number), 0.45))
        assert first.get_linewidth() > last.get_linewidth()


@pytest.mark.parametrize("name", ["first", "spring"])
def test_the_reserve_of_the_whole_line_is_never_below_the_least_that_the_summary_says(
    runs: dict[str, TracedRun], name: str
) -> None:
    run = runs[name]
    for number, who in enumerate(("anna", "ben")):
        curve = plots.whole_line(run, who)
        assert np.nanmin(curve.values) >= run.summary["users"][number]["energy"]["line_margin_j"] - 1e-12
        assert np.nanmax(curve.values) > 0.0


@pytest.mark.usefixtures("undrawn")
def test_runs_of_unequal_length_are_compared_over_what_all_have(runs: dict[str, TracedRun]) -> None:
    """The first quarter of a run differs in nothing from that run, though its totals are far smaller."""
    whole = runs["first"]
    part = cut_at(whole, 0.25)
    rows, notes = differences_of_runs([whole, part], ["whole", "part"])
    assert {row.shown_change(1) for row in rows if row.quantity.key != "seconds"} == {"="}
    assert {row.who for row in rows} == {"", "anna", "ben"}
    assert row_of(rows, "anna", "travel_m").values[0] < 0.9 * whole.summary["users"][0]["travel_m"]
    (note,) = notes
    assert note.startswith(
        "Not equally long (whole: 1.00 s; part: 0.25 s). All numbers but the length are of the first 0.25 s"
    )
    words = text_of(compare([whole, part], ["whole", "part"], ["Interrupted: 'part' was cut short."]))
    assert words.index("Interrupted: 'part'") < words.index(note) < words.index("Numbers")


@pytest.mark.parametrize("name", ["first", "spring"])
def test_over_its_whole_length_a_run_tells_what_its_summary_does(runs: dict[str, TracedRun], name: str) -> None:
    run = runs[name]
    found = differences([run.summary, summary_of_first(run, 1.0)])
    known = [row for row in found if row.values[1] is not None]
    assert {row.quantity.key for row in known} >= {
        "peak_force_n", "travel_m", "energy.line_margin_j", "link.lost", "object.travel_m",
    }  # fmt: skip
    for row in known:
        assert row.values[1] == pytest.approx(row.values[0], rel=0.02, abs=1e-9), row


@pytest.mark.parametrize(("seconds", "stretch_s"), [(0.992, None), (0.988, 0.988)])
def test_lengths_that_hardly_differ_are_taken_as_equal(
    runs: dict[str, TracedRun], seconds: float, stretch_s: float | None
) -> None:
    found = common_stretch_s([runs["first"], cut_at(runs["first"], seconds)])
    assert found == (stretch_s and pytest.approx(stretch_s, abs=1 / 128))


def cut_at(run: TracedRun, seconds: float) -> TracedRun:
    """Return a run as if it had ended by then, with the summary of the whole."""

    def part(trace: EndTrace) -> EndTrace:
        columns, rows = Columns(), int(np.searchsorted(trace.time_s, seconds))
        columns.extend({name: values[:rows] for name, values in trace.columns.items()})
        return EndTrace(trace.who, trace.rate_hz, columns, rows)

    return replace(run, clients={who: part(each) for who, each in run.clients.items()}, room=part(run.room))


@pytest.mark.parametrize(
    ("note", "html"),
    [
        ("say `a <b>` now", "say <code>a &lt;b&gt;</code> now"),
        ("one ` alone", "one ` alone"),
        ("`x`, `y` and ` z", "<code>x</code>, <code>y</code> and ` z"),
        ("<i>", "&lt;i&gt;"),
    ],
)
@pytest.mark.usefixtures("undrawn")
def test_backticks_make_code_and_nothing_else(runs: dict[str, TracedRun], note: str, html: str) -> None:
    page = compare([runs["first"], runs["again"]], ["a", "b"], [note])
    assert html in page
