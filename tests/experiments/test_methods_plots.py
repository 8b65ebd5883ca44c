"""Tests of the plots of a comparison, of made-up results: names, heights of rows, beginnings of axes."""

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from cogrip.experiments.experiment import Result
from cogrip.experiments.methods import looks, plots
from cogrip.experiments.methods.looks import style_of
from cogrip.experiments.methods.measures import COLUMNS
from cogrip.experiments.methods.plots import draw_all
from cogrip.experiments.methods.query import ComparisonQuery, prepare
from cogrip.experiments.methods.table import gather, verdict
from cogrip.protocol.settings.room import resolve
from cogrip.results.plots.style import ALARM, COLOURS, INK, NotDrawnError

from tests.extent import long

METHODS = ("wave", "coupling")


def made_up(people: int = 2, seeds: int = 2, methods: tuple[str, ...] = METHODS) -> ComparisonQuery:
    users = [{"name": f"p{number}", "stiffness_npm": 1000.0 * (1 + number % 2)} for number in range(people)]
    return prepare(resolve({"seconds": 4.0, "users": users}), methods, ["wan"], seeds)


def results_of(asked: ComparisonQuery, **columns: Any) -> dict[int, Result]:
    """Each column: (of the first method, of the second), on both networks and of all seeds."""
    found = {}
    for case in range(asked.cases):
        method = asked.methods.index(asked.values(case)["method"])
        numbers = dict.fromkeys(COLUMNS, 1.0) | {
            "diverged": False, "diverged_s": None, "reason": "", "oscillates": False, "passive": True,
            "felt": [], "not_felt": "",
        }  # fmt: skip
        found[case] = Result(case, numbers | {name: both[method] for name, both in columns.items()})
    return found


def draw(asked: ComparisonQuery, results: dict[int, Result], name: str) -> Figure | None:
    """Draw this plot and no other; None where there is nothing to draw."""

    def nothing(*_: Any) -> Figure:
        raise NotDrawnError

    functions = {"stability": "_stability", "traces": "draw_traces", "forces": "_dots", "felt": "_felt"}
    with pytest.MonkeyPatch.context() as patch:
        for function in set(functions.values()) - {functions[name]}:
            patch.setattr(plots, function, nothing)
        drawn = draw_all(asked, results, gather(asked, results))
        return next((plot.figure for plot in drawn if plot.name == name), None)


def trace(most_n: float, people: int, seconds: float = 4.0) -> dict[str, Any]:
    return {"seconds": seconds, "force_n": [[0.0, most_n, -most_n, 0.0]] * people}


def felt_by(person: str, asked_npm: float) -> dict[str, Any]:
    """Return what somebody felt: 500 N/m."""
    return {"person": person, "asked_npm": asked_npm, "felt_npm": 500.0, "error_percent": 0.0, "added_mm_per_n": 0.0}


def with_trace(result: Result) -> Result:
    return Result(result.case, {**result.measures, "trace": trace(1.0, 2)})


def colour_of(look: Any) -> tuple[float, ...]:
    """Return red, green and blue."""
    return to_rgb(look)


@pytest.mark.long
@pytest.mark.parametrize(("people", "named"), [(2, 2), long(COLOURS, COLOURS), (COLOURS + 2, COLOURS)])
def test_everybody_is_named_or_said_to_be_left_out(people: int, named: int) -> None:
    asked = made_up(people)
    figure = draw(asked, results_of(asked, trace=[trace(1.0, people)] * 2), "traces")
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts[:named] == [f"p{number}" for number in range(named)]
    more = [f"and {people - named} more, in the same shades again"] if people > named else []
    assert texts[named:] == [
        *more, "band: from the least to the largest", "diverged", "a panel without a verdict: stable and passive",
        "wave: cogrip's waves", "coupling: virtual coupling",
    ]  # fmt: skip
    looks = {(line.get_color(), line.get_marker()) for line in figure.legends[0].get_lines()[:named]}
    assert len(looks) == named


