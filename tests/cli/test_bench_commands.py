"""`bench impaired`, `playout` and `concealment` as their users type them: what they refuse, how they end, what they answer."""

import json
import multiprocessing
import re
import signal
from dataclasses import replace
from typing import Any

import pytest

from cogrip.cli.terminal.problem import BadInput
from cogrip.experiments.experiment import Result
from cogrip.experiments.worker_pool import LocalWorkers

from tests.bench import concealment, impaired, playout, stability
from tests.bench.__main__ import BENCHES, RENAMED
from tests.bench.concealment import FULL_S, MOST_PEAK, shortfalls
from tests.bench.concealment_trial import CLEAN, ROWS, Trial, drifts_mm
from tests.bench.impaired_network.case import Job
from tests.bench.impaired_network.matrix import LooseRow, Matrix, rows, wrong
from tests.bench.impaired_network.matrix import Row as SessionRow
from tests.bench.playout_trial import TICKS, Arrivals, NothingCameError, fixed_delays
from tests.bench.targets import refuse_own
from tests.cli.command import Cogrip, printed

TRIAL = Trial("", 10.0, 1.0, 10.0, 1.0, 0.0, 0.0, 0.5, 60, ((0.0,),), 0.0, "")
REFUSED = {
    "impaired": [
        ("--set link.loss=0", "--set link.loss=0: bench impaired sets link itself in each session; give --profiles"),
        ('--set coupling={kind="tdpa"}', "sets coupling.kind itself"),
        ("--set playout.redundancy=0", "--set: playout.redundancy: expects a whole number of at least 1"),
        ("--seeds 1000000000", "--seeds 1000000000: at least one seed and at most 10000"),
        ("--loose-seeds -1", "--loose-seeds -1: from 0"),
        ("--people 2,x", "--people 2,x: from 2 to 16 people, with commas between; 'x' is not"),
        ("--people 17", "--people 17: from 2 to 16"),
        ("--stiffness 10,", "--stiffness 10,: from 0 to 1e+07 N/m, with commas between; '' is not"),
        ("--stiffness nan", "'nan' is not"),
        ("--stiffness 10000001", "'10000001' is not"),
        ("--seconds 0.99", "--seconds 0.99: from 1 to 1e+06 s"),
        ("--seconds inf", "--seconds inf: "),
        ("--seconds nan", "--seconds nan: "),
        ("--profiles lann", "--profiles lann: there is no profile 'lann'; did you mean lan?"),
    ],
    "playout": [
        ("--seconds nan", "--seconds nan: from 1 to 3600 s"),
        ("--seconds inf", "--seconds inf: "),
        ("--seconds 0.001", "--seconds 0.001: "),
        ("--network-hz 0", "--network-hz 0: from 1 to 20000 frames a second"),
        ("--network-hz 20001", "--network-hz 20001: "),
        ("--seeds 0", "--seeds 0: from 1 to 10000"),
        ("--seeds 1 --seconds 1 --network-hz 1 --profile wifi", "wifi up: nothing was played out"),
    ],
    "concealment": [
        ("--set users.1.hand=hold", "sets users itself"),
        ("--minutes nan", "--minutes nan: from 0.1"),
        ("--minutes 0.09", "--minutes 0.09: from 0.1"),
        ("--people 0", "--people 0: at least 1"),
    ],
    "devices": [(f"--seconds {each}", f"--seconds {each} is outside 3 to 3600") for each in ("2.9", "3601", "nan")],
}


