"""Rules of every picture and page, so that it can stand in a paper: units, legends, colours, nothing cut off."""

import json
import re
from contextlib import suppress
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import PolyCollection, QuadMesh
from matplotlib.colors import to_hex, to_rgb
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from scipy import signal  # type: ignore[import-untyped]

from cogrip.analysis.figures import wall_contact
from cogrip.analysis.figures.decimators import decimator_page
from cogrip.analysis.figures.feel import feel_page
from cogrip.analysis.figures.page import FigurePage
from cogrip.analysis.figures.paper_regions import paper_settings
from cogrip.analysis.figures.region import region_page
from cogrip.analysis.linear.linear_session import linear_session
from cogrip.analysis.linear.region import regions
from cogrip.experiments.experiment import Result
from cogrip.experiments.sweep.grid import Grid, parse_axis
from cogrip.experiments.sweep.measures import LIFTED
from cogrip.experiments.sweep.picture import draw_measure
from cogrip.protocol.recording.header import versions_here
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.version import VERSION
from cogrip.results.plots import style
from cogrip.results.plots.coherence import correlation
from cogrip.results.plots.compared import compared_plots
from cogrip.results.plots.motion import forces, positions
from cogrip.results.plots.registry import PLOTS
from cogrip.results.plots.spectra import correlation_near, cross_densities
from cogrip.results.plots.style import COLOURS, NotDrawnError, colour, person_style
from cogrip.results.reading.traces import TracedRun, load_run
from cogrip.results.report.compared import compare
from cogrip.results.report.page import render
from cogrip.results.writing.laboratory_run import run_laboratory

from tests.results.reported_runs import Page as Tags

NAMED = re.compile(r"\S.* \[\S.*\]", re.DOTALL)
CROWDS = (1, 2, 8)
BESIDE_IN = 0.01
RADIUS = "lifted.radius_without_structural"


@cache
def fig5() -> FigurePage:
    """Draw the wall of short contacts: what they measure is no matter of the picture."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wall_contact, "SECONDS", 1.3)
        return wall_contact.wall_page()


@pytest.fixture(scope="module")
def crowds(tmp_path_factory: pytest.TempPathFactory) -> dict[int, TracedRun]:
    """Runs of so many people; of two of them along three axes."""
    found = {}
    for people in CROWDS:
        folder = tmp_path_factory.mktemp(f"people-{people}")
        users = [{"name": f"p{number}", "hand": "reach" if number % 2 else "sine"} for number in range(people)]
        object_ = {"axes": 3 if people == 2 else 1}
        table = {"name": "crowd", "seconds": 0.3, "rates": {"device_hz": 512}, "object": object_, "users": users}
        run_laboratory(resolve(table), folder)
        found[people] = load_run(folder)
    return found


@pytest.fixture(scope="module")
def drawn_of(crowds: dict[int, TracedRun]) -> dict[int, dict[str, Figure]]:
    """Every plot of these runs, by its name."""
    found: dict[int, dict[str, Figure]] = {people: {} for people in crowds}
    for people, plot in product(crowds, PLOTS):
        with suppress(NotDrawnError):
            found[people][plot.name] = plot.draw(crowds[people])
    return found


def check(figure: Figure) -> None:
    """Labels name a quantity and its unit; every text is inside the figure; the legend lies on no panel's text."""
    for panel in figure.axes:
        if not panel.get_visible():
            continue
        for text in (panel.get_xlabel(), panel.get_ylabel()):
            assert not text or NAMED.fullmatch(text), text
        assert all("(N" not in each and "(s)" not in each for each in (panel.get_xlabel(), panel.get_ylabel()))
    drawn, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    assert drawn.x0 >= -BESIDE_IN
    assert drawn.y0 >= -BESIDE_IN
    assert drawn.x1 <= width + BESIDE_IN
    assert drawn.y1 <= height + BESIDE_IN
    for legend in figure.legends:
        area = legend.get_window_extent()
        for panel in figure.axes:
            if panel.get_visible():
                assert not area.overlaps(panel.get_tightbbox()), panel.get_title(loc="left")


def tints(figure: Figure) -> dict[str, tuple[str, str]]:
    """Colour and marker of each person in a legend."""
    (legend,) = figure.legends
    lines = dict(zip((text.get_text() for text in legend.get_texts()), legend.legend_handles, strict=True))
    return {
        name: (to_hex(line.get_color()), str(line.get_marker()))
        for name, line in lines.items()
        if re.fullmatch(r"p\d+", name)
    }


