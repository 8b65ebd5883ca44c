"""A seeded sample of the matrix of impaired networks, which `dev.py bench impaired` runs whole; and proof that it can fail."""

from types import SimpleNamespace
from typing import Any

import pytest

from cogrip.devices.registry import make
from cogrip.experiments.experiment import Result, run_case

from tests.bench.__main__ import main as bench
from tests.bench.impaired_network.case import Job, Pushes, growth, measure_case, radius
from tests.bench.impaired_network.matrix import LEAST_GROWTH, Matrix, batch, rows, wrong
from tests.bench.impaired_network.room import NETWORKS, impaired
from tests.extent import every, long

JOBS = [
    Job(number, network, people, K, seed, 1.0)
    for number, (network, people, K, seed) in enumerate([
        ("lan", 2, 1e5, 1), ("wifi", 3, 1e5, 2), ("wan", 2, 1e5, 7), ("lte", 5, 1e5, 4), ("satellite", 4, 1e3, 0),
        ("satellite", 2, 1e5, 9),
    ])
]  # fmt: skip


def test_the_sample_has_every_network() -> None:
    assert {job.network for job in JOBS} == set(NETWORKS)


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    "job", every(4, JOBS), ids=lambda job: f"{job.network}-{job.people}-{job.stiffness_npm:g}-{job.seed}"
)
def test_ours_is_passive_and_holds_on_every_network(job: Job) -> None:
    result = run_case(measure_case, job)
    assert wrong(job, result) == "", result.measures
    assert result.measures["balance_mj"] < 1e-6


@pytest.mark.sample(1)
@pytest.mark.parametrize("network", ["lan", long("satellite")])
@pytest.mark.parametrize(("scheme", "K"), [("coupling", 2000.0), ("paper", 5000.0), ("wave", 1e5)])
def test_a_loose_cube_goes_as_its_eigenvalues_say(network: str, scheme: str, K: float) -> None:
    """The baselines fail where theory section 6 says so, whatever the network; ours, at fifty times K, does not."""
    fails = scheme != "wave"
    seconds = 8.0 if fails else 4.0
    job = Job(0, network, 2, K, 1, seconds, scheme)
    result = run_case(measure_case, job)
    assert wrong(job, result) == ""
    assert (growth(result.measures["radius"], seconds, 128) >= LEAST_GROWTH) is fails
    assert result.measures["restless"] is fails


def test_golden_eigenvalues_of_loose_cubes() -> None:
    """Theory section 6, d = 1 (a lan's delay waits for a border), with free hands: 1.2289 and 3.1487. These barely hold."""
    coupling = Job(0, "lan", 2, 2000.0, 0, 1.0, "coupling")
    paper = Job(0, "lan", 2, 5000.0, 0, 1.0, "paper", {"playout.frames": 0})
    assert radius(coupling.settings()) == pytest.approx(1.2289, abs=2e-3)
    assert radius(paper.settings()) == pytest.approx(3.1487, abs=5e-3)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"diverged": True, "reason": "anna: gone"}, "diverged: anna: gone"),
        ({"passive": False}, "not passive"),
        ({"margin_mj": -80.0001}, "not passive: margin -80 mJ"),
        ({"faults": 1}, "1 in a fault"),
    ],
)
def test_a_session_that_shows_less_than_it_must_is_wrong(changed: dict[str, Any], words: str) -> None:
    well = {"passive": True, "diverged": False, "reason": "", "faults": 0, "margin_mj": -80.0}
    assert wrong(JOBS[0], Result(0, well)) == ""
    assert words in wrong(JOBS[0], Result(0, {**well, **changed}))
    assert wrong(JOBS[0], Result(0, {}, "MemoryError: no")) == "MemoryError: no"
    stronger = {**well, "overpowered": True}
    assert wrong(JOBS[0], Result(0, {**stronger, "diverged": True, "faults": 1})) == ""
    assert "not passive" in wrong(JOBS[0], Result(0, {**stronger, "margin_mj": -81.0})), "whoever pushes"