def test_a_row_is_as_high_as_its_stable_sessions_need() -> None:
    asked = made_up()
    results = results_of(asked, trace=[trace(2.0, 2), trace(8.5, 2, 0.25)], diverged=[False, True], diverged_s=[None, 0.25],
                         reason=["", "gone at"])  # fmt: skip
    figure = draw(asked, results, "traces")
    for panel in figure.axes:
        assert panel.get_ylim() == (-2.4, 2.4)
    words = [[text.get_text() for text in panel.texts] for panel in figure.axes]
    assert words == [["seed 1"], ["diverged at 0.25 s\nup to 8.5 N", "seed 1"]] * 2
    worse = results_of(asked, trace=[trace(8.5, 2), trace(6.0, 2)], oscillates=[True, True])
    assert draw(asked, worse, "traces").axes[0].get_ylim() == pytest.approx((-10.2, 10.2))


@pytest.mark.parametrize(
    ("values", "scale", "begins", "labels"),
    [
        ((1.0, 30.0), "linear", 0.0, ["0"]),
        ((1.0, 31.0), "log", 1.0, ["1"]),
        ((0.0, 8.5), "linear", 0.0, ["0"]),
        ((0.0, 0.0), "linear", 0.0, ["0.0"]),
        ((0.97, 30.0), "log", 0.5, ["0.5"]),
        ((0.078, 9.0), "log", 0.03, ["0.03"]),
        ((2.5, 90.0), "log", 2.0, ["2"]),
        ((0.0012, 0.5), "log", 1e-3, ["$10^{-3}$", r"$3{\cdot}10^{-3}$", "0.01", "0.03", "0.1", "0.3"]),
        ((0.0025, 0.1), "log", 2e-3, [r"$2{\cdot}10^{-3}$", r"$5{\cdot}10^{-3}$", "0.01", "0.02", "0.05", "0.1"]),
        ((110.0, 6e3), "log", 100.0, ["100", "200", "500", "$10^{3}$", r"$2{\cdot}10^{3}$", r"$5{\cdot}10^{3}$"]),
    ],
)
def test_an_axis_is_logarithmic_where_values_spread_far_and_begins_just_below_the_least(
    values: tuple[float, float], scale: str, begins: float, labels: list[str]
) -> None:
    panel = draw(asked := made_up(), results_of(asked, peak_force_n=values), "forces").axes[0]
    assert panel.get_yscale() == scale
    low, high = panel.get_ylim()
    assert low == pytest.approx(begins)
    assert high > max(values)
    texts = [label.get_text() for label in panel.get_yticklabels()]
    assert texts[: len(labels)] == labels
    assert len(set(texts)) == len(texts), "every tick has its own label"


def test_what_is_less_than_the_axis_stands_on_its_edge_and_the_axis_says_so() -> None:
    asked = made_up()
    results = results_of(asked, created_mj=(0.2, 5e7))
    results[0].measures["created_mj"] = 0.0
    panel = draw(asked, results, "stability").axes[1]
    labels = [label.get_text() for label in panel.get_yticklabels()]
    assert panel.get_ylim()[0] == pytest.approx(0.1)
    assert labels[0] == "≤ 0.1"
    assert len(labels) <= 8
    marks = np.concatenate([line.get_ydata() for line in panel.get_lines() if line.get_marker() == "o"])
    assert marks.min() == pytest.approx(0.1)


