"""Studies of scenes: reports, exports, comparisons of methods, sweeps, and two recorded hands at the lift."""

import json
from pathlib import Path
from typing import Any

import msgspec
import pytest

from cogrip.cli.settings.settings_file import load
from cogrip.experiments.methods.case import MethodJob, measure_case
from cogrip.experiments.methods.method import METHODS, OWN, methods_of, session_settings
from cogrip.experiments.methods.query import prepare
from cogrip.experiments.sweep.grid import parse_axis
from cogrip.experiments.sweep.measures import SCENE, defaults
from cogrip.experiments.sweep.query import prepare as prepare_sweep
from cogrip.protocol.settings.table import SettingsError
from cogrip.results.plots import scene as scene_plots
from cogrip.results.reading.export import export
from cogrip.results.reading.records import open_run
from cogrip.results.reading.traces import TracedRun, load_run
from cogrip.results.report.page import draw_plots
from cogrip.results.verdict.verdict import passive, stable
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.sim.laboratory import Laboratory

from tests.experiments.compared_methods import rows_of
from tests.sim.session_measures import MARGINS

DATA = Path(__file__).parents[3] / "shared" / "data"
LIFT = Path("lift")
BRIEF = ["seconds=3.5"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run in which the box is off the floor at the end."""
    folder = tmp_path_factory.mktemp("lift")
    run_laboratory(load(LIFT, BRIEF), folder)
    return folder


# Reports and exports -------------------------------------------------------------------------------------------------


def test_a_scene_has_plots_of_its_bodies_and_contacts_and_nothing_else_has(
    folder: Path, finished: Path, blank: None
) -> None:
    drawn = {picture.heading: picture.png for picture in draw_plots(load_run(folder))}
    assert drawn["Bodies"]
    assert drawn["Contact forces and slip"]
    assert not {"Bodies", "Contact forces and slip"} & {picture.heading for picture in draw_plots(load_run(finished))}


@pytest.mark.long
def test_the_curves_are_the_recorded_ones(folder: Path, blank: None) -> None:
    run = load_run(folder)
    *places, turned = scene_plots.bodies(run).axes
    heights = places[2].lines[0].get_ydata()
    assert heights[0] == 0.0
    assert 40.0 < max(heights) < 50.0, "the box alone: tools are no bodies here"
    assert [len(panel.lines) for panel in (*places, turned)] == [1, 1, 1, 1]
    normal, friction, slip = scene_plots.contacts(run).axes
    assert normal.lines[0].get_ydata()[-1] == pytest.approx(5.1, abs=0.2)
    assert friction.lines[1].get_ydata()[-1] == pytest.approx(0.2 * 9.81 / 2, abs=0.05), "half of the box's weight"
    assert 0.0 < slip.lines[0].get_ydata()[-1] < 0.1


@pytest.mark.long
def test_a_recording_of_an_earlier_version_says_what_is_missing(folder: Path, tmp_path: Path, blank: None) -> None:
    run = load_run(folder)
    bare = TracedRun(tmp_path, run.summary, run.settings, run.names, run.clients, None, ())
    missing = {picture.heading: picture.missing for picture in draw_plots(bare)}
    assert missing["Bodies"] == "the recording holds no poses of bodies"
    assert missing["Contact forces and slip"] == "the recording holds no contact forces"


def test_the_summary_and_the_table_of_steps_agree(folder: Path, tmp_path: Path) -> None:
    export(open_run(folder), "csv", tmp_path)
    rows = rows_of(tmp_path / "server.step.csv")
    scene = json.loads((folder / "summary.json").read_text())["server"]["scene"]
    for tool in scene["tools"]:
        for measure, column in (("peak_normal_n", "normal_n"), ("peak_friction_n", "friction_n"), ("slip_m", "slip_m")):
            cells = [row[f"{tool['name']}.{column}"] for row in rows]
            assert tool[measure] == max(float(cell) for cell in cells if cell)
    assert scene["lifted_m"] == pytest.approx(max(float(row["object_m_z"]) for row in rows), abs=1e-3)
    assert scene["lifted_s"] == pytest.approx(sum(float(row["object_m_z"]) > 0.01 for row in rows) / 128, abs=4 / 128)


# Comparisons and sweeps ----------------------------------------------------------------------------------------------


def case(method: str, *overrides: str) -> dict[str, Any]:
    """Measure one session of the lift on its own network, without its carrying."""
    still = [
        user.hand.replace("carry_m=0.04", "carry_m=0").replace("hold_s=0.5", "hold_s=2") for user in load(LIFT).users
    ]
    hands = [f"users.{number}.hand={hand}" for number, hand in enumerate(still)]
    settings = load(LIFT, ["seconds=5.5", *hands, *overrides])
    asked = prepare(settings, [method], [OWN], 1)
    return measure_case(MethodJob(1, json.dumps(asked.base), method, OWN, asked.seeds[0], asked.rest_s, felt=True))


def has_settings(base: dict[str, Any], method: str) -> bool:
    """Return whether the settings of a method can be run."""
    try:
        session_settings(base, method, OWN, 1)
    except SettingsError:
        return False
    return True


def test_an_object_has_all_methods_whose_settings_fit_it() -> None:
    for config in (LIFT, Path("lan")):
        base = msgspec.to_builtins(load(config))
        assert methods_of(load(config)) == tuple(name for name in METHODS if has_settings(base, name))
    assert set(METHODS) - set(methods_of(load(LIFT))) == {"paper"}
    assert "partner" not in methods_of(load(Path("pile"))), "more than one body of it moves"
    assert "partner" not in methods_of(load(Path("peg"))), "it has poses"
    assert set(METHODS) - set(methods_of(load(Path("lan")))) == {"local"}  # a cube has no contact


@pytest.mark.parametrize(("kind", "diverged"), [("wave", ""), ("coupling", "the scene left all bounds")])
def test_virtual_coupling_diverges_where_waves_of_the_same_stiffness_do_not(kind: str, diverged: str) -> None:
    """Over 20 ms each way, before a hand is at the box."""
    laboratory = Laboratory(load(LIFT, ["seconds=1.25", f"coupling.kind={kind}", "coupling.stiffness_npm=8000"]))
    laboratory.run()
    assert laboratory.incident.startswith(diverged)
    assert bool(laboratory.incident) == bool(diverged)


@pytest.mark.long
def test_waves_lift_where_other_methods_at_the_same_stiffness_diverge() -> None:
    ours = case("wave")
    assert not ours["diverged"]
    assert not ours["oscillates"]
    assert ours["passive"]
    assert ours["created_mj"] == pytest.approx(0.0, abs=1e-3)
    assert ours["lifted_mm"] > 40.0
    assert ours["lifted_s"] > 1.0
    assert ours["slip_mm"] < 1.0, "as the hands go home in the air"
    assert ours["felt_error_percent"] is None, "no stiffness is asked for"
    theirs = case("coupling")
    assert theirs["diverged"] or theirs["oscillates"]
    assert theirs["created_mj"] > 100.0
    assert theirs["coherence_rms_mm"] is None, "the tools are reported to people, not the object"


@pytest.mark.long
@pytest.mark.parametrize("method", ["coupling", "tdpa"])
def test_other_methods_lift_with_a_softer_spring(method: str) -> None:
    found = case(method, "coupling.stiffness_npm=300", "coupling.damping_nspm=5")
    assert not found["diverged"]
    assert not found["oscillates"]
    assert found["lifted_mm"] > 35.0
    assert found["slip_mm"] < 2.0


@pytest.mark.long
def test_a_sweep_of_a_scene_reads_lift_and_slip() -> None:
    settings = load(LIFT, BRIEF)
    asked = prepare_sweep(settings, [parse_axis("link.delay_ms=0,20")], defaults(settings))
    assert set(SCENE) < set(asked.columns)
    measures = asked.measure(asked.jobs({})[1])
    assert 0.04 < measures["server.scene.lifted_m"] < 0.05
    assert measures["server.scene.lifted_slip_m"] < 1e-4
    assert not set(SCENE) & set(defaults(load(Path("lan"))))


# Recorded hands ------------------------------------------------------------------------------------------------------


def recorded_hands() -> list[str]:
    """Return a Touch moved freely and a Panda led by hand, as two people who press from both sides and rise."""
    touch, panda = (DATA / name for name in ("touch_freehand_wpi_100hz.csv", "panda_handguided_symbol17_rec0_2_4.csv"))
    if not (touch.exists() and panda.exists()):
        pytest.skip("../shared/data is not here")
    return [
        f"users.0.hand=csv:{touch}&time=t_s&x=pz_mm&z=px_mm",
        f"users.1.hand=csv:{panda}&time=i&time_scale=0.001&where=rec:0&x=py_m&z=px_m&scale=0.6&start_s=5",
    ]


@pytest.mark.long
def test_two_recorded_hands_lift_the_box() -> None:
    """Neither was made for it: until 8 s the first shoves the box about and slides down its side."""
    summary = run_laboratory(load(LIFT, ["seconds=10.7", *recorded_hands()])).summary
    scene = summary["server"]["scene"]
    assert scene["lifted_m"] == pytest.approx(0.053, abs=2e-3)
    assert scene["lifted_s"] > 2.0
    assert scene["lifted_slip_m"] < 1e-4
    assert 5e-3 < scene["slip_m"] < 2e-2
    assert summary["server"]["energy_limiter"]["limited_frames"] == 0
    assert summary["server"]["energy_balance_error_j"] < 1e-14
    assert [judged(summary).tone for judged in (passive, stable)] == ["good", "good"]
    assert all(user["energy"][key] >= 0.0 for user in summary["users"] for key in MARGINS)
