"""`stability`, `advise`, `feel`, `figures` and `sweep` as their users type them."""

import csv
import json
from functools import cache
from pathlib import Path

import pytest

from cogrip.analysis.advice import laboratory_check
from cogrip.analysis.advice.stiffest import stiffest
from cogrip.analysis.feel import felt_probe as felt
from cogrip.analysis.figures import decimators
from cogrip.cli.study import advise

from tests.cli.command import Cogrip
from tests.extent import long


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check advice by sessions that are just long enough to tell something."""
    monkeypatch.setattr(laboratory_check, "SESSION_S", laboratory_check.SHORT_S)
    monkeypatch.setattr(felt, "SETTLE_S", 1.0)
    monkeypatch.setattr(felt, "LAST_S", 0.5)


@pytest.mark.parametrize(
    ("scheme", "delay", "stiffness", "radius", "structural", "states"),
    [("paper", 2, 1000, 1.0406, 4, 22), ("coupling", 1, 2000, 1.2289, 1, 14), ("passive", 4, 20000, 1.0, 4, 26)],
)
def test_radius_is_the_contract_to_the_letter(
    cogrip: Cogrip, scheme: str, delay: int, stiffness: int, radius: float, structural: int, states: int
) -> None:
    flags = f"--scheme {scheme} --delay-frames {delay} --set coupling.stiffness_npm={stiffness}"
    assert cogrip.answer(f"stability radius demo --exact-velocity {flags}") == {
        "scheme": scheme, "spectral_radius": pytest.approx(radius, abs=5e-5), "structural": structural, "states": states,
        "stable": radius == 1.0,
    }  # fmt: skip


def test_limit_is_the_contract_to_the_letter(cogrip: Cogrip) -> None:
    paper = "stability limit demo --scheme paper --delay-frames"
    found = cogrip.answer(f"{paper} 0 --exact-velocity")
    assert found == {"largest_stable_stiffness_npm": pytest.approx(1977.675, rel=1e-4), "searched_to_npm": 1e7}
    assert cogrip.answer(f"{paper} 0")["largest_stable_stiffness_npm"] < 1900.0, "P's waves are of positions alone"
    found = cogrip.answer("stability limit demo --exact-velocity")
    assert found == {"largest_stable_stiffness_npm": None, "searched_to_npm": 1e7}
    own = "--set users.0.stiffness_npm=100"
    both, uneven = (cogrip.answer(f"{paper} 1 {more}")["largest_stable_stiffness_npm"] for more in ("", own))
    assert uneven > 1.1 * both, "a user's own stiffness counts"


@pytest.mark.long
@pytest.mark.usefixtures("no_workers")
def test_advice_and_limit_and_sweep_name_one_stiffness(cogrip: Cogrip, tmp_path: Path) -> None:
    """All three tell the same K up to which a session is stable, and that it is of the estimated velocity."""
    measure = "lifted.largest_stable_stiffness_npm"
    axes = "--vary link.delay_ms=60 --vary coupling.kind=wave,coupling"
    cogrip.texts(f"sweep demo {axes} --measure {measure} --workers 1 --out {tmp_path}")
    with next(tmp_path.rglob("table.csv")).open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2
    for row in rows:
        more = " ".join(f"--set {key}={row[key]}" for key in ("link.delay_ms", "coupling.kind"))
        advised = cogrip.answer(f"advise demo --no-laboratory {more}")["largest_stable_stiffness_npm"]
        limit = cogrip.answer(f"stability limit demo {more}")["largest_stable_stiffness_npm"]
        assert 0.0 < limit < 1e4
        assert advised == pytest.approx(limit, rel=2e-4)
        assert float(row[measure]) == pytest.approx(limit, rel=1e-9)
    assert "velocities as clients estimate them" in cogrip.out("stability limit demo")
    assert "idealised: exact velocities" in cogrip.out("stability limit demo --exact-velocity")


def test_the_papers_scheme_brings_its_filter_but_a_set_stands_above_it(cogrip: Cogrip) -> None:
    paper = "stability radius demo --exact-velocity --scheme paper --delay-frames 4"
    filters = "", "--set coupling.decimator=lowpass", "--set coupling.decimator=boxcar"
    radii = [cogrip.answer(f"{paper} {more}")["spectral_radius"] for more in filters]
    assert radii[0] == radii[1] == pytest.approx(1.0817, abs=5e-5)
    assert radii[2] != radii[0]


def test_words_for_people(cogrip: Cogrip) -> None:
    out = cogrip.out("stability radius demo --scheme coupling")
    assert "virtual coupling: NOT stable" in out
    assert "structural eigenvalues at 1: joint position" in out
    assert "stable at any stiffness up to 1e+07 N/m" in cogrip.out("stability limit demo --exact-velocity")
    assert "stable at no stiffness" in cogrip.out("stability limit demo --set coupling.impedance_nspm=300")


def test_a_delay_that_is_no_whole_number_of_ticks_says_what_was_done(cogrip: Cogrip) -> None:
    command = "stability radius demo --exact-velocity --json - --delay-frames"
    out, err = cogrip.texts(f"{command} 1.3")
    assert json.loads(out)["states"] == 18  # two frames each direction
    assert "10.4 device ticks, no whole number: taken as 11" in err
    assert "after 16 ticks or 2 frames" in err
    assert cogrip.err(f"{command} 2", code=0) == ""


def test_region_leaves_picture_numbers_and_record(cogrip: Cogrip, tmp_path: Path) -> None:
    region = f"stability region demo --scheme paper --delays-frames 0,2 --exact-velocity --out {tmp_path} --grid"
    assert "0 frames each direction: to 1978 N/m if both are alike" in cogrip.out(f"{region} 8")
    assert {path.name for path in tmp_path.iterdir()} == {"region.png", "region.svg", "region.csv", "region.json"}
    assert (tmp_path / "region.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "region.svg").read_text().startswith("<?xml")
    with (tmp_path / "region.csv").open() as file:
        rows = list(csv.DictReader(file))
    boundary = [row for row in rows if row["kind"] == "boundary"]
    assert all(float(row["radius_inside"]) < 1.0 < float(row["radius_outside"]) for row in boundary)
    assert sum(row["kind"] == "cell" for row in rows) == 2 * 64
    record = json.loads((tmp_path / "region.json").read_text())
    assert [each["delay_frames"] for each in record["boundaries"]] == [0, 2]
    assert all(each["verified"] for each in record["boundaries"])
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    cogrip.texts(f"{region} 8")  # the same query may be repeated
    assert "answers another question (other grid)" in cogrip.err(f"{region} 7")
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
    (tmp_path / "region.json").unlink()
    assert "in the way" in cogrip.err(region.removesuffix(" --grid")), "files of somebody else are not overwritten"
    del before[tmp_path / "region.json"]
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.usefixtures("brief")
def test_advice_in_words_and_in_numbers(cogrip: Cogrip) -> None:
    out, err = cogrip.texts("advise demo")
    out = " ".join(out.split())
    for words in (
        "note feel anna, ben: 1000 N/m will feel like 450.3 N/m at rest; compensation is out of reach at b = 20 N s/m",
        "note free motion anna, ben: will feel like 0.58 kg, 0.1 kg of it the device",
        "note laboratory anna, ben: a spring of 1000 N/m felt like 450 N/m at rest over this link",
        "ok laboratory a session of ",
        "conditions velocities as clients estimate them",
        "b T_c / m = 0.20",
        "b = 20 of at most 25.6 N s/m, its lag bound, where the 4 ticks that its damper is late take all of its 0.1 kg",
        "--set coupling.impedance_nspm=25.6: felt stiffness would miss what is asked by 49 % in place of 55 %",
        "(512 N/m in place of 450); it costs: free motion is heavier (0.712 kg in place of 0.579)",
    ):
        assert words in out
    assert "20.48 device ticks" in err
    found = cogrip.answer("advise demo --set coupling.kind=coupling --no-laboratory")
    assert not found["stable"]
    assert "predicts growth" in found["warnings"][0]
    assert found["change"]["set"] == 'coupling.kind="wave"'
    anna = found["users"][0]
    assert anna["delay_ms"]["up link"] == pytest.approx(20.0)
    assert (anna["largest_impedance_nspm"], anna["impedance_bound"]) == (pytest.approx(25.6), "lag")


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_advice_the_other_way_round(cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch) -> None:
    """`advise` says the same of the settings that it names, and a session in virtual time feels it."""
    once = cache(lambda settings: stiffest(settings))
    for module in (advise, laboratory_check):
        monkeypatch.setattr(module, "stiffest", lambda settings, _: once(settings))
    found = cogrip.answer("advise demo --for-stiffness")["stiffest"]
    there = cogrip.answer("advise demo --no-laboratory", *(f"--set={setting}" for setting in found["set"]))
    assert there["stable"]
    assert found["felt_stiffness_npm"] == min(user["felt_stiffness_npm"] for user in there["users"])
    for user in found["users"]:
        assert user["laboratory_felt_npm"] == pytest.approx([found["felt_stiffness_npm"]], rel=0.01)
    out = cogrip.out("advise demo --for-stiffness --no-laboratory")
    assert f"stiffest {found['felt_stiffness_npm']:.4g} N/m" in " ".join(out.split())
    assert "--set coupling.impedance_nspm=25.6" in out


@pytest.mark.long
def test_serve_warns_in_the_words_of_advise(cogrip: Cogrip, tmp_path: Path) -> None:
    outside = "--set coupling.impedance_nspm=60"
    warnings = cogrip.answer(f"advise demo --no-laboratory {outside}")["warnings"]
    assert warnings
    serve = f"serve demo --port 0 --seconds 0.05 --runs {tmp_path} --no-report"
    out = cogrip.out(f"{serve} {outside}")
    assert [text for text in warnings if text.partition(": ")[2] not in out] == []
    assert "warning" not in cogrip.out(serve)


def test_feel_in_words_numbers_and_a_picture(cogrip: Cogrip, tmp_path: Path) -> None:
    found = cogrip.answer(f"feel demo --delay-frames 1 --out {tmp_path}")
    assert found["conditions"]["on a wall"]["stiffness_npm"] == pytest.approx(630.5, abs=0.05)
    assert set(found["conditions"]) == {"no contact", "alone with the object", "on a wall", "others hold on"}
    assert found["delay_total_ms"] == pytest.approx(3 * 7.8125)
    assert {path.name for path in tmp_path.iterdir()} == {"feel.png", "feel.svg", "feel.csv"}
    assert "630.5" in cogrip.out("feel demo --delay-frames 1")


@pytest.mark.parametrize("names", [("decimators",), long(("fig4", "fig5"))])
def test_figures_by_name(
    cogrip: Cogrip, tmp_path: Path, names: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(decimators, "SWEEP_S", 1.0)  # what it says is tested beside the others
    out = cogrip.out("figures", *names, "--out", tmp_path)
    files = {f"{name}.{suffix}" for name in names for suffix in ("png", "svg", "csv")}
    assert {path.name for path in tmp_path.iterdir()} == files
    captions = {
        "fig4": "devices of 0.045 kg: 567, 567, 567, 567 N/m; devices of 0.1 kg: 1978, 1299, 716, 325 N/m",
        "fig5": "the paper's scheme at 10 ms: 575 N/m measured, 574 predicted",
    }
    assert [captions[name] for name in names if captions.get(name, "") not in out] == []
    assert "fig5" not in names or "compensated, b = 20 N s/m at 10 ms: 1000 N/m measured, 1000 predicted" in out


@pytest.mark.usefixtures("no_workers")
def test_a_sweep_from_the_command_line_goes_on_and_refuses_another(cogrip: Cogrip, tmp_path: Path) -> None:
    out = tmp_path / "out"
    axes = "--vary coupling.stiffness_npm=100:10000:3log --vary coupling.kind=wave,coupling"
    command = f"sweep demo {axes} --measure lifted.spectral_radius --workers 1 --out {out}"
    found = cogrip.answer(command)
    assert (found["cells"], found["computed"], found["kept"], found["failed"]) == (6, 6, 0, 0)
    left = {path.name for path in out.iterdir()}
    assert {"sweep.json", "cells.jsonl", "table.csv", "heatmap-lifted.spectral_radius.png"} <= left
    found = cogrip.answer(command)
    assert (found["computed"], found["kept"]) == (0, 6)
    table = (out / "table.csv").read_bytes()
    assert "holds another sweep (other columns)" in cogrip.err(f"{command} --measure lifted.stable")
    assert (out / "table.csv").read_bytes() == table


@pytest.mark.parametrize("command", ["feel", "stability radius"])
def test_models_of_partners_are_answered_with_their_loop_gain(cogrip: Cogrip, command: str) -> None:
    """Stiff hands may swing and limp ones do not; at rest a hand feels its partner's through both springs."""
    flags = "--set coupling.kind=partner --set coupling.stiffness_npm=1000"
    answer = cogrip.answer(f"{command} demo {flags}")
    rows = {row["hand_npm"]: row for row in answer["hands"]}
    assert rows[300.0]["felt_npm"] == pytest.approx(1.0 / (1.0 / 300.0 + 2.0 / 1000.0))
    assert rows[150.0]["loop_gain"] < 1.0 < rows[1000.0]["loop_gain"]
    code, shown, _ = cogrip(f"{command} demo {flags}")
    assert code == 0
    assert ("may swing" in shown, "187.5" in shown, "no spectral radius" in shown) == (True, True, True)


def test_one_person_has_no_partner_to_model(cogrip: Cogrip, tmp_path: Path) -> None:
    (tmp_path / "alone.toml").write_text('[coupling]\nkind = "partner"\n[[users]]\nname = "anna"\n')
    code, _, said = cogrip(f"feel {tmp_path / 'alone.toml'}")
    assert code != 0
    assert "give users a second one" in said


@pytest.mark.parametrize("command", ["feel", "stability radius"])
def test_copies_of_a_scene_have_no_loop_gain(cogrip: Cogrip, command: str) -> None:
    """A cube's of the same springs would be a green tick for contact that nobody has modelled."""
    code, shown, said = cogrip(f"{command} lift --set coupling.kind=partner")
    assert code != 0
    assert not shown
    assert "copies of a scene have no linear model; try them with `cogrip lab`" in said