@pytest.mark.parametrize(
    ("newton", "oscillates", "let_go"),
    [(9.0, False, True), (7.5, False, False), (9.0, True, False), (-9.0, False, True)],
)
def test_a_hand_that_pushes_with_more_than_its_device_has_is_let_go_rightly(
    newton: float, oscillates: bool, let_go: bool
) -> None:
    """Two people are at the peak of their devices, 8.5 N, and the first is in a fault."""
    device = make(f"sim:phantom?hand=push&force_n={newton}")
    device.open(1024)
    people = [
        SimpleNamespace(
            device=device,
            core=SimpleNamespace(
                tick=1, capability=device.capability, port=SimpleNamespace(oscillates=oscillates),
                safety=SimpleNamespace(at_peak=lambda: True, state=state),
            ),
        )
        for state in ("fault", "live")
    ]  # fmt: skip
    laboratory: Any = SimpleNamespace(people=people)
    pushes = Pushes(laboratory)
    assert not pushes.overpowered(laboratory), "nobody was at a peak"
    pushes.each_tick(laboratory)
    assert pushes.overpowered(laboratory) is let_go


def test_people_who_are_stronger_than_phantoms_end_a_session_rightly() -> None:
    result = run_case(measure_case, Job(0, "lan", 4, 1e4, 0, 8.0))
    assert result.measures["overpowered"]
    assert result.measures["faults"] == 1
    assert wrong(Job(0, "lan", 4, 1e4, 0, 8.0), result) == ""


def test_a_baseline_that_holds_where_it_must_fail_is_wrong() -> None:
    job = Job(0, "lan", 2, 1000.0, 0, 8.0, "coupling")
    held = {"passive": False, "diverged": False, "restless": False, "margin_mj": -1.0, "radius": 1.05}
    assert "could not fail" in wrong(job, Result(0, held))
    assert wrong(job, Result(0, {**held, "restless": True})) == ""
    assert wrong(job, Result(0, {**held, "radius": 1.005})) == "", "it grows too slowly for a session to tell"


def test_the_matrix_is_every_combination_and_rows_keep_the_worst() -> None:
    matrix = Matrix(("lan", "wan"), (2, 3), (1e3, 1e5), (0, 1, 2), 3.0, 1, {})
    jobs = matrix.jobs()
    sessions = [job for job in jobs if not job.scheme]
    assert len(sessions) == 2 * 2 * 2 * 3
    assert len(jobs) - len(sessions) == 2 * 2 * 4
    assert [job.case for job in jobs] == list(range(len(jobs)))
    assert batch(jobs) == 2, "one room on both networks: its clean link is run once"
    results = [
        Result(job.case, {
            "passive": True, "diverged": False, "faults": 0, "overpowered": job.seed == 1,
            "margin_mj": -1e-12 * job.seed, "coherence_rms_mm": job.seed,
            "coherence_max_mm": 1.0, "drift_mm": float(job.seed), "peak_force_n": 1.0, "force_step_n": 1.0,
        }) for job in sessions
    ]  # fmt: skip
    found, cubes = rows(zip(sessions, results, strict=True))
    assert len(found) == 8
    assert cubes == []
    assert {(row.sessions, row.wrong, row.margin_mj, row.drift_mm, row.median_drift_mm) for row in found} == {
        (3, 0, -2e-12, 2.0, 1.0)
    }
    assert {row.overpowered for row in found} == {1}


def test_every_seed_is_another_room_and_the_same_every_time() -> None:
    rooms = [impaired("lan", 4, 1e3, seed, 3.0) for seed in range(12)]
    assert rooms == [impaired("lan", 4, 1e3, seed, 3.0) for seed in range(12)]
    assert {(room["object"]["kind"], room["object"]["axes"]) for room in rooms} == {
        ("cube", 1), ("cube", 3), ("faces", 1), ("faces", 3)
    }  # fmt: skip
    assert {user["device"] for room in rooms for user in room["users"]} == {"sim:ideal", "sim:phantom"}
    assert any("device_hz" in user for room in rooms for user in room["users"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--people", "1"], "--people 1: from 2 to 16"),
        (["--seeds", "0"], "at least one seed"),
        (["--workers", "0"], "--workers 0"),
    ],
)
def test_a_matrix_that_cannot_be_run_is_refused(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert bench(["storms", *arguments]) == 2
    assert words in capsys.readouterr().err.replace("\n", " ")