@pytest.mark.parametrize(
    ("name", "arguments", "words"), [(name, *case) for name, cases in REFUSED.items() for case in cases]
)
def test_what_cannot_be_run_is_refused(
    name: str, arguments: str, words: str, bench: Cogrip, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    err = bench.err(name, *arguments.split(" "))
    assert words in err
    assert words.startswith("wifi") or err.count("\n") <= 2


@pytest.mark.parametrize("own", [impaired.OWN, concealment.OWN])
def test_settings_that_a_benchmark_sets_itself_are_refused(own: dict[str, str]) -> None:
    for key, cure in own.items():
        with pytest.raises(BadInput, match=f"sets {re.escape(key)} itself in each session; {re.escape(cure)}"):
            refuse_own("bench", {key: 1}, own)


def test_values_at_their_bounds_are_taken() -> None:
    matrix = impaired._matrix("lan", "2, 16,2", "0,1e7", 1, 1.0, 0, ["playout.tank_mj=1"])
    assert (matrix.people, matrix.stiffness_npm) == ((2, 16), (0.0, 1e7))
    assert len(impaired._matrix("lan", "2", "10", 10_000, 1e6, 0, []).seeds) == 10_000


def test_overrides_never_reach_a_baseline() -> None:
    """A damped cube would hold, and prove nothing."""
    matrix = Matrix(("lan",), (2,), (1e3,), (0, 1), 3.0, 1, {"object.damping_nspm": 1e3})
    given = {(job.scheme, bool(job.overrides)) for job in matrix.jobs()}
    assert given == {("", True), ("wave", True), ("paper", False), ("coupling", False)}


def test_a_session_of_which_nothing_is_finite_is_wrong_and_reported(
    bench: Cogrip, monkeypatch: pytest.MonkeyPatch
) -> None:
    job, cube = Job(0, "lan", 2, 1e3, 0, 3.0), Job(1, "lan", 2, 1e3, 0, 8.0, "coupling")
    unknown = Result(0, {"passive": True, "diverged": False, "faults": 0, "margin_mj": None, "peak_force_n": None})
    loose = Result(1, {"restless": False, "diverged": False, "radius": None, "margin_mj": None})
    assert "no finite margin" in wrong(job, unknown)
    assert "no finite eigenvalue" in wrong(cube, loose)
    told, cubes = rows([(job, unknown), (cube, loose)])
    assert (told[0].wrong, cubes[0].wrong) == (1, 1)
    ended = {job.case: unknown, cube.case: loose}

    def run(self: LocalWorkers, measure: Any, jobs: Any, batch: int) -> Any:
        return iter([ended[0], *(Result(each.case, loose.measures) for each in jobs if each.scheme)])

    monkeypatch.setattr(impaired.LocalWorkers, "run", run)
    arguments = "--profiles lan --people 2 --stiffness 1000 --seeds 1 --loose-seeds 1 --json -"
    out, err = bench.texts("impaired", *arguments.split(" "), code=1)
    answer = json.loads(out)
    assert answer["impaired"][0]["margin_mj"] is None
    assert answer["loose"][0]["radius"] is None
    assert "loose cubes" in err


def test_stability_prints_its_ratios(bench: Cogrip, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stability, "DELAYS_FRAMES", (1.0,))
    code, out, _ = bench("stability", "--rounds", 1, "--cells", 6)
    assert code in (0, 1)  # how fast this machine is today is no test
    assert "eigvals" in out
    assert "MB" in out


def test_every_benchmark_answers_help(bench: Cogrip) -> None:
    for name in (*BENCHES, *RENAMED):
        out, err = bench.texts(name, "--help")
        now = RENAMED.get(name, name)
        assert now in out
        assert err == ("" if now == name else f"dev.py bench: {name} is called {now} now\n")


def test_playout_answers_in_json_alone(bench: Cogrip) -> None:
    """On so short a run one of the two loses nothing: a ratio that is not finite is null."""
    code, out, err = bench("playout", "--seeds", 1, "--seconds", 1, "--profile", "lan", "--json", "-")
    assert code in (0, 1)
    assert [row["direction"] for row in json.loads(out)["rows"]] == ["up", "down"]
    assert "are asked for" in err


def test_a_run_in_which_nothing_comes_has_no_best_depth() -> None:
    with pytest.raises(NothingCameError, match="of 3 frames none"):
        fixed_delays([Arrivals(128, ((),) * (3 * TICKS))])
    assert fixed_delays([Arrivals(128, ((), (0,)) + ((),) * (3 * TICKS - 2))])[0].lost == 2


@pytest.mark.parametrize(
    ("number", "reason"), [(signal.SIGINT, "stopped (SIGINT)"), (signal.SIGTERM, "stopped (SIGTERM)")]
)
def test_concealment_ends_on_a_signal_with_one_line_and_no_workers(
    number: signal.Signals, reason: str, bench: Cogrip, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Signalled(LocalWorkers):
        def __enter__(self) -> LocalWorkers:
            signal.raise_signal(number)
            return super().__enter__()

    monkeypatch.setattr(concealment, "LocalWorkers", Signalled)
    monkeypatch.setattr(concealment, "processors", lambda: 1)
    before = signal.getsignal(number)
    out, err = bench.texts("concealment", code=130)
    assert out == ""
    assert err == f"{reason}: nothing is reported without all {len(ROWS)} rows\n"
    assert multiprocessing.active_children() == []
    assert signal.getsignal(number) is before


def test_concealment_says_what_is_compared(bench: Cogrip, monkeypatch: pytest.MonkeyPatch) -> None:
    """Zero-fill's peak is 10 N. Only a shorter run than a full one is told to be longer."""
    found = {name: replace(TRIAL, name=name) for name in ROWS}
    found["elastic"] = replace(found["elastic"], peak_n=7.5, law_peak_n=1.0, step_n=0.1, law_step_n=0.1)
    monkeypatch.setattr(concealment, "_run", lambda setup, stop: found)
    told = " ".join(bench.out("concealment", "--minutes", 1).split())
    assert "elastic: of all concealments the lowest in both peaks and both steps" in told
    found["elastic"] = replace(found["elastic"], peak_n=7.6)
    told = " ".join(bench.out("concealment", "--minutes", 1, code=1).split())
    assert "above 0.75 of zero-fill's 10.00 N; 0.75 is asked of 10 minutes: give --minutes 10" in told
    assert shortfalls(found, FULL_S)[0].endswith(f"above {MOST_PEAK:g} of zero-fill's 10.00 N")
    assert "give --minutes 10" in shortfalls(found, FULL_S - 1.0)[0]


def test_a_row_that_diverged_has_the_drifts_before() -> None:
    whole = replace(TRIAL, name=CLEAN, gaps_m=((0.0,), (0.0,)))
    assert drifts_mm(replace(TRIAL, gaps_m=((0.001,),), diverged="anna: gone"), whole) == [1.0]
    with pytest.raises(ValueError, match="longer"):
        drifts_mm(replace(TRIAL, gaps_m=((0.001,),)), whole)


def test_tables_fit_eighty_columns_with_the_widest_that_networks_make() -> None:
    played = dict.fromkeys(
        ["delay_ms", "best_delay_ms", "number_delay_ms", "expected_ms"], 327.81
    ) | {"profile": "satellite", "direction": "down", "held_ms": 35.39, "best_held_ms": 35.16,
         "late_share": 0.12345, "moves_a_minute": 123.4,
         "best_late_share": 0.12345, "delay_ratio": 1.234, "late_ratio": 12.345, "beaten": True,
         "number": 12, "number_late_share": 0.12345}  # fmt: skip
    storm = SessionRow("satellite", 16, 100_000.0, 400, 400, 400, -1.2e-10, 12.34, 123.4, 12.345, 12.34, 12.3, 12.3)
    loose = LooseRow("satellite", 16, "coupling", 100_000.0, 400, 400, 400, 12.3456, 515.7, 400)
    for table, rows_below in (
        (playout._table([played], 128), 2),
        (impaired._session_table([storm], 3.0), 1),
        (impaired._loose_table([loose]), 1),
    ):
        text = printed(table, 80)
        assert sum("satellite" in line for line in text.splitlines()) == rows_below
        assert "…" not in text
