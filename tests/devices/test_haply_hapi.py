"""`haply:` and its emulated board held against Haply's own host, HaplyHAPI, over a pseudo-terminal: places, torques, forces."""

import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import closing, suppress
from math import degrees, sin
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.devices.haply.frames import STEP_NM
from cogrip.devices.haply.models import MODELS

from tests.devices.haply_board import BOUND_S, Board
from tests.devices.haplyhapi_program import FORCES_N

pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="needs a pseudo-terminal"),
    pytest.mark.skipif(importlib.util.find_spec("HaplyHAPI") is None, reason="needs the package HaplyHAPI"),
]
every_model = pytest.mark.parametrize("name", sorted(MODELS))
ROOT = Path(__file__).parents[2]
EXCHANGES = 500  # each takes a millisecond of the board's time: the hand has come to rest long before
SMALL_RAD = 1e-6
shares = st.floats(-1.0, 1.0)
forces = st.floats(-0.8, 0.8)  # within what every model gives everywhere


@pytest.mark.sample(1)
@every_model
def test_the_maker_s_host_finds_the_tip_and_pushes_the_hand_with_the_force_it_asks_for(name: str) -> None:
    """In Haply's plane X goes to the left, Y toward the user: x = Y - Y0, y = X0 - X."""
    model = MODELS[name]
    x0, y0 = model.five_bar.origin_m
    with closing(Board(name, "hold&hand_stiffness_npm=1000&hand_damping_nspm=20")) as board:
        host = [sys.executable, "-m", "tests.devices.haplyhapi_program", board.path, name, str(EXCHANGES)]
        done = subprocess.run(host, cwd=ROOT, capture_output=True, timeout=BOUND_S, check=False)
    assert done.returncode == 0, done.stderr.decode()
    reported = json.loads(done.stdout)
    assert len(reported) == len(FORCES_N)
    for number, said in enumerate(reported, 1):
        x, y, fx, fy = board.acted[number * EXCHANGES]  # the first was that to no force at all
        hand_x, hand_y = said["force_n"]
        assert (fx, fy) == pytest.approx(
            (hand_y, -hand_x), abs=0.003
        )  # the board's steps of torque, and a place a tick old
        assert (said["position_m"][1] - y0, x0 - said["position_m"][0]) == pytest.approx(
            (x, y), abs=2.0 * model.record.resolution_m
        )


def at(mechanism: Any, angles: Sequence[float]) -> list[float]:
    """Return the tip (X, Y) [m] by HaplyHAPI at joint angles [rad]."""
    mechanism.forwardKinematics([degrees(angle) for angle in angles[:2]])
    place: list[float] = mechanism.get_coordinate()
    return place


@given(st.sampled_from(sorted(MODELS)), shares, shares, forces, forces)
def test_torques_do_the_work_of_the_force_along_the_maker_s_own_kinematics(
    name: str, share_x: float, share_y: float, force_x: float, force_y: float
) -> None:
    """F dx = tau dtheta, dx by HaplyHAPI's positions; before, the Pantograph's tau was a tenth of it.

    HaplyHAPI's torques are the same where the tip is beyond both elbows; elsewhere its arc cosine loses a sign.
    """
    from HaplyHAPI import Pantograph

    model = MODELS[name]
    bar = model.five_bar
    mechanism = Pantograph()
    mechanism.set_mechanism_parameters([bar.proximal_m, bar.distal_m, bar.base_m])
    (_, reach_x), (_, reach_y) = model.record.workspace_m
    place = (share_x * reach_x, share_y * reach_y, 0.0)
    angles = bar.inverse(place)
    assert angles is not None
    beyond = bar.origin_m[1] + place[0] > bar.proximal_m * max(sin(angles[0]), sin(angles[1])) + 1e-4
    commands, _ = model.currents(angles, (force_x, force_y, 0.0))
    torques = [STEP_NM * command for command in commands[:2]]
    push = (-force_y, force_x)  # in Haply's plane
    if beyond:
        assert at(mechanism, angles) == pytest.approx(
            [bar.origin_m[0] - place[1], bar.origin_m[1] + place[0]], abs=1e-9
        )
        mechanism.torqueCalculation(push)
        assert torques == pytest.approx(mechanism.get_torque(), abs=1.01 * STEP_NM)
    with suppress(ValueError):  # right below an elbow its arc cosine ends by rounding
        for joint, torque in enumerate(torques):
            ahead, behind = ([*angles[:2]] for _ in range(2))
            ahead[joint] += SMALL_RAD
            behind[joint] -= SMALL_RAD
            moved = zip(at(mechanism, ahead), at(mechanism, behind), push, strict=True)
            work = sum(force * (new - old) for new, old, force in moved) / (2.0 * SMALL_RAD)
            assert torque == pytest.approx(work, abs=1.1 * STEP_NM)