@pytest.mark.sample(1)
@pytest.mark.parametrize("people", CROWDS)
def test_every_plot_of_a_run_could_stand_in_a_paper(drawn_of: dict[int, dict[str, Figure]], people: int) -> None:
    drawn = drawn_of[people]
    assert {"positions", "forces", "waves", "link"} <= set(drawn)
    for name, figure in drawn.items():
        if name != "energy":
            check(figure)


def test_the_same_run_gives_the_same_picture(crowds: dict[int, TracedRun], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(style, "DPI", 30)
    (plot,) = (plot for plot in PLOTS if plot.name == "waves")
    drawn, again = (style.png(plot.draw(crowds[1])) for _ in range(2))
    assert drawn.startswith(b"\x89PNG")
    assert drawn == again


@pytest.mark.long
def test_a_bar_at_the_head_stands_while_a_button_is_down(tmp_path: Path) -> None:
    """Draw it of the client's record, and of the server's where the client's is not here."""
    users = [{"name": "a", "device": "sim:phantom?press=1@0.2+0.1,2@0.25+0.2"}, {"name": "b"}]
    run_laboratory(resolve({"seconds": 1.0, "users": users}), tmp_path)
    run = load_run(tmp_path)
    for shown in (run, replace(run, clients={})):
        for figure in (positions(shown), forces(shown)):
            (bar,) = [each for panel in figure.axes for each in panel.collections if isinstance(each, PolyCollection)]
            (path,) = bar.get_paths()
            (first_s, _), (last_s, _) = path.vertices.min(axis=0), path.vertices.max(axis=0)
            assert first_s == pytest.approx(0.2, abs=0.01)
            assert last_s == pytest.approx(0.45, abs=0.01)
            assert to_hex(bar.get_facecolor()[0]) == to_hex(colour(0))
            assert "a button is down" in [text.get_text() for text in figure.legends[0].get_texts()][-1]
    (tmp_path / "bare").mkdir()
    run_laboratory(resolve({"seconds": 1.0, "users": [{"name": "a"}, {"name": "b"}]}), tmp_path / "bare")
    bare = positions(load_run(tmp_path / "bare"))
    assert not [each for panel in bare.axes for each in panel.collections if isinstance(each, PolyCollection)]


@pytest.mark.sample(1)
@pytest.mark.parametrize("people", CROWDS)
def test_a_person_has_one_colour_and_one_marker_everywhere(
    crowds: dict[int, TracedRun], drawn_of: dict[int, dict[str, Figure]], people: int
) -> None:
    run = crowds[people]
    looks = [
        tints(figure) for name, figure in drawn_of[people].items() if name in ("positions", "forces", "waves", "link")
    ]
    wanted = {
        f"p{number}": (to_hex(colour(number)), person_style(number)["marker"]) for number in range(min(people, COLOURS))
    }
    assert looks == [wanted] * 4
    compared = next(iter(compared_plots([run, run], ["a", "b"], list(run.names)))).draw()
    rows = np.array(compared.axes).reshape(-1, 3 if people == 2 else 1)[:-1]
    for number, row in enumerate(rows):
        for panel in row:
            assert to_hex(panel.lines[-1].get_color()) == to_hex(colour(number))
    check(compared)


def test_people_are_told_apart_in_grey_print() -> None:
    looks = [(to_rgb(style["color"]), style["marker"]) for style in map(person_style, range(COLOURS))]
    assert len(set(looks)) == COLOURS
    assert len({marker for _, marker in looks[:6]}) == 6


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    "make",
    [
        fig5,
        decimator_page,
        lambda: feel_page(linear_session(paper_settings("paper")), 1),
        lambda: region_page(*regions(paper_settings("paper"), (0.0, 1.0)), "constant delays"),
    ],
    ids=["fig5", "decimators", "feel", "region"],
)
def test_every_figure_could_stand_in_a_paper(make: Any) -> None:
    page: FigurePage = make()
    check(page.figure)


def test_the_legend_of_the_wall_names_every_line() -> None:
    texts = [text.get_text() for text in fig5().figure.legends[0].get_texts()]
    assert texts == [
        "the paper's scheme", "ours, b = 20 N s/m", "compensated, b = 20 and 30 N s/m (left and right)",
        "hand, and the force on it", "proxy at the wall",
    ]  # fmt: skip


def grid_of(*vary: str) -> Grid:
    users = [{"name": "anna"}, {"name": "ben"}]
    return Grid({"users": users}, [parse_axis(text) for text in vary])


