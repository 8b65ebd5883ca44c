"""Whole sessions on lines whose impedance and filter follow the delay: energy, feel, and what a change does to the hand."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import to_builtins
from msgspec.structs import replace

from cogrip.client.coupling.wave_coupling import WaveCoupling
from cogrip.experiments.methods.case import run_session
from cogrip.experiments.methods.measures import swing_n
from cogrip.experiments.methods.method import session_settings
from cogrip.protocol.recording.reader import open_recording
from cogrip.protocol.settings.coupling import LineTuning
from cogrip.protocol.settings.line_tuning import Tuning, tuning
from cogrip.protocol.settings.network_profiles import PROFILES
from cogrip.protocol.settings.room import resolve
from cogrip.results.replay.verify import verify
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.results.writing.summary import of_laboratory
from cogrip.sim.laboratory import Laboratory

from tests.extent import every, long
from tests.sim.session_measures import least_margin, summary_of

AUTO = {"impedance_nspm": "auto", "wave_filter_hz": "auto"}
NOTHING_J = -1e-12
HAND = "tremor&amplitude_m=0.03&stroke_s=1.0&tremor_m=0.0002&hand_damping_nspm=20"


def pulling(
    network: str, seed: int = 1, people: int = 2, kind: str = "cube", seconds: float = 4.0, **coupling: Any
) -> Any:
    users = [
        {"name": f"u{number}", "hand": f"{HAND}&delay_s={0.25 * number}", "side": ("left", "right")[number % 2]}
        for number in range(people)
    ]
    return {
        "seed": seed, "seconds": seconds, "coupling": {"stiffness_npm": 2000.0, **AUTO, **coupling}, "object": {"kind": kind},
        "link": {"profile": network} if network in PROFILES else {}, "users": users,
    }  # fmt: skip


def lines_of(laboratory: Laboratory) -> list[WaveCoupling]:
    return [core for person in laboratory.people if isinstance(core := person.core.coupling, WaveCoupling)]


CASES = [
    (network, kind, people, seed)
    for seed in range(1, 5)
    for kind, people in (("cube", 2), ("faces", 3), ("wall", 1), ("cube", 5))
    for network in ("satellite", "wifi", "wan", "lan", "lte")
]


@pytest.mark.sample(1)
@pytest.mark.parametrize(("network", "kind", "people", "seed"), every(40, CASES))
def test_no_line_makes_energy_while_impedance_and_filter_jump(network: str, kind: str, people: int, seed: int) -> None:
    """By a factor of 2 each second, up and down, which no tuner does; the filter comes and goes with it."""
    laboratory = Laboratory(resolve(pulling(network, seed, people, kind)))

    def jump(laboratory: Laboratory) -> None:
        second, rest = divmod(round(laboratory.seconds * 128), 128)
        if rest == 0:
            for number, line in enumerate(lines_of(laboratory)):
                high = (second + number) % 2
                line.tune(Tuning(20.0 if high else 10.0, 0.1 if high else 0.3))

    laboratory.run(each_frame=jump)
    summary = of_laboratory(laboratory)
    assert not laboratory.incident
    assert summary["passive"]
    assert least_margin(summary) >= NOTHING_J
    assert laboratory.room.world.balance_error_j < 1e-9
    for user in summary["users"]:
        assert user["line"]["most_impedance_nspm"] / user["line"]["least_impedance_nspm"] >= 2.0


def switched(tmp_path: Path, before_ms: float, after_ms: float, seconds: float = 16.0) -> dict[str, Any]:
    """Return settings of a link whose delay jumps after 2 s; they say nothing of it."""
    trace = tmp_path / "delays.csv"
    trace.write_text(f"t_s,delay_ms\n0,{before_ms}\n2,{after_ms}\n60,{after_ms}\n")
    return {**pulling("none", seconds=seconds), "link": {"trace": str(trace)}}


@pytest.mark.long
def test_a_line_that_changes_while_in_use_plays_again_bit_by_bit(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    summary = run_laboratory(resolve(switched(tmp_path, 2.0, 250.0, 5.0)), tmp_path / "run").summary
    for user in summary["users"]:
        assert user["line"]["least_impedance_nspm"] < 0.9 * user["line"]["most_impedance_nspm"]
    for name in ("client-u0.mcap", "client-u1.mcap", "server.mcap"):
        found = verify(open_recording(tmp_path / "run" / name))
        assert found.exact, found


@pytest.mark.long
@pytest.mark.parametrize(("before_ms", "after_ms"), [(2.0, 250.0), long(250.0, 2.0)])
def test_a_line_follows_a_delay_that_nobody_announced(tmp_path: Path, before_ms: float, after_ms: float) -> None:
    """Both ends end with what suits the delay; b changes by 1.3 % at most, and R frames or more lie between two changes."""
    laboratory = Laboratory(resolve(switched(tmp_path, before_ms, after_ms)))
    seen: list[list[float]] = []
    since: set[int] = set()

    def look(laboratory: Laboratory) -> None:
        seen.append([line.b for line in lines_of(laboratory)])
        since.add(lines_of(laboratory)[0]._since)

    laboratory.run(each_frame=look)
    steps = np.abs(np.diff(np.log(np.array(seen)), axis=0)).max(axis=1)
    assert 0.012 < steps.max() < 0.0126
    assert len(since) > 50
    assert min(later - number for number, later in pairwise(sorted(since - {0}))) == 8
    summary = of_laboratory(laboratory)
    assert summary["passive"]
    suits = tuning(2e-3 * after_ms + 1 / 128, "balanced")
    for number, user in enumerate(summary["users"]):
        assert user["line"]["impedance_nspm"] == pytest.approx(suits.impedance_nspm, rel=0.12)
        assert laboratory.room.world.impedance[number, 0] == user["line"]["impedance_nspm"]
        assert user["line"]["least_impedance_nspm"] < 0.5 * user["line"]["most_impedance_nspm"]
        assert bool(user["line"]["wave_filter_hz"]) == bool(suits.filter_lag_s)


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, long(2), long(3)])
def test_hands_that_pull_over_a_satellite_are_calm_two_seconds_after_they_rest(seed: int) -> None:
    """The numbers that the tuning is for: the swing is 4 N with b = 20 and no filter."""
    base = to_builtins(resolve(pulling("none", seconds=10.0)))
    trace = run_session(session_settings(base, "tuned", "satellite", seed), 7.0).trace
    ticks = round(9.0 * 1024)
    assert swing_n(trace.force_n[ticks:]) < 0.3
    assert np.abs(trace.position_m[-64:].mean(axis=0)).max() < 3e-3
    base["coupling"] |= {"impedance_nspm": 20.0, "wave_filter_hz": 0.0}
    plain = run_session(session_settings(base, "wave", "satellite", seed), 7.0).trace
    assert swing_n(plain.force_n[ticks:]) > 3.0


@pytest.mark.parametrize(
    "coupling",
    [long({}), {"wave_filter_hz": 1.0, "impedance_nspm": 8.0}, long({"prefer": "light"}), long({"prefer": "stiff"})],
)
def test_what_is_felt_is_predicted_with_the_filter(coupling: dict[str, Any]) -> None:
    hand = "reach&amplitude_m=0.02&stroke_s=1&delay_s=0.5&stop_s=1.5"
    table = {
        "seconds": 12.0, "object": {"kind": "wall"}, "coupling": {**AUTO, **coupling}, "link": {"delay_ms": 180.0},
        "users": [{"name": "anna", "hand": hand}],
    }  # fmt: skip
    laboratory = Laboratory(resolve(table))
    laboratory.run()
    (user,) = of_laboratory(laboratory)["users"]
    assert user["line"]["wave_filter_hz"] > 0.0
    assert user["felt_stiffness_npm"] == pytest.approx(user["predicted_stiffness_npm"], rel=0.02)
    (line,) = lines_of(laboratory)
    unfiltered = replace(line.seat_now(), line=LineTuning()).predicted_stiffness(line.loop_frames() or 0.0)
    assert unfiltered is not None
    assert user["felt_stiffness_npm"] < 0.8 * unfiltered


def test_numbers_stay_as_they_are(tmp_path: Path) -> None:
    """Without "auto" nothing follows, whatever the delay does."""
    table = switched(tmp_path, 2.0, 250.0, 5.0)
    table["coupling"] = {"stiffness_npm": 2000.0, "impedance_nspm": 15.0}
    for user in summary_of(**table)["users"]:
        assert set(user["line"].values()) == {15.0, 0.0}
