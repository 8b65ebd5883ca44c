"""Scales, rotation and clutch in whole sessions in virtual time."""

from itertools import pairwise
from math import dist, hypot
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cogrip.client.safety.force_limits import SOFT_SLOPE_NPS
from cogrip.protocol.settings.room import resolve
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.sim.laboratory import Laboratory

from tests.extent import long
from tests.sim.session_measures import MARGINS, account_of, assert_plays_again, by_tick

K, B_LINE = 500.0, 10.0
CREDIT_J = 1e-3


def at_wall(**user: Any) -> dict[str, Any]:
    return {
        "seconds": 4.0, "object": {"kind": "wall", "axes": 3}, "admission": {"power_w": 0.0},
        "coupling": {"stiffness_npm": K, "impedance_nspm": B_LINE},
        "users": [{"name": "anna", "hand": "push&force_n=2", **user}],
    }  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize(
    ("scale", "force"), [(1.0, 1.0), long(2.0, 1.0), long(0.5, 0.5), long(3.0, 1.8), (0.5, 0.25), (10.0, 1.0)]
)
def test_a_hand_feels_the_wall_by_the_force_scale(scale: float, force: float) -> None:
    """K_hand = s K: force by s / g, way by 1 / g."""
    account = account_of(Laboratory(resolve(at_wall(position_scale=scale, force_scale=force))))
    plain = account_of(Laboratory(resolve(at_wall())))
    assert account.felt_stiffness_npm == pytest.approx(account.predicted_stiffness_npm, rel=0.01)
    assert account.predicted_stiffness_npm == pytest.approx(force * plain.predicted_stiffness_npm)
    assert account.down_margin_j >= -CREDIT_J
    assert account.device.margin_j >= 0.0


@pytest.mark.parametrize("times", [6, long(20)])
def test_clutches_of_50_mm_displace_nothing(times: int) -> None:
    """The hand goes back and forth freely, held by the clutch on its way forth: the tool goes back by each way back."""
    stroke_s = 0.4
    presses = ",".join(f"1@{stroke_s * (2 * n + 1.5):.4f}+{stroke_s:.4f}" for n in range(times))
    settings = resolve({
        "seconds": 2 * times * stroke_s + 1.0, "object": {"kind": "wall", "axes": 3}, "coupling": {"impedance_nspm": 5.0},
        "users": [{
            "name": "anna", "device": f"sim:phantom?press={presses}", "clutch_button": 1,
            "hand": "sine&amplitude_m=0.025&frequency_hz=1.25&offset_m=-0.05",
        }],
    })  # fmt: skip
    laboratory = Laboratory(settings)
    core, world = laboratory.people[0].core, laboratory.room.world
    rows = by_tick(
        laboratory,
        lambda _: (core._seat.hand.position_m, core._seat.frame.held, world.hand[0][0] - core._seat.tool_m()[0]),
    )
    places, held, offsets = map(np.array, zip(*rows, strict=True))
    seat = core._seat
    assert not laboratory.incident
    assert np.count_nonzero(held[1:] & ~held[:-1]) == times
    moved = np.diff(places, axis=0)[~held[:-1]].sum(axis=0)
    assert dist(seat.tool_m(), seat._origin_pose + moved) < 1e-9
    at_rest = np.convolve(held, np.ones(301))[: len(held)] > 300.5  # the proxy of the server has come to rest
    assert np.ptp(offsets[at_rest]) < 1e-5, "0.01 mm; 0.12 mm since the hand began to move"
    assert not seat.safety.counts["fault"]
    account = account_of(laboratory)
    assert account.down_margin_j >= 0.0
    assert account.device.margin_j >= 0.0


@pytest.mark.long
def test_a_clutch_in_contact_lets_the_hand_go_without_a_step_of_force() -> None:
    """The force ramps out and in as safety has it: no step is above the slope that gaps are softened to."""
    press = "1@1.0+0.5,1@2.0+0.5,1@3.0+0.2"
    settings = resolve(at_wall(device=f"sim:phantom?press={press}", clutch_button=1, hand="approach&amplitude_m=0.006"))
    laboratory = Laboratory(settings)
    core = laboratory.people[0].core
    states, forces = zip(*by_tick(laboratory, lambda _: (core.safety.state, core.force_n)), strict=True)
    assert max(dist(after, before) for before, after in pairwise(forces)) < SOFT_SLOPE_NPS / 1024
    assert max(hypot(*forces[int(1024 * s)]) for s in (1.2, 1.49, 2.3, 3.15)) == 0.0, "while it is held"
    assert hypot(*forces[-1]) > 0.05, "the wall is felt again"
    assert not laboratory.incident
    assert "clutched" in states
    assert "fault" not in states
    account = account_of(laboratory)
    assert account.down_margin_j >= -CREDIT_J
    assert account.device.margin_j >= 0.0


@pytest.mark.long
@pytest.mark.parametrize("profile", ["lan", *map(long, ("wifi", "wan", "lte", "satellite"))])
@pytest.mark.parametrize("kind", [long("cube"), "wall"])
def test_two_people_of_different_scales_are_passive_and_replay_exactly(tmp_path: Path, profile: str, kind: str) -> None:
    """Lines keep their credit, devices their reserve, and every end plays again bit for bit."""
    press = "2@1.0+0.4,2@2.1+0.3"
    settings = resolve({
        "seconds": 3.5, "object": {"kind": kind, "axes": 3}, "link": {"profile": profile},
        "coupling": {"impedance_nspm": 8.0, "stiffness_npm": 300.0},
        "users": [
            {"name": "anna", "position_scale": 3.0, "force_scale": 1.4, "rotation": [0.0, 0.0, 0.5],
             "hand": "reach&amplitude_m=0.01"},
            {"name": "ben", "side": "right", "position_scale": 0.4, "force_scale": 0.5, "rotation": "y -x z",
             "clutch_button": 2,
             "device": f"sim:phantom?press={press}", "hand": "sine&amplitude_m=0.02&frequency_hz=0.7"},
        ],
    })  # fmt: skip
    outcome = run_laboratory(settings, tmp_path)
    assert_plays_again(tmp_path)
    for user in outcome.summary["users"]:
        energy = user["energy"]
        assert min(energy[name] for name in MARGINS) >= -CREDIT_J, energy
        assert energy["device_margin_j"] >= 0.0
        assert user["state"] == "live", user["reason"]
