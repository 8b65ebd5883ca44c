"""Haptic effects beside a workspace limit, a carried handle and scales that change: each force is its own, all are passive."""

import tomllib
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from cogrip.cli.session.shipped_settings import shipped
from cogrip.devices.device import GRAVITY_MPS2
from cogrip.protocol.hand_settings import parsed
from cogrip.protocol.settings import resolve
from cogrip.server.inputs import SetHand
from cogrip.sim.runs.laboratory_run import run_laboratory
from cogrip.sim.runs.records import open_run
from cogrip.sim.runs.replay.verify import verify
from cogrip.sim.runs.summary import of_laboratory
from cogrip.sim.session.laboratory import Laboratory

from tests.extent import long
from tests.sim.test_effect_sessions import ZONE

HANDLE_KG = 0.1  # whose weight the device can carry for long
CARRIED = {
    "device": f"sim:phantom?handle_mass_kg={HANDLE_KG}", "gravity_compensation": True,
    "workspace_limit_m": "box -0.2 0.2 -0.2 0.2 -0.2 0.2",
}  # fmt: skip


def test_zone_is_as_stiff_beside_a_handle_that_is_carried() -> None:
    hand = "waypoints&times_s=0,0.8,1.2,1.8&x_m=0,-0.06,-0.06,-0.02"
    users = [{"name": "anna", "hand": hand, **CARRIED}]
    table = {"seconds": 3.2, "object": {"kind": "wall", "axes": 3}, "coupling": {"kind": "local"}, "effects": [ZONE]}
    laboratory = Laboratory(resolve({**table, "users": users}))
    rested: list[tuple[float, float, float]] = []

    def watch(now: Laboratory) -> None:
        core = now.people[0].core
        if now.tick > 3100:
            rested.append((core.position_m[0] + 0.03, core.force_n[0], core.force_n[2]))

    laboratory.run(watch)
    depth, force, weight = np.mean(rested, axis=0)
    assert depth > 1e-3
    assert force / depth == pytest.approx(600.0, rel=0.03)
    assert weight == pytest.approx(-HANDLE_KG * GRAVITY_MPS2, rel=1e-6)
    assert laboratory.people[0].core.port.account().margin_j >= 0.0  # type: ignore[operator]


@pytest.mark.long
@pytest.mark.parametrize("profile", ["wifi", long("lan"), long("satellite")])
def test_all_effects_with_scales_that_change_are_passive_and_play_again(profile: str, tmp_path: Path) -> None:
    table = tomllib.loads(shipped("effects").read_text(encoding="utf-8"))
    table["link"] = {"profile": profile}
    table["users"][0] = {**table["users"][0], "workspace_limit_m": "auto"}
    name, frames, ran = table["users"][0]["name"], count(), []

    def change(now: Laboratory) -> bool:
        second, part = divmod(next(frames), 128)
        if part == 64:
            now.server.handle(SetHand(name, parsed([f"position_scale={1.5 if second % 2 else 0.7}"])), now.now_ns)
        ran[:] = [now]
        return False

    run_laboratory(resolve(table), tmp_path, over=change)
    (user,) = of_laboratory(ran[0])["users"]
    assert user["energy"]["device_margin_j"] >= 0.0
    assert user["effects"]["least_tank_j"] >= 0.0
    assert user["effects"]["drawn_j"] > 0.0
    found = open_run(tmp_path)
    assert found.server is not None
    for end in (found.server, *found.clients.values()):
        assert verify(end.recording).exact
