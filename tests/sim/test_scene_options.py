"""Options with which people write scenes: a body at rest stays at rest, and no contact makes energy."""

from pathlib import Path
from typing import Any

import pytest

from cogrip.analysis.advice.scene_advice import scene_findings
from cogrip.protocol.settings.room import resolve
from cogrip.results.verdict.verdict import felt
from cogrip.results.writing.laboratory_run import run_laboratory

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


@pytest.mark.sample(4)
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
        [f"the scene sets {changed}, which does not hold: contact that creates no energy is stepped otherwise"]
        if changed
        else []
    )


def summary_of(file: Path, *hands: str, **sections: Any) -> dict[str, Any]:
    users = [
        {"name": name, "device": "sim:ideal", "hand": hand, "side": side}
        for name, hand, side in zip(("anna", "ben"), hands, ("left", "right"), strict=True)
    ]
    scene = {"kind": "scene", "file": str(file), "axes": 3}
    return run_laboratory(resolve({"seconds": 2.0, "object": scene, "users": users, **sections})).summary


def test_a_run_in_which_no_tool_met_anything_says_so(tmp_path: Path) -> None:
    file = tmp_path / "box.xml"
    file.write_text(SCENE.format(options=""))
    back, forth = "reach&amplitude_m=-0.05", "reach&amplitude_m=0.05"
    assert "Nothing was touched by the tool of anna, ben" in felt(summary_of(file, back, forth)).sentence
    one = summary_of(file, forth, forth)
    assert "Nothing was touched" not in felt(one).sentence, "anna's did, and there is no task"
    tasked = summary_of(file, forth, forth, task={"body": "box", "lifted_m": 0.02})
    assert "Nothing was touched by the tool of ben" in felt(tasked).sentence
    assert felt(tasked).tone == "warn"


def test_a_tool_that_is_welded_to_what_it_holds_needs_no_contact(tmp_path: Path) -> None:
    file = tmp_path / "welded.xml"
    pad = '<body name="pad" pos="-.1 0 .03"><freejoint/><geom size=".01" mass=".05"/></body></worldbody>'
    file.write_text(
        SCENE.format(options="").replace("</worldbody>", f'{pad}<equality><weld body1="box" body2="pad"/></equality>')
    )
    settings = {"seconds": 1.0, "users": [{"name": "anna", "device": "sim:ideal", "hand": "reach", "tool": "pad"}]}
    scene = {"kind": "scene", "file": str(file), "axes": 3}
    summary = run_laboratory(resolve({**settings, "object": scene})).summary
    assert summary["server"]["scene"]["tools"][0]["tied"] is True
    assert "Nothing was touched" not in felt(summary).sentence