def test_everybodys_felt_stiffness_is_a_share_of_their_own() -> None:
    felt = [felt_by("p0", 1000.0), felt_by("p1", 2000.0)]
    asked = made_up()
    none = [{**each, "felt_npm": None} for each in felt]
    panel = draw(asked, results_of(asked, felt=[felt, none]), "felt").axes[0]
    shares = [line.get_ydata() for line in panel.get_lines() if line.get_marker() == "o"]
    assert [list(each) for each in shares] == [[50.0, 25.0]] * 2
    assert sum(line.get_marker() == "_" for line in panel.get_lines()) == 2
    assert [text.get_text() for text in panel.texts] == ["500"] * 2
    for text, marks in zip(panel.texts, (line for line in panel.get_lines() if line.get_marker() == "o"), strict=True):
        assert text.xy == (marks.get_xdata()[1], 25.0)  # at the lowest mark
    one = [felt[0], none[1]]
    panel = draw(asked, results_of(asked, felt=[one, one]), "felt").axes[0]
    dashes = [line for line in panel.get_lines() if line.get_marker() == "_"]
    assert [len(line.get_xdata()) for line in dashes] == [1] * 4  # who feels none has a place
    assert [list(line.get_ydata()) for line in panel.get_lines() if line.get_marker() == "o"] == [[50.0]] * 2
    much = [{**felt[0], "felt_npm": 1300.0}, felt[1]]
    assert draw(asked, results_of(asked, felt=[much, much]), "felt").axes[0].get_ylim()[1] > 130.0
    assert draw(asked, results_of(asked, felt=[none, none]), "felt") is None
    figure = draw(asked, results_of(asked, felt=[felt, felt], oscillates=[False, True]), "felt")
    crosses = [line for line in figure.axes[0].get_lines() if line.get_marker() == "x"]
    assert [len(line.get_xdata()) for line in crosses] == [1] * 2  # what is unstable has a mark of its own
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words[2:4] == ["unstable", "not measured, or no rest"]


# What figure and table say alike


def test_a_figure_has_the_verdicts_of_the_table() -> None:
    """Two schemes on a clean link: one passive, one stable only as hands take what it creates."""
    asked = made_up()
    results = results_of(asked, passive=[True, False], created_mj=(0.7, 0.01))
    assert [verdict(row) for row in gather(asked, results)["rows"]] == ["stable", "stable, not passive 2/2"] * 2
    figure = draw(asked, results, "stability")
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"diverged, not passive", "oscillates, passive", "unstable, not passive", "unstable, passive"} <= set(words)
    assert {"stable, not passive", "stable and passive"} <= set(words)
    shares, energy = figure.axes
    assert [text.get_text() for text in shares.texts] == ["2"] * 2
    pale = figure.legends[0].get_patches()[4]
    assert words[len(METHODS) + 5] == "stable, not passive"
    assert [(bar.get_height(), bar.get_alpha()) for bar in shares.patches] == [(100.0, pale.get_alpha())] * 2
    assert all(colour_of(bar.get_facecolor()) == colour_of(style_of("coupling")["color"]) for bar in shares.patches)
    fills = {line.get_marker(): line.get_fillstyle() for line in energy.get_lines() if line.get_marker() in ("o", "v")}
    assert fills == {"o": "full", "v": "bottom"}
    panels = draw(asked, {case: with_trace(each) for case, each in results.items()}, "traces").axes
    assert [[text.get_text() for text in panel.texts] for panel in panels] == [
        ["seed 1"],
        ["stable, not passive", "seed 1"],
    ] * 2
    assert panels[1].texts[0].get_color() == looks.WARNING != ALARM


def test_what_is_unstable_is_hollow_and_has_a_share_of_its_own() -> None:
    asked = made_up()
    results = results_of(asked, passive=[True, False], oscillates=[False, True], created_mj=(0.7, 90.0))
    results[max(results)].measures.update(diverged=True, oscillates=False, diverged_s=0.3)
    row = gather(asked, results)["rows"][-1]
    assert verdict(row) == "diverged 1/2 at 0.3 s, oscillates 1/2, not passive 2/2"
    shares, energy = draw(asked, results, "stability").axes
    assert [(bar.get_y(), bar.get_height()) for bar in shares.patches] == [(0.0, 100.0), (0.0, 50.0), (50.0, 50.0)]
    hollow = [line for line in energy.get_lines() if line.get_marker() == "v"]
    assert {(line.get_fillstyle(), line.get_markerfacecolor()) for line in hollow} == {("full", "white")}
    medians = [line for line in energy.get_lines() if line.get_marker() == "None"]
    assert max(line.get_zorder() for line in medians) < min(line.get_zorder() for line in hollow), "marks are above"


