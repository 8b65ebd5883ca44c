"""Tests of device rates from 1024 to 8192 Hz, each person's own, and network rates from 32 to 1024 Hz."""

import math
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.analysis.feel.feel import held, impedance
from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import linear_session
from cogrip.analysis.linear.stability import verdict
from cogrip.protocol.laws.felt_stiffness import felt_stiffness, line_compliance
from cogrip.protocol.recording.reader import open_recording
from cogrip.protocol.settings.digest import digest
from cogrip.protocol.settings.rates import due_ns
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.results.reading.records import open_run
from cogrip.results.replay.verify import verify
from cogrip.results.replay.what_if import what_if
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.results.writing.summary import of_laboratory
from cogrip.sim.laboratory import Laboratory, moments_of

from tests.extent import long
from tests.kinds import OBJECTS
from tests.sim.felt_forces import Felt
from tests.sim.measured_impedance import measure, static_stiffness
from tests.sim.session_measures import allowed, least_margin, summary_of

NOTHING_J = -1e-12
DEVICE_HZ = (1024, 2048, 3072, 4096, 8192)


def world(network_hz: int, device_hz: list[int], **more: Any) -> dict[str, Any]:
    people = [
        {"name": f"p{number}", "device": "sim:ideal", "device_hz": hz, "side": ("left", "right")[number % 2]}
        for number, hz in enumerate(device_hz)
    ]
    return {"rates": {"device_hz": max(1024, network_hz), "network_hz": network_hz}, "users": people, **more}


# The grids -----------------------------------------------------------------------------------------------------------


@given(st.integers(1, 2000), st.lists(st.integers(1, 40), min_size=1, max_size=5), st.integers(0, 10**6))
def test_everybody_ticks_on_their_own_grid_and_borders_are_common(hz: int, ticks: list[int], frame: int) -> None:
    moments = moments_of(ticks)
    assert moments[0] == tuple((number, 0) for number in range(len(ticks))), "in seat order"
    for number, M in enumerate(ticks):
        mine = [step for moment in moments for seat, step in moment if seat == number]
        assert mine == list(range(M))
    times = []
    for moment in moments:
        dues = {due_ns(0, frame * ticks[seat] + step, ticks[seat] * hz) for seat, step in moment}
        assert len(dues) == 1, "one moment is one nanosecond"
        assert len({Fraction(step, ticks[seat]) for seat, step in moment}) == 1
        times += dues
    border_ns = due_ns(0, frame + 1, hz)
    assert all(one < other for one, other in pairwise([*times, border_ns])), "and two are two"


def test_ticks_of_each_loop_are_counted_for_themselves() -> None:
    laboratory = Laboratory(resolve(world(128, [8192, 1024, 3072], seconds=0.25)))
    moments = []
    laboratory.run(lambda lab: moments.append(lab.now_ns))
    assert [user["ticks"]["due"] for user in of_laboratory(laboratory)["users"]] == [2048, 256, 768]
    assert [person.core.tick for person in laboratory.people] == [2047, 255, 767]
    assert laboratory.tick == len(moments) == len(set(moments)) == 32 * (64 + 16), "of 24 thirds of 64 every third"


def test_one_rate_for_all_is_that_rate_whoever_names_it() -> None:
    """The same users.N.device_hz for everybody is the one of [rates]."""
    named, common = world(128, [2048, 2048], seconds=0.5), world(128, [2048, 2048], seconds=0.5)
    for user in common["users"]:
        del user["device_hz"]
    common["rates"]["device_hz"] = 2048
    assert digest(resolve(named)) == digest(resolve(common))
    assert summary_of(**named) == summary_of(**common)


def test_another_persons_rate_is_hardly_felt() -> None:
    """The wire is the same, the object's rate too: what one feels changes by what a tick is late, no more."""
    alike, unlike = (
        summary_of(**world(128, [1024, other], seconds=0.8, link={"delay_ms": 15.625}))["users"][0]
        for other in (1024, 4096)
    )
    for peak in ("peak_force_n", "travel_m"):
        assert unlike[peak] == pytest.approx(alike[peak], rel=0.02)