SMALL = grid_of("users.0.stiffness_npm=1:3:3", "users.1.stiffness_npm=1:4:4")


def results(grid: Grid, measure: str, value: Any) -> dict[int, Result]:
    return {case: Result(case, {measure: value(case)}) for case in grid}


def meshes(figure: Figure) -> list[QuadMesh]:
    return [
        each for panel in figure.axes for each in panel.collections if isinstance(each, QuadMesh) and panel.get_xlabel()
    ]


@pytest.mark.parametrize("order", ["100:4000:5", "4000,100,2000"])
def test_a_heat_map_ends_where_the_cells_end(order: str) -> None:
    grid = grid_of("users.0.stiffness_npm=200:20000:4log", f"users.1.stiffness_npm={order}")
    radii = results(grid, RADIUS, lambda case: 0.9 + 0.001 * grid.values(case)["users.1.stiffness_npm"])
    figure = draw_measure(grid, radii, RADIUS)
    check(figure)
    (mesh,) = meshes(figure)
    panel = mesh.axes
    assert panel.get_xlim() == pytest.approx((100.0, 4000.0))
    assert panel.get_ylim() == pytest.approx((200.0, 20000.0))
    corners = mesh.get_coordinates().reshape(-1, 2)
    assert corners.min(axis=0).tolist() == pytest.approx([100.0, 200.0])
    assert corners.max(axis=0).tolist() == pytest.approx([4000.0, 20000.0])
    assert (panel.get_xlabel(), panel.get_ylabel()) == ("ben: stiffness [N/m]", "anna: stiffness [N/m]")
    values = np.ma.getdata(mesh.get_array())
    assert np.all(np.diff(values.reshape(4, -1), axis=1) > 0.0)  # in whatever order they were asked for
    assert figure.axes[-1].get_ylabel() == "radius without structural eigenvalues [1]"


def test_what_was_not_computed_is_hatched_and_counted() -> None:
    found = results(SMALL, RADIUS, float)
    del found[0], found[5]
    found[7] = Result(7, {}, "diverged")
    found[9] = Result(9, {RADIUS: None})
    figure = draw_measure(SMALL, found, RADIUS)
    check(figure)
    (mesh,) = meshes(figure)
    assert sorted(np.flatnonzero(np.ma.getmaskarray(mesh.get_array()).ravel())) == [0, 5, 7, 9]
    assert mesh.axes.patch.get_hatch()
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == ["of 12 cells: 2 not computed, 1 failed, 1 without a number"]


@pytest.mark.parametrize(("top", "drawn"), [(0.99, False), (1.01, True)])
def test_a_map_of_radii_draws_the_limit_of_stability(top: float, drawn: bool) -> None:
    figure = draw_measure(SMALL, results(SMALL, RADIUS, lambda case: 0.9 + (top - 0.9) * case / 11.0), RADIUS)
    check(figure)
    texts = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert ("limit of stability: radius 1" in texts) == drawn
    contours = [each for each in figure.axes[0].collections if isinstance(each, QuadContourSet)]
    assert bool(contours) == drawn
    for contour in contours:  # 0.9 + 0.01 cell is 1 at cell 10: of the last row, the third value
        assert ((contour.get_paths()[0].vertices[:, 1] >= 2.0) & (contour.get_paths()[0].vertices[:, 1] <= 3.0)).all()


@pytest.mark.parametrize(("value", "said"), [(1.0, "1"), (True, "yes")])
def test_a_flat_map_says_its_value_in_place_of_a_scale(value: Any, said: str) -> None:
    figure = draw_measure(SMALL, results(SMALL, "passive", lambda _: value), "passive")
    check(figure)
    assert len(figure.axes) == 1  # no colour bar
    (text,) = (text.get_text() for text in figure.legends[0].get_texts())
    assert text.endswith(f"constant: {said} in all 12 cells computed")


def test_the_radius_without_structural_is_what_advise_tells() -> None:
    settings = resolve({"users": [{"name": "a"}, {"name": "b"}]})
    radius = LIFTED[RADIUS](settings)
    assert radius == LIFTED["lifted.decaying_radius"](settings)
    assert radius < 1.0 == LIFTED["lifted.spectral_radius"](settings)


