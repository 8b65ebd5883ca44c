"""The gates of partners' models, judged by what recordings show: forces times motions, and nothing that a client says."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cogrip.client.coupling.partner.spring_gate import BUDGET_J, REFILL_W, SpringGate
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.results.reading.folder import client_recording
from cogrip.results.reading.records import open_run
from cogrip.results.verdict.gates import HandWork, hand_work, judge_gates, least_margin_j
from cogrip.results.verdict.verdict import passive
from cogrip.results.writing.laboratory_run import run_laboratory

from tests.interpreted import needs_interpreted

SECONDS = 3.0


def opposed(kind: str = "partner") -> Settings:
    """Two hands that pull to and fro against each other through 100 ms each way."""
    users = [
        {
            "name": name,
            "device": "sim:ideal?mass_kg=0.1&damping_nspm=0.5",
            "hand": f"sine&amplitude_m={sign}0.03&frequency_hz=0.9&hand_stiffness_npm=300&hand_damping_nspm=5",
        }
        for name, sign in (("anna", ""), ("ben", "-"))
    ]
    return resolve({
        "seconds": SECONDS, "coupling": {"kind": kind, "stiffness_npm": 1000.0, "damping_nspm": 10.0},
        "object": {"axes": 1, "mass_kg": 0.2}, "link": {"delay_ms": 100.0}, "users": users,
    })  # fmt: skip


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Return the folder and the summary of a session of partners, to be read alone."""
    folder = tmp_path_factory.mktemp("honest")
    return folder, run_laboratory(opposed(), folder).summary


def test_a_session_within_its_budgets_is_passive_by_its_recordings(honest: tuple[Path, dict[str, Any]]) -> None:
    folder, summary = honest
    gates, judged = summary["gates"], passive(summary)
    assert judged.tone == "good", judged.sentence
    assert "by the recorded forces and places" in judged.sentence
    assert 0.0 <= gates["margin_j"] <= gates["budget_j"]
    assert 2.0 * BUDGET_J <= gates["budget_j"] <= 2.0 * (BUDGET_J + SECONDS * REFILL_W)
    run = open_run(folder)
    for end in run.clients.values():  # the client's own ledger says the same here, as it is right
        own = end.columns("tick", "work_j")["work_j"]
        assert hand_work(end).work_j == pytest.approx(own, abs=1e-9)


@needs_interpreted
def test_hands_that_take_more_than_their_gates_may_give_are_not_passive_whatever_their_clients_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both clients let everything through and say that they have borrowed nothing; the hands' work is recorded all the same."""
    monkeypatch.setattr(SpringGate, "cut", lambda self, stretch, stiffness: 1.0)
    monkeypatch.setattr(SpringGate, "pay", lambda self, stretch, K, damper, velocity, B: damper)
    monkeypatch.setattr(SpringGate, "budget_j", property(lambda self: BUDGET_J))
    summary = run_laboratory(opposed(), tmp_path).summary
    assert all(user["energy"]["down_margin_j"] == 0.0 for user in summary["users"])
    judged = passive(summary)
    assert (judged.tone, summary["passive"]) == ("bad", False), judged.sentence
    assert judged.sentence.startswith("Not passive: all hands together took more than their gates may give")
    assert summary["gates"]["margin_j"] < -summary["gates"]["tolerance_j"]


def test_without_everybodys_recording_it_is_not_known(honest: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    whole, summary = honest
    folder = Path(shutil.copytree(whole, tmp_path / "run"))
    theirs = json.loads(json.dumps(summary))
    theirs["gates"]["margin_j"] = theirs["gates"]["taken_j"] = None
    for user in theirs["users"]:
        user["claimed"] = {"line_margin_j": 0.0, "down_margin_j": 0.0}
    (folder / client_recording("ben")).unlink()
    assert not judge_gates(folder, theirs)
    judged = passive(theirs)
    assert judged.tone == "warn"
    assert "no recording shows the work of the hand of anna, ben" in judged.sentence


def test_other_schemes_have_no_gates(tmp_path: Path) -> None:
    summary = run_laboratory(opposed("coupling"), tmp_path).summary
    assert summary["gates"] is None
    assert not judge_gates(tmp_path, summary)


def test_the_margin_is_the_least_over_time_of_all_hands_together() -> None:
    """One puts in 0.3 J before the other takes 0.35 J; the other way round the sum falls to -0.35 J first."""
    time_s, nothing = np.array([0.0, 1.0, 2.0, 3.0]), np.zeros(4)
    gives = HandWork(time_s, np.array([0.0, 0.3, 0.3, 0.3]), nothing, 1)
    takes = HandWork(time_s + 0.5, np.array([0.0, 0.0, -0.35, -0.35]), nothing, 1)
    assert least_margin_j({"a": gives, "b": takes}) == pytest.approx(2.0 * BUDGET_J - 0.05)
    early = HandWork(time_s - 2.0, takes.work_j, nothing, 1)
    assert least_margin_j({"a": gives, "b": early}) == pytest.approx(2.0 * BUDGET_J - 0.35)
    assert takes.taken_j == 0.35
