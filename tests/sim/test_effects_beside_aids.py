"""Haptic effects beside a workspace limit, a carried handle and scales that change: each force is its own, all are passive."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from cogrip.cli.settings.shipped_settings import shipped
from cogrip.devices.device import GRAVITY_MPS2
from cogrip.protocol.settings.hand import parsed
from cogrip.protocol.settings.room import resolve
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.server.inputs import SetHand
from cogrip.sim.laboratory import Laboratory

from tests.extent import long
from tests.sim.session_measures import account_of, assert_plays_again, by_tick
from tests.sim.test_effect_sessions import INTO_ZONE, ZONE, session

HANDLE_KG = 0.1  # whose weight the device can carry for long
CARRIED = {
    "device": f"sim:phantom?handle_mass_kg={HANDLE_KG}", "gravity_compensation": True,
    "workspace_limit_m": "box -0.2 0.2 -0.2 0.2 -0.2 0.2",
}  # fmt: skip


def test_zone_is_as_stiff_beside_a_handle_that_is_carried() -> None:
    thing, users = {"kind": "wall", "axes": 3}, [{"name": "anna", "hand": INTO_ZONE, **CARRIED}]
    laboratory = session(3.2, ZONE, object=thing, users=users)
    core = laboratory.people[0].core
    rows = by_tick(laboratory, lambda _: (core.position_m[0] + 0.03, core.force_n[0], core.force_n[2]))
    depth, force, weight = np.mean(rows[3101:], axis=0)
    assert depth > 1e-3
    assert force / depth == pytest.approx(600.0, rel=0.03)
    assert weight == pytest.approx(-HANDLE_KG * GRAVITY_MPS2, rel=1e-6)
    assert account_of(laboratory).device.margin_j >= 0.0


@pytest.mark.long
@pytest.mark.parametrize("profile", ["wifi", long("lan"), long("satellite")])
def test_all_effects_with_scales_that_change_are_passive_and_play_again(profile: str, tmp_path: Path) -> None:
    table = tomllib.loads(shipped("effects").read_text(encoding="utf-8"))
    table["link"] = {"profile": profile}
    table["users"][0] = {**table["users"][0], "workspace_limit_m": "auto"}
    name = table["users"][0]["name"]

    def change(now: Laboratory) -> bool:
        second, part = divmod(now.room.steps, 128)
        if part == 64:
            now.server.handle(SetHand(name, parsed([f"position_scale={1.5 if second % 2 else 0.7}"])), now.now_ns)
        return False

    (user,) = run_laboratory(resolve(table), tmp_path, over=change).summary["users"]
    assert user["energy"]["device_margin_j"] >= 0.0
    assert user["effects"]["least_tank_j"] >= 0.0
    assert user["effects"]["drawn_j"] > 0.0
    assert_plays_again(tmp_path)
