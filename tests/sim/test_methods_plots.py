"""Tests of the plots of a comparison, of made-up results: names, heights of rows, beginnings of axes."""

from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from cogrip.protocol.settings import resolve
from cogrip.sim.experiments.experiment import Result
from cogrip.sim.experiments.methods import plots
from cogrip.sim.experiments.methods.measures import COLUMNS
from cogrip.sim.experiments.methods.plots import draw_all
from cogrip.sim.experiments.methods.query import Comparison, prepare
from cogrip.sim.experiments.methods.table import gather
from cogrip.sim.runs.plots.style import COLOURS, NotDrawnError

from tests.extent import long

METHODS = ("wave", "coupling")


def made_up(people: int = 2) -> Comparison:
    users = [{"name": f"p{number}", "stiffness_npm": 1000.0 * (1 + number % 2)} for number in range(people)]
    return prepare(resolve({"seconds": 4.0, "users": users}), METHODS, ["wan"], 2)


def results_of(asked: Comparison, **columns: Any) -> dict[int, Result]:
    """Each column: (of wave, of coupling), on both networks and of both seeds."""
    found = {}
    for case in range(asked.cases):
        method = METHODS.index(asked.values(case)["method"])
        numbers = dict.fromkeys(COLUMNS, 1.0) | {
            "diverged": False, "diverged_s": None, "reason": "", "oscillates": False, "active": False, "passive": True,
            "felt": [],
        }  # fmt: skip
        found[case] = Result(case, numbers | {name: both[method] for name, both in columns.items()})
    return found


def draw(asked: Comparison, results: dict[int, Result], name: str) -> Figure | None:
    """Draw this plot and no other; None where there is nothing to draw."""

    def nothing(*_: Any) -> Figure:
        raise NotDrawnError

    functions = {"stability": "_stability", "traces": "_traces", "forces": "_dots", "felt": "_felt"}
    with pytest.MonkeyPatch.context() as patch:
        for function in set(functions.values()) - {functions[name]}:
            patch.setattr(plots, function, nothing)
        drawn = draw_all(asked, results, gather(asked, results))
        return next((plot.figure for plot in drawn if plot.name == name), None)


def trace(most_n: float, people: int, seconds: float = 4.0) -> dict[str, Any]:
    return {"seconds": seconds, "force_n": [[0.0, most_n, -most_n, 0.0]] * people}


@pytest.mark.long
@pytest.mark.parametrize(("people", "named"), [(2, 2), long(COLOURS, COLOURS), (COLOURS + 2, COLOURS)])
def test_everybody_is_named_or_said_to_be_left_out(people: int, named: int) -> None:
    asked = made_up(people)
    figure = draw(asked, results_of(asked, trace=[trace(1.0, people)] * 2), "traces")
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts[:named] == [f"p{number}" for number in range(named)]
    more = [f"and {people - named} more, in the same colours again"] if people > named else []
    assert texts[named:] == [*more, "band: from the least to the largest", "diverged"]
    looks = {(line.get_color(), line.get_marker()) for line in figure.legends[0].get_lines()[:named]}
    assert len(looks) == named
    assert len({look for look, _ in looks}) == named


def test_a_row_is_as_high_as_its_stable_sessions_need() -> None:
    asked = made_up()
    results = results_of(asked, trace=[trace(2.0, 2), trace(8.5, 2, 0.25)], diverged=[False, True], diverged_s=[None, 0.25],
                         reason=["", "gone at"])  # fmt: skip
    figure = draw(asked, results, "traces")
    for panel in figure.axes:
        assert panel.get_ylim() == (-2.4, 2.4)
    words = [[text.get_text() for text in panel.texts] for panel in figure.axes]
    assert words == [[], ["diverged at 0.25 s\nup to 8.5 N"]] * 2
    worse = results_of(asked, trace=[trace(8.5, 2), trace(6.0, 2)], oscillates=[True, True])
    assert draw(asked, worse, "traces").axes[0].get_ylim() == pytest.approx((-10.2, 10.2))


@pytest.mark.parametrize(
    ("values", "scale", "begins", "first"),
    [
        ((1.0, 30.0), "linear", 0.0, "0"),
        ((1.0, 31.0), "log", 1.0, "1"),
        ((0.0, 8.5), "linear", 0.0, "0"),
        ((0.0, 0.0), "linear", 0.0, "0"),
    ],
)
def test_an_axis_is_logarithmic_where_values_spread_far(
    values: tuple[float, float], scale: str, begins: float, first: str
) -> None:
    asked = made_up()
    panel = draw(asked, results_of(asked, peak_force_n=values), "forces").axes[0]
    assert panel.get_yscale() == scale
    low, high = panel.get_ylim()
    assert low == begins
    assert high > max(values)
    assert panel.get_yticklabels()[0].get_text().startswith(first)


@pytest.mark.parametrize(("least", "begins", "first"), [(0.97, 0.5, "0.5"), (0.078, 0.03, "0.03"), (2.5, 2.0, "2")])
def test_an_axis_begins_just_below_the_least_value(least: float, begins: float, first: str) -> None:
    asked = made_up()
    most = 90.0 if least > 2.0 else 9.0 if least < 0.1 else 30.0
    panel = draw(asked, results_of(asked, force_step_n=(least, most)), "forces").axes[1]
    assert panel.get_ylim()[0] == pytest.approx(begins)
    assert panel.get_yticklabels()[0].get_text() == first


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
    felt = [
        {
            "person": f"p{n}",
            "asked_npm": 1000.0 * (1 + n),
            "felt_npm": 500.0,
            "error_percent": 0.0,
            "added_mm_per_n": 0.0,
        }
        for n in range(2)
    ]
    asked = made_up()
    none = [{**felt[0], "felt_npm": None}, {**felt[1], "felt_npm": None}]
    panel = draw(asked, results_of(asked, felt=[felt, none]), "felt").axes[0]
    shares = [line.get_ydata() for line in panel.get_lines() if line.get_marker() == "o"]
    assert [list(each) for each in shares] == [[50.0, 25.0]] * 2
    assert sum(line.get_marker() == "x" for line in panel.get_lines()) == 2
    assert [text.get_text() for text in panel.texts] == ["500"] * 2
    for text, marks in zip(panel.texts, (line for line in panel.get_lines() if line.get_marker() == "o"), strict=True):
        assert text.xy == (marks.get_xdata()[1], 25.0)  # at the lowest mark
    one = [felt[0], none[1]]
    panel = draw(asked, results_of(asked, felt=[one, one]), "felt").axes[0]
    crosses = [line for line in panel.get_lines() if line.get_marker() == "x"]
    assert [len(line.get_xdata()) for line in crosses] == [1] * 4  # who feels none has a place
    assert [list(line.get_ydata()) for line in panel.get_lines() if line.get_marker() == "o"] == [[50.0]] * 2
    much = [{**felt[0], "felt_npm": 1300.0}, felt[1]]
    assert draw(asked, results_of(asked, felt=[much, much]), "felt").axes[0].get_ylim()[1] > 130.0
    assert draw(asked, results_of(asked, felt=[none, none]), "felt") is None
