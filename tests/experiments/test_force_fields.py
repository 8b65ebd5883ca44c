"""The study of force fields that comes with cogrip against its equations, and effects that a study's conditions name."""

import json
from pathlib import Path
from typing import Any

import pytest

from cogrip.experiments.study.study_file import Study, StudyError
from cogrip.experiments.study.table import read_table
from cogrip.protocol.settings.effects import EffectSection
from cogrip.results.measures.columns import read_columns
from cogrip.results.reading.records import open_run

from tests.experiments.studies import NoSessions, conducted, parsed, run_in_laboratory, shipped

PEAK_MPS = 1.875 * 0.1 / 0.8  # peak speed of a minimum-jerk reach of 0.1 m in 0.8 s
ASIDE_M = 0.1 * 0.1  # to the left, of a hand that aims 0.1 there for each 1 ahead
FIELD_NSPM, CHANNEL_NPM, LOAD_N = 4.0, 1500.0, 0.5


def test_reaches_are_pushed_aside_held_and_loaded_as_the_equations_say(tmp_path: Path) -> None:
    study = shipped("force_fields")
    run_in_laboratory(study, tmp_path / "study")
    rows = {row["condition"]: row for row in read_table(tmp_path / "study").rows}
    assert set(rows) == set(study.conditions)
    hand_npm = {}
    for name, row in rows.items():
        folder = tmp_path / "study" / "runs" / str(row["run"])
        settings = open_run(folder).settings()
        assert settings is not None
        words = dict(word.split("=") for word in settings.users[0].hand.split("&")[1:])
        hand_npm[name] = float(words["hand_stiffness_npm"])
        (user,) = json.loads((folder / "summary.json").read_text(encoding="utf-8"))["users"]
        assert user["energy"]["device_margin_j"] >= 0.0
        assert not user["oscillates"]
        assert (row["effects_reduced_s"] or 0.0) == 0.0, "all of it was rendered"
    aside = {name: 1e3 * row["deviation_m"] for name, row in rows.items()}
    assert aside["null"] == pytest.approx(0.0, abs=0.1)
    assert aside["curl"] == pytest.approx(-1e3 * FIELD_NSPM * PEAK_MPS / hand_npm["curl"], rel=0.1)
    assert aside["catch"] == pytest.approx(1e3 * ASIDE_M, abs=0.5), "friction keeps 0.04 N of it"
    assert aside["load"] == pytest.approx(-1e3 * LOAD_N / hand_npm["load"], rel=0.15)
    series_npm = hand_npm["channel"] * CHANNEL_NPM / (hand_npm["channel"] + CHANNEL_NPM)
    assert rows["channel"]["lateral_force_n"] == pytest.approx(series_npm * ASIDE_M, rel=0.1)
    assert aside["channel"] == pytest.approx(1e3 * series_npm * ASIDE_M / CHANNEL_NPM, rel=0.15)
    assert aside["perturbation"] < -3.0
    assert rows["perturbation"]["lateral_force_n"] == pytest.approx(1.0, rel=0.2)


def test_an_effect_begins_with_its_phase_and_one_without_a_phase_with_the_trial(tmp_path: Path) -> None:
    study = plain(
        {"effects": ["load"]},
        effects={"load": {**LOAD, "phase": "move"}, "held": LOAD},
        conditions={"b": {"effects": ["held"]}},
    )
    run_in_laboratory(study, tmp_path / "study")
    for run, begins_s in (("01-001-one-1", 0.5), ("01-002-one-1", 0.0)):
        hand = read_columns(tmp_path / "study" / "runs" / run).people[0]
        pushed = hand.time_s[hand.force_n[:, 0] < -0.4]
        assert begins_s <= pushed[0] <= begins_s + 0.4, "the ramp of safety takes 0.3 s"
        assert pushed[-1] > 0.95


def test_columns_end_with_the_marker_that_they_are_to_end_with(tmp_path: Path) -> None:
    """Clients of a live trial record on after its end, without a force; measures are of the trial."""
    run_in_laboratory(plain({"effects": ["load"]}), tmp_path / "study")
    folder = tmp_path / "study" / "runs" / "01-001-one-1"
    whole, cut = read_columns(folder), read_columns(folder, until="phase 01-001-one-1 move")
    assert (whole.time_s[-1], cut.time_s[-1]) == pytest.approx((1.0, 0.5), abs=1.5 / whole.rate_hz)
    assert cut.people[0].time_s[-1] == pytest.approx(0.5, abs=1.5 / 1024)
    assert len(cut.people[0].pull_n) == len(cut.time_s) == len(cut.object_m)
    assert len(read_columns(folder, until="never").time_s) == len(whole.time_s)


LOAD = {"kind": "constant", "force_n": 0.5, "direction": [1.0, 0.0, 0.0]}
PHASES = [{"name": "wait", "seconds": 0.5}, {"name": "move"}]


def plain(condition: dict[str, Any], conditions: dict[str, Any] | None = None, **changes: Any) -> Study:
    """Return a study of one person at rest, with a first condition `a` and these others."""
    table: dict[str, Any] = {
        "name": "plain", "participants": ["P01"], "conditions": {"a": condition, **(conditions or {})},
        "blocks": [{"name": "one", "phases": PHASES}], "effects": {"load": LOAD}, **changes,
    }  # fmt: skip
    table["session"] = {"seconds": 1.0, "users": [{"hand": "hold"}], **changes.get("session", {})}
    return parsed("", **table)


def effects_of(study: Study, tmp_path: Path) -> dict[str, tuple[EffectSection, ...]]:
    sessions = NoSessions()
    conducted(study, tmp_path / "study", sessions)
    return {name: settings.effects for name, settings in sessions.asked.items()}


def test_a_condition_has_the_effects_that_it_names_and_null_none(tmp_path: Path) -> None:
    study = plain(
        {},
        {"null": {"effects": []}, "both": {"effects": ["load", "field"]}},
        session={"effects": ["load"]},
        effects={"load": LOAD, "field": {"kind": "viscous", "damping_nspm": 3.0, "start_s": 0.1, "users": ["user1"]}},
    )
    told = effects_of(study, tmp_path)
    kinds = {run: [each.kind for each in found] for run, found in told.items()}
    assert kinds == {"01-001-one-1": ["constant"], "01-002-one-1": [], "01-003-one-1": ["constant", "viscous"]}
    field = told["01-003-one-1"][1]
    assert (field.marker, field.start_s, field.users) == ("begin 01-003-one-1", 0.1, ("P01",))


@pytest.mark.parametrize(
    ("condition", "changes", "words"),
    [
        ({"effects": ["lode"]}, {}, "conditions.a: effects: there is no effect 'lode'; there is: load"),
        ({"effects": [LOAD]}, {}, "conditions.a: effects: a condition has their names; write"),
        ({"effects": ["load"]}, {"effects": {"load": {**LOAD, "phase": "rest"}}},
         "effects.load: phase = 'rest', and blocks.one has none of that name; there is: wait, move"),
        ({}, {"effects": {"load": {**LOAD, "force_n": 41.0}}}, "effects.load.force_n"),
        ({"effects": ["load"]}, {"effects": {"load": {"kind": "constant", "force_n": 1.0}}}, "conditions.a: effects.0: kind"),
        ({}, {"effects": {"load": {**LOAD, "force": 1.0}}}, "effects.load.force: there is no such setting"),
    ],
)  # fmt: skip
def test_effects_that_no_session_can_have_are_refused_before_anybody_comes(
    condition: dict[str, Any], changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(StudyError) as refused:
        plain(condition, **changes)
    assert words in str(refused.value)