def test_every_table_can_be_scrolled_and_wraps(crowds: dict[int, TracedRun], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(style, "DPI", 30)  # the pictures are not looked at
    run = crowds[1]
    for page in (render(run, []), compare([run] * 3, ["a", "b", "a name-that-is-long" * 5])):
        assert page.count("<table>") == page.count("<div class=wide><table>") > 0
        assert ".wide { overflow-x: auto" in page
        assert "nowrap" not in page
        assert "table" in {tag for tag, _ in Tags(page).tags}


def test_a_report_names_the_version_that_ran_the_run(crowds: dict[int, TracedRun]) -> None:
    run, here = crowds[2], versions_here()
    assert run.versions == (f"cogrip {VERSION}, Python {here.python}, numpy {here.numpy}, {here.machine}",)
    assert f"Run by cogrip {VERSION}, Python {here.python}, " in render(run, [])
    old = replace(run, versions=("server, anna: cogrip 0.0.1, Python 3.9", "ben: cogrip 0.0.2, Python 3.10"))
    assert "Run by server, anna: cogrip 0.0.1, Python 3.9; ben: cogrip 0.0.2, Python 3.10" in render(old, [])
    assert "Run by a version that no recording tells" in render(replace(run, versions=()), [])


@pytest.mark.parametrize(("state", "said"), [("live", "12.0"), ("idle", "12.0 (let go)")])
def test_where_a_hand_was_after_it_let_go_is_named_so(crowds: dict[int, TracedRun], state: str, said: str) -> None:
    summary = json.loads(json.dumps(crowds[1].summary))
    summary["users"][0] |= {"position_m": [0.012], "state": state}
    assert f"<td>{said}</td>" in render(replace(crowds[1], summary=summary), [])


def test_skipped_ticks_are_a_count(crowds: dict[int, TracedRun], tmp_path: Path) -> None:
    run = crowds[2]
    told = {"late_us": 3.0, "work_us": 5.0, "skipped": 28.0}
    clients: dict[str, Any] = {
        name: replace(trace, columns={key: np.full(trace.rows, value) for key, value in told.items()})
        for name, trace in run.clients.items()
    }
    figure = next(plot for plot in PLOTS if plot.name == "loops").draw(replace(run, clients=clients))
    check(figure)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    rows = run.clients["p0"].rows
    assert texts[0] == f"p0: 28 of {28 + rows} ticks skipped"


@pytest.mark.parametrize(("most", "limits"), [(4e-15, (-1.0, 1.0)), (0.0, None), (2e-6, None)])
def test_rounding_is_not_magnified_to_fill_a_panel(most: float, limits: tuple[float, float] | None) -> None:
    sheet = style.Sheet(1)
    panel = sheet.panels[0, 0]
    panel.plot([0.0, 1.0], [-most, most])
    before = panel.get_ylim()
    sheet.finish("time [s]", ["force [N]"])
    assert panel.get_ylim() == (limits or before)


def test_a_hand_that_follows_correlates_at_its_lag() -> None:
    leads = np.random.default_rng(1).normal(size=4000)
    for first, second, sign in ((leads, np.roll(leads, 51), 1.0), (np.roll(leads, 51), leads, -1.0)):
        r, best, lag_s = correlation(first, second, 1024.0)
        assert lag_s == sign * 51 / 1024.0
        assert best == pytest.approx(1.0, abs=0.05)
        assert abs(r) < 0.1


# Spectra and correlation, against scipy's ----------------------------------------------------------------------------


@pytest.mark.parametrize(("samples", "segment"), [(1000, 200), (1001, 201), (64, 16), (257, 257)])
def test_densities_and_coherence_are_scipys(samples: int, segment: int) -> None:
    values = np.random.default_rng(samples).normal(size=(3, samples)).cumsum(axis=1)
    frequency, densities = cross_densities(values, 128.0, segment)
    expected_hz, powers = signal.welch(values, 128.0, nperseg=segment)
    assert frequency == pytest.approx(expected_hz)
    for row in range(3):
        assert densities[row, row].real == pytest.approx(powers[row], rel=1e-9, abs=1e-18)
        assert densities[row, row].imag == pytest.approx(0.0, abs=1e-12 * powers[row].max())
    _, cross = signal.csd(values[0], values[2], 128.0, nperseg=segment)
    assert np.allclose(densities[0, 2], cross, rtol=1e-9, atol=1e-12 * abs(cross).max())


@pytest.mark.parametrize("reach", [1, 20, 299])
def test_correlation_at_lags_is_scipys(reach: int) -> None:
    first, second = np.random.default_rng(reach).normal(size=(2, 300))
    expected = signal.correlate(second, first, method="direct")[299 - reach : 300 + reach]
    assert correlation_near(first, second, reach) == pytest.approx(expected, abs=1e-9)