# Passive at every rate -----------------------------------------------------------------------------------------------


@settings(max_examples=10)
@given(st.data())
def test_every_line_is_passive_at_every_rate(data: st.DataObject) -> None:
    network_hz = data.draw(st.sampled_from([32, 64, 128, 256, 512, 1024]), "network_hz")
    device_hz = data.draw(st.lists(st.sampled_from(DEVICE_HZ), min_size=2, max_size=2), "device_hz")
    kind = data.draw(st.sampled_from(OBJECTS), "kind")
    table = world(
        network_hz, device_hz, seconds=max(0.3, 16.0 / network_hz), seed=data.draw(st.integers(0, 99), "seed"),
        object={"kind": kind, "axes": data.draw(st.sampled_from([1, 1, 3]), "axes")},
        coupling={
            "stiffness_npm": 10.0 ** data.draw(st.floats(1.0, 5.0), "log K"),
            "impedance_nspm": data.draw(st.floats(2.0, 40.0), "b"),
        },
        link={
            "delay_ms": data.draw(st.floats(0.0, 60.0), "delay"), "jitter_ms": data.draw(st.floats(0.0, 30.0), "jitter"),
            "loss": data.draw(st.floats(0.0, 0.5), "loss"), "duplicate": 0.1, "reorder": 0.1,
        },
        playout={"frames": data.draw(st.integers(0, 6), "frames")},
    )  # fmt: skip
    for user in table["users"]:
        user["hand"] = "reach&amplitude_m=0.02&stroke_s=0.2"
        ticks = user["device_hz"] // network_hz
        user["decimator"] = data.draw(
            st.sampled_from(["boxcar"] if ticks > 1 else ["boxcar", "lowpass", "none"]), "filter"
        )
    summary = summary_of(**table)
    assert not any(summary[key] for key in ("unstable", "saturated", "left"))
    assert least_margin(summary) >= NOTHING_J


def test_without_a_filter_only_one_tick_a_frame_is_passive() -> None:
    """M = 1 leaves nothing to alias; at M = 8 the same hands create energy: the test above can fail."""
    margins = []
    for network_hz in (1024, 128):
        table = world(network_hz, [1024, 1024], seconds=0.5, coupling={"decimator": "none"})
        for user in table["users"]:
            user["hand"] = "sine&frequency_hz=120&amplitude_m=0.001"
        margins.append(least_margin(summary_of(**table)))
    assert margins[0] >= NOTHING_J
    assert margins[1] < allowed("up_margin_j") - 1e-6


@pytest.mark.long
def test_no_jolt_where_people_of_many_rates_come_and_go() -> None:
    table = world(
        128, [1024, 3072, 2048], seconds=1e3, object={"axes": 3}, link={"delay_ms": 10}, playout={"frames": 1}
    )
    for user, direction in zip(table["users"], ("1,0,0", "-1,0,0", "0,1,0"), strict=True):
        user["hand"] = f"sine&amplitude_m=0.02&frequency_hz=1&direction={direction}"
    laboratory = Laboratory(resolve(table))
    felt = Felt(laboratory, 0, 1)
    felt.run(80)
    leaver = laboratory.people[2]
    laboratory.leave(2)
    felt.run(120)
    assert leaver.core.session.state == "closed"
    assert leaver.core.coupling.down_margin_j + allowed("down_margin_j") >= NOTHING_J
    laboratory.come(2)
    felt.run(60)
    assert laboratory.people[2].core.safety.state == "live"
    assert laboratory.people[2].core.tick == 60 * 16 - 1, "their own clock begins anew"
    assert felt.step_n < 0.5
    assert least_margin(of_laboratory(laboratory)) >= NOTHING_J


# What is felt --------------------------------------------------------------------------------------------------------


