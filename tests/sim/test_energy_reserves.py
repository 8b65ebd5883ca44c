"""Energy reserves in whole sessions: kept in order with the margins, and shown as they are."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from cogrip.cli.session.live_views import LiveTable
from cogrip.cli.settings.settings_file import load
from cogrip.protocol.laws.passivity_control import LENT_J
from cogrip.protocol.settings.coupling_kinds import COUPLING_KINDS, Kind
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.results.plots import compared
from cogrip.results.plots.energy import energies
from cogrip.results.reading import summary_values
from cogrip.results.reading.summary_values import seat_sessions
from cogrip.results.reading.traces import TracedRun, load_run
from cogrip.results.verdict.verdict import passive
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.results.writing.summary import of_laboratory
from cogrip.server.inputs import Kick
from cogrip.sim.laboratory import Laboratory

from tests.kinds import SCHEMES, object_of
from tests.results.reported_runs import printed
from tests.sim.session_measures import MARGINS, run_frames

LEDGERS = ("up", "down", "line", "device")
TANK_J = 5e-3
SLOW = {"device_hz": 512}  # fewer ticks, where borders of frames count
ROUNDING_J = 1e-12


def session(kind: Kind = "wave", seconds: float = 1.5, **more: Any) -> Settings:
    users = [{"name": "anna", "hand": "reach"}, {"name": "ben", "hand": "hold"}]
    stiffness = {} if COUPLING_KINDS[kind].passive else {"stiffness_npm": 100.0}
    table = {
        "name": "reserves", "seconds": seconds, "object": {"kind": object_of(kind)},
        "coupling": {"kind": kind, **stiffness}, "users": users,
    }  # fmt: skip
    return resolve({**table, **more})


def watch(laboratory: Laboratory) -> None:
    """Hold the law at one moment, for every ledger there is: the reserve of now is no less than the least so far."""
    pairs: list[tuple[float | None, float | None]] = []
    for person in laboratory.people:
        coupling, port = person.core.coupling, person.core.port
        pairs.append((coupling.down_reserve.now_j, coupling.down_margin_j))
        pairs.append((port.balance_j + port.reserve_j, port.account().margin_j))
    for seat in laboratory.room.seats:
        if seat.port is not None:
            pairs.append((seat.port.up_reserve.now_j, seat.port.up_margin_j))
            pairs.append((seat.line_reserve.now_j, seat.line_margin_j))
    for now_j, margin_j in pairs:
        assert now_j is None or margin_j is None or now_j >= margin_j - ROUNDING_J


def lawful(summary: dict[str, Any]) -> None:
    """Hold the law at the end: the least of all is no more than the least after the first second."""
    for row in seat_sessions(summary["users"]):
        for ledger in LEDGERS:
            margin_j, reserve_j = (row["energy"][f"{ledger}_{what}_j"] for what in ("margin", "reserve"))
            assert reserve_j is None or margin_j <= reserve_j + ROUNDING_J


@settings(max_examples=12, deadline=None)
@given(
    kind=st.sampled_from(SCHEMES),
    seconds=st.sampled_from([0.3, 1.2]),
    tank_mj=st.sampled_from([0.0, 1e3 * TANK_J]),
    loss=st.sampled_from([0.0, 0.2]),
    jitter_ms=st.sampled_from([0.0, 10.0]),
    seed=st.integers(0, 99),
)
def test_margin_and_reserve_keep_their_order_whatever_the_session(
    kind: Kind, seconds: float, tank_mj: float, loss: float, jitter_ms: float, seed: int
) -> None:
    link = {"delay_ms": 10.0, "loss": loss, "jitter_ms": jitter_ms}
    laboratory = Laboratory(session(kind, seconds, seed=seed, rates=SLOW, link=link, playout={"tank_mj": tank_mj}))
    laboratory.run(watch)
    summary = of_laboratory(laboratory)
    lawful(summary)
    long = laboratory.seconds > 1.1
    for user in summary["users"]:
        told = {ledger: user["energy"][f"{ledger}_reserve_j"] for ledger in LEDGERS}
        kept = ("line", "device") if kind == "coupling" else LEDGERS
        assert all((told[ledger] is not None) is (long and ledger in kept) for ledger in LEDGERS), told


def test_a_lossless_line_holds_what_is_on_its_way_and_owes_nothing_down() -> None:
    laboratory = Laboratory(session())
    laboratory.run()
    for user in of_laboratory(laboratory)["users"]:
        energy = user["energy"]
        assert energy["down_reserve_j"] == pytest.approx(0.0, abs=ROUNDING_J), "each joule that was sent was played"
        assert energy["line_reserve_j"] >= energy["up_reserve_j"] > 1e-4
        assert energy["device_reserve_j"] > 0.1


@pytest.mark.parametrize(("kind", "lent_j"), [("wave", TANK_J), ("tdpa", LENT_J)])
def test_a_line_that_lends_shows_it_in_its_margin_and_is_still_passive(kind: Kind, lent_j: float) -> None:
    playout = {"tank_mj": 1e3 * TANK_J, "concealment": "tank", "redundancy": 1}
    lossy = {"delay_ms": 10.0, "loss": 0.3, "burst_frames": 4.0}
    laboratory = Laboratory(session(kind, seed=0, link=lossy, playout=playout))
    laboratory.run(watch)
    summary = of_laboratory(laboratory)
    assert summary["passive"] is True
    assert min(user["energy"][f"{ledger}_margin_j"] for user in summary["users"] for ledger in ("up", "down")) < 0.0
    assert all(user["energy"]["line_reserve_j"] > -2.0 * lent_j for user in summary["users"])
    assert "within what a line may lend" in passive(summary).sentence
    assert "; least reserve after the first second" in passive(summary).sentence


@pytest.mark.parametrize(("kind", "bound_j"), [("wave", 2e-3), ("local", 2e-3), ("tdpa", 1e-3), ("coupling", 1e-3)])
def test_waves_are_held_to_their_credit_and_what_lends_nothing_to_a_millijoule(kind: str, bound_j: float) -> None:
    settings = session("wave", playout={"tank_mj": 2.0})
    table = {**msgspec.to_builtins(settings), "coupling": {"kind": kind}}
    assert summary_values.lent_j(table) == bound_j


@pytest.mark.long
def test_virtual_coupling_that_gives_out_microjoules_is_held_to_the_same_bound() -> None:
    config = Path(__file__).parents[2] / "configs" / "compare.toml"
    laboratory = Laboratory(load(config, ("coupling.kind=coupling", "seconds=4")))
    laboratory.run(watch)
    summary = of_laboratory(laboratory)
    margins = [user["energy"][key] for user in summary["users"] for key in MARGINS]
    assert -1e-3 < min(margin for margin in margins if margin is not None) < -1e-8
    assert summary["passive"] is True
    assert "within what a line may lend" in passive(summary).sentence
    tight = Laboratory(load(config, ("coupling.kind=coupling", "seconds=4", "playout.tank_mj=0")))
    tight.run(watch)
    assert of_laboratory(tight)["passive"] is False


# Seats that are taken again -------------------------------------------------------------------------------------------


def run_until(laboratory: Laboratory, done: Callable[[], bool]) -> None:
    for _ in range(600):
        if done():
            return
        laboratory.frame(watch)
    raise AssertionError("it takes too long")


@pytest.mark.long
def test_whoever_takes_a_seat_anew_has_a_first_second_anew() -> None:
    laboratory = Laboratory(session(seconds=60.0, rates=SLOW))
    run_frames(laboratory, 150, watch)
    laboratory.leave(0)
    run_until(laboratory, lambda: laboratory.people[0].core.session.state == "closed")
    left = laboratory.room.seat_account(0)
    laboratory.come(0)
    run_frames(laboratory, 100, watch)
    lawful(summary := of_laboratory(laboratory))
    [before] = summary["users"][0]["earlier"]
    assert before["energy"]["line_reserve_j"] == left.line_reserve_j
    assert [summary["users"][0]["energy"][f"{ledger}_reserve_j"] for ledger in LEDGERS] == [None] * 4
    row = next(line for line in printed(summary, 80).splitlines() if line.startswith("anna (2)"))
    assert row.split()[5] == "-"
    run_frames(laboratory, 100, watch)
    lawful(summary := of_laboratory(laboratory))
    assert all(summary["users"][0]["energy"][f"{ledger}_reserve_j"] is not None for ledger in LEDGERS)


def test_a_resumed_seat_goes_on_and_a_kicked_one_keeps_what_was_known() -> None:
    laboratory = Laboratory(session(seconds=60.0, rates=SLOW))
    run_frames(laboratory, 150, watch)
    seat, core = laboratory.room.seats[0], laboratory.people[0].core
    least_j = laboratory.room.seat_account(0).line_reserve_j
    laboratory.lose_address(0)
    run_until(laboratory, lambda: core.session.resumed == 1)
    run_frames(laboratory, 30, watch)
    resumed_j = laboratory.room.seat_account(0).line_reserve_j
    assert resumed_j <= least_j, "the same line"
    laboratory.server.handle(Kick("anna"), laboratory.now_ns)
    run_frames(laboratory, 5, watch)
    assert seat.port is None
    kicked_j = laboratory.room.seat_account(0).line_reserve_j
    assert kicked_j <= resumed_j
    lawful(of_laboratory(laboratory))


def test_a_new_server_begins_a_new_line_and_the_client_keeps_the_least_of_all() -> None:
    laboratory = Laboratory(
        session(seconds=60.0, rates=SLOW, link={"delay_ms": 10.0, "loss": 0.1}, playout={"tank_mj": 5.0})
    )
    run_frames(laboratory, 150, watch)
    core = laboratory.people[0].core
    least_j, margin_j = core.ledger.down_reserve_j, core.coupling.down_margin_j
    checkpoints = laboratory.kill()
    run_frames(laboratory, 20, watch)
    laboratory.restart(checkpoints)
    while core.session.renewed == 0:
        least_j = core.ledger.down_reserve_j
        laboratory.frame(watch)
    run_frames(laboratory, 20, watch)
    assert core.ledger.down_reserve_j == least_j, "the new line has no second yet"
    assert core.coupling.down_margin_j <= margin_j
    assert laboratory.room.seat_account(0).line_reserve_j is None
    lawful(of_laboratory(laboratory))


# What is shown --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> TracedRun:
    folder = tmp_path_factory.mktemp("reserves")
    run_laboratory(session(playout={"tank_mj": 0.0}), folder)
    return load_run(folder)


def test_the_recorded_reserves_lead_to_the_margins_and_to_the_least_in_the_summary(run: TracedRun) -> None:
    for number, user in enumerate(run.summary["users"]):
        ticks = run.clients[user["name"]].columns
        traces = {
            "down": (ticks["reserve_j"], 1024 - 8),
            "device": (ticks["device_reserve_j"], 1024),
            "up": (run.room.columns[f"{number}.up_reserve_j"], 128 - 1),
            "line": (run.room.columns[f"{number}.line_reserve_j"], 128 - 1),
        }
        for ledger, (reserve_j, second) in traces.items():
            told_j = user["energy"][f"{ledger}_reserve_j"]
            begun, later = np.nanmin(reserve_j[second:]), np.nanmin(reserve_j[second + second // 16 :])
            if ledger == "device":  # its least is seen before a frame's own damping is credited
                begun -= 1e-2 * begun
            assert begun - ROUNDING_J <= told_j <= later + ROUNDING_J, "a seat's time begins with its first frame"
            assert np.nanmin(reserve_j) >= user["energy"][f"{ledger}_margin_j"] - ROUNDING_J


def test_the_plots_draw_the_reserves_as_curves_above_their_border(run: TracedRun) -> None:
    figure = energies(run)
    for left, right in zip(figure.axes[::2], figure.axes[1::2], strict=True):
        assert (len(left.lines), len(right.lines)) == (3, 3)
        heights = [float(np.nanmax(np.asarray(line.get_ydata(), dtype=float))) for line in right.lines]
        low, high = right.get_ylim()
        assert low < 0.0 < max(heights) < high
        assert max(heights) > 0.7 * (high - low), "the curve fills its panel"
    pair = compared.energies([compared.Side(run, "a", {"color": "C0"})] * 2, ["anna", "ben"])
    assert [len(panel.lines) for panel in pair.axes] == [4, 2, 4, 2]


def test_recordings_of_older_versions_have_no_empty_panel(run: TracedRun) -> None:
    def without_reserves(columns: Any) -> dict[str, Any]:
        return {key: columns[key] * (np.nan if key.endswith("reserve_j") else 1.0) for key in columns}

    clients = {name: replace(trace, columns=without_reserves(trace.columns)) for name, trace in run.clients.items()}
    old = replace(run, clients=clients, room=replace(run.room, columns=without_reserves(run.room.columns)))
    assert [len(panel.lines) for panel in energies(old).axes] == [3, 3]
    pair = compared.energies([compared.Side(old, "a", {"color": "C0"})], ["anna", "ben"])
    assert [len(panel.lines) for panel in pair.axes] == [2, 2]
    lost = replace(run, room=None)
    assert [len(panel.lines) for panel in energies(lost).axes] == [3, 1, 3, 1], "the line down is known to its client"


@pytest.mark.parametrize("width", [80, 120])
def test_the_terminal_says_the_least_reserves_and_the_leak(run: TracedRun, width: int) -> None:
    lines = printed(run.summary, width).splitlines()
    assert all(len(line) <= width for line in lines)
    text = " ".join(" ".join(lines).split())
    assert "reserve" in text
    assert "margin" not in text
    assert "device ports: least reserve 2" in text
    assert "leaked to the hand at most" in " ".join(text.split())
    assert "; least reserve after the first second " in text
    row = next(line for line in lines if line.startswith("anna"))
    assert " mJ " in row or " µJ " in row


def test_a_negative_margin_is_not_hidden_by_a_reserve(run: TracedRun) -> None:
    """Both may be so: a line that gave out energy in its first second, a device whose deficit was written off."""
    anna, ben = run.summary["users"]
    line = {**anna, "energy": {**anna["energy"], "line_margin_j": -0.25}}
    device = {**ben, "energy": {**ben["energy"], "device_margin_j": -0.5}}
    text = printed({**run.summary, "passive": False, "users": [line, device]}, 120)
    assert "−250 mJ" in next(row for row in text.splitlines() if row.startswith("anna"))
    assert "device ports: least reserve −500 mJ (ben)" in text
    assert "Not passive: the whole line of anna gave out 250 mJ more than had been put in." in text
    assert "after the first second" not in text


def test_where_no_ledger_is_kept_or_the_session_was_short_nothing_is_said(run: TracedRun) -> None:
    users = [
        {**user, "energy": {**user["energy"], **dict.fromkeys(f"{each}_reserve_j" for each in LEDGERS)}}
        for user in run.summary["users"]
    ]
    summary = {**run.summary, "users": users}
    text = printed(summary, 120)
    assert next(row for row in text.splitlines() if row.startswith("anna")).split()[4] == "-"
    assert passive(summary).sentence == (
        "Passive: no line ever gave out more energy than had been put in, no device's motors either. "
        "A person's energy budget is 276 mJ, with nothing lent by the line."
    )


@pytest.mark.parametrize("kind", ["wave", "coupling"])
def test_the_live_table_shows_the_reserves_of_now(tmp_path: Path, kind: str) -> None:
    run_laboratory(session(kind, 0.5), tmp_path)
    console = Console(width=80, color_system=None)
    with console.capture() as capture:
        console.print(LiveTable(tmp_path, "reserves", ["anna", "ben"]).table())
    row = next(line for line in capture.get().splitlines() if line.split()[:1] == ["anna"])
    up, down, line, port = row.split()[4:8]  # after name, state, hand and force
    assert float(port) > 100.0
    if kind == "coupling":
        assert (up, down) == ("-", "-")
        return
    assert float(up) > 0.0
    assert float(down) == 0.0
    assert float(line) >= float(up)