def test_what_is_unstable_and_passive_is_told_from_what_is_not_passive() -> None:
    asked = made_up(methods=("coupling", "tdpa"))
    results = results_of(asked, passive=[False, True], oscillates=[True, True], created_mj=(90.0, 1.0))
    shares, energy = draw(asked, results, "stability").axes
    white = [colour_of(bar.get_facecolor()) == colour_of("white") for bar in shares.patches]
    assert white == [False, True] * 2
    marks = {line.get_marker(): line for line in energy.get_lines() if line.get_marker() in ("v", "<")}
    assert marks["v"].get_markerfacecolor() == "white"
    assert marks["<"].get_markerfacecolor() == style_of("tdpa")["color"]
    assert marks["<"].get_markeredgecolor() == INK
    captions = [plot.caption for plot in draw_all(asked, results, gather(asked, results)) if plot.name == "stability"]
    assert "coupling 1 mJ, tdpa 1 mJ." in captions[0]


@pytest.mark.parametrize("methods", [("wave", "coupling"), ("coupling", "tdpa"), ("tdpa", "coupling")])
@pytest.mark.parametrize("name", ["stability", "forces", "felt", "traces"])
def test_a_method_has_one_colour_whatever_it_is_compared_with(methods: tuple[str, str], name: str) -> None:
    asked = made_up(methods=methods)
    felt = [felt_by("p0", 1000.0)]
    results = {case: with_trace(each) for case, each in results_of(asked, felt=[felt, felt]).items()}
    figure = draw(asked, results, name)
    known = [style_of(method)["color"] for method in methods]
    if name == "traces":
        panels = [panel.get_lines()[0].get_color() for panel in figure.axes[:2]]
        assert [colour_of(each) for each in panels] == [colour_of(each) for each in known]
        return
    named = [line.get_color() for line in figure.legends[0].get_lines()[:2]]
    assert named == known
    drawn = [line for panel in figure.axes for line in panel.get_lines() if line.get_marker() in looks.MARKERS]
    assert {line.get_color() for line in drawn} == set(known)


def test_every_method_has_a_marker_and_a_hue_that_no_other_one_has() -> None:
    """One that is another one, only darker, is told from it by its marker alone."""
    styles = [style_of(method) for method in looks.METHODS]
    assert len({style["marker"] for style in styles}) == len(looks.METHODS)
    for one, other in combinations([np.array(to_rgb(style["color"])) for style in styles], 2):
        assert np.linalg.norm(np.cross(one, other)) > 0.1 * np.linalg.norm(one) * np.linalg.norm(other), (
            "not only darker"
        )
        assert np.abs(one - other).max() > 0.15


def test_a_trace_is_of_the_median_session_and_says_its_seed() -> None:
    """The order of five seeds is that of verdicts first: what diverged is worse than any force."""
    asked = made_up(seeds=5)
    results = {case: with_trace(each) for case, each in results_of(asked).items()}
    for case, result in results.items():
        values = asked.values(case)
        result.measures["peak_force_n"] = {1: 5.0, 2: 1.0, 3: 4.0, 4: 2.0, 5: 3.0}[values["seed"]]
        if values["method"] == "coupling" and values["seed"] in (2, 4):
            result.measures.update(diverged=True, diverged_s=1.0)
    panels = draw(asked, results, "traces").axes
    assert [panel.texts[-1].get_text() for panel in panels] == ["seed 5", "seed 1"] * 2
    assert gather(asked, results)["rows"][0]["peak_force_n"]["median"] == 3.0, "of the same session"


def test_every_row_of_traces_names_its_network_within_the_figure() -> None:
    asked = made_up()
    figure = draw(asked, {case: with_trace(each) for case, each in results_of(asked).items()}, "traces")
    rows = [panel.yaxis.label for panel in figure.axes[::2]]
    assert [label.get_text().split("\n")[0] for label in rows] == ["clean", "wan"]
    for label in rows:
        assert label.get_window_extent().x0 >= 0.0, "nothing is cut off"