@pytest.mark.sample(1)
@pytest.mark.parametrize(("device_hz", "network_hz", "frames"), [(1024, 32, 1), (4096, 1024, 8)])
def test_the_line_is_as_soft_as_theory_says_at_every_rate(device_hz: int, network_hz: int, frames: int) -> None:
    """C_line of theory section 4 depends on T_n: formula, seat's prediction, and a hand at rest in a session."""
    table = {
        "rates": {"device_hz": device_hz, "network_hz": network_hz},
        "object": {"kind": "wall"},
        "coupling": {"stiffness_npm": 400.0},
        "link": {"delay_ms": frames * 1e3 / network_hz},
        "users": [{"name": "a", "device_damping_nspm": 2.0}],
    }
    wanted = felt_stiffness(400.0, line_compliance(20.0, 2.0 * frames / network_hz, 1.0 / network_hz))
    seat = seat_settings(resolve(table), 0)
    assert seat.predicted_stiffness(2 * frames + 1) == pytest.approx(wanted, rel=1e-9)
    assert static_stiffness(resolve(table), 0, settle_s=1.5) == pytest.approx(wanted, rel=0.005)


@pytest.mark.parametrize("network_hz", [32, 1024])
def test_no_passive_session_has_a_growing_mode_at_any_rate(network_hz: int) -> None:
    """Theory section 6's last row, for people of unlike rates, from K = 100 to 20000."""
    table = world(network_hz, [1024, 8192], coupling={"impedance_nspm": 20.0}, link={"delay_ms": 2e3 / network_hz})
    model = LiftedModel(linear_session(resolve(table), estimated=False))
    for K in (100.0, 1000.0, 20000.0):
        radius = np.abs(np.linalg.eigvals(model.matrix([K, K]))).max()
        assert radius == pytest.approx(1.0, abs=5e-5)
    assert verdict(model).stable


@pytest.mark.long
@pytest.mark.parametrize(("scheme", "user"), [long("wave", 0), ("wave", 1), long("coupling", 1)])
def test_the_linear_model_of_unlike_rates_is_that_of_their_session(scheme: str, user: int) -> None:
    """The analysis goes by each person's own rate: the rendered impedance agrees to 1e-3."""
    table = world(128, [1024, 4096], coupling={"kind": scheme}, link={"delay_ms": 7.8125 if scheme == "wave" else 0.0})
    for each in table["users"]:
        each["hand"] = "hold"
    asked = resolve(table)
    measured = measure(asked, user, 9.0, amplitude_m=2e-4, settle_s=1.5)
    session = held(linear_session(asked, estimated=False), user, 300.0, 5.0)
    model = impedance(session, user, np.array([2.0 * math.pi * measured.frequency_hz]))[0]
    assert abs(measured.impedance - model) < 1e-3 * abs(model)


# What a run leaves ---------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_run_of_unlike_rates_replays(tmp_path: Path) -> None:
    """It replays bit for bit, and with the same hands again, which begin when they began."""
    table = world(64, [4096, 1024], seconds=0.5, link={"delay_ms": 10, "loss": 0.1, "jitter_ms": 5})
    ran = run_laboratory(resolve(table), tmp_path, begins=(0, 16 * 16)).summary
    rates, ticks = {}, {}
    for path in tmp_path.glob("*.mcap"):
        recording = open_recording(path)
        found = verify(recording)
        assert found.exact, (path.name, found.difference)
        rates[recording.header.who], ticks[recording.header.who] = recording.header.rate_hz, found.ticks
    assert rates == {"p0": 4096, "p1": 1024, "server": 64}
    assert ticks == {"p0": 2048, "p1": 512 - 256, "server": 32}
    again = what_if(open_run(tmp_path), {})
    assert again.begins == (0, 256)
    assert run_laboratory(again.settings, begins=again.begins).summary == ran
    faster = what_if(open_run(tmp_path), {"users.1.device_hz": 2048})
    assert faster.begins == (0, 512)
