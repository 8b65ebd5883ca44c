"""Options with which people write scenes: a body at rest stays at rest, and no contact makes energy."""

from pathlib import Path
from typing import Any

import pytest

from cogrip.protocol.settings import resolve
from cogrip.sim.analysis.scene_advice import scene_findings
from cogrip.sim.runs.laboratory_run import run_laboratory

SCENE = """
<mujoco>
  <option {options}/>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body name="box" pos="0 0 .03"><freejoint/><geom type="box" size=".03 .03 .03" mass=".2"/></body>
  </worldbody>
</mujoco>
"""
MJX = 'iterations="1" ls_iterations="4" solver="CG"'
OPTIONS = {
    "integrator='Euler'": "integrator (euler > discrete)",
    "integrator='implicit'": "integrator (implicit > discrete)",
    "integrator='implicitfast'": "integrator (implicitfast > discrete)",
    "integrator='RK4'": "integrator (rk4 > discrete)",
    MJX: "solver (cg > newton), iterations (1 > 100), ls_iterations (4 > 50)",
    "tolerance='0.1' noslip_iterations='3'": "tolerance (0.1 > 1e-08), noslip_iterations (3 > 0)",
    "cone='pyramidal' impratio='1' integrator='Euler'": "integrator (euler > discrete)",
    "iterations='200'": "",
}


@pytest.mark.parametrize(("options", "changed"), OPTIONS.items(), ids=list(OPTIONS))
def test_a_box_at_rest_stays_there_whatever_its_scene_asks_of_the_solver(
    tmp_path: Path, options: str, changed: str
) -> None:
    file = tmp_path / "box.xml"
    file.write_text(SCENE.format(options=options))
    hand: dict[str, Any] = {"name": "anna", "device": "sim:ideal", "hand": "reach&amplitude_m=0.05"}
    other = {"name": "ben", "device": "sim:ideal", "hand": "hold", "side": "right"}
    settings = resolve(
        {
            "seconds": 2.0,
            "object": {"kind": "scene", "file": str(file), "axes": 3},
            "link": {"delay_ms": 5.0},
            "users": [hand, other],
        }
    )
    summary = run_laboratory(settings).summary
    assert not summary["unstable"]
    assert summary["passive"]
    assert summary["server"]["energy_limiter"]["limited_frames"] == 0
    assert all(user["peak_force_n"] < 20.0 for user in summary["users"])
    told = [finding.text for finding in scene_findings(settings) if "does not hold" in finding.text]
    assert told == (
        [f"the scene sets {changed}, which does not hold: contact would create energy with it"] if changed else []
    )
