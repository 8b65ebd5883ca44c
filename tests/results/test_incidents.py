"""Left, saturated and unstable are three things: by name in the laboratory, the summary, the verdict, its exit code."""

from pathlib import Path
from typing import Any

import pytest

from cogrip.protocol.settings.room import resolve
from cogrip.results.listing.listing import list_runs
from cogrip.results.verdict.verdict import stable, succeeded
from cogrip.results.verdict.verdict_text import verdict
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.results.writing.summary import of_laboratory
from cogrip.sim.laboratory import Laboratory

SOFT = {"stiffness_npm": 300.0, "impedance_nspm": 15.0}
SHOVED: dict[str, Any] = {
    "seconds": 4.0, "coupling": SOFT, "object": {"kind": "faces", "mass_kg": 1.0}, "link": {"delay_ms": 5.0},
    "users": [
        {"name": "a", "device": "sim:phantom", "hand": "reach&amplitude_m=0.03&stroke_s=0.4&stop_s=2", "side": "left"}
    ],
}  # fmt: skip
PULLED: dict[str, Any] = {
    "seconds": 5.0, "coupling": SOFT, "object": {"kind": "cube", "mass_kg": 0.5}, "link": {"delay_ms": 5.0},
    "users": [
        {"name": "a", "device": "sim:phantom", "hand": "hold&hand_stiffness_npm=1500"},
        {"name": "b", "device": "sim:ideal",
         "hand": "approach&amplitude_m=0.12&lag_s=0.4&delay_s=0.4&hand_stiffness_npm=1500"},
    ],
}  # fmt: skip
SEESAW = """<mujoco model="seesaw">
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body name="board" pos="0 0 .08">
      <joint name="pivot" type="hinge" axis="0 1 0" range="-25 25"/>
      <geom type="box" size=".12 .03 .004" mass=".3"/>
    </body>
    <body name="ball" pos="0.01 0 .1"><freejoint/><geom type="sphere" size=".015" mass=".05"/></body>
    {more}
  </worldbody>
</mujoco>
"""


def scene(folder: Path, more: str = "", **changed: object) -> dict[str, Any]:
    """Return a room in which a ball rolls off its board."""
    file = folder / "seesaw.xml"
    file.write_text(SEESAW.format(more=more))
    return {
        "seconds": 2.0, "object": {"kind": "scene", "file": str(file), "axes": 3}, "link": {"delay_ms": 20.0},
        "users": [{"name": "anna", "side": "left"}, {"name": "ben", "side": "right"}],
        "task": {"within_m": 0.02, "by_s": 8.0}, **changed,
    }  # fmt: skip


def run(table: dict[str, Any], **options: Any) -> tuple[Laboratory, dict[str, Any]]:
    laboratory = Laboratory(resolve(table), **options)
    laboratory.run()
    laboratory.close_ledger()
    return laboratory, of_laboratory(laboratory)


def names(summary: dict[str, Any]) -> list[str]:
    return [name for name in ("unstable", "saturated", "left") if summary[name]]


def test_an_object_that_is_shoved_and_glides_off_has_left_and_the_session_goes_on_to_its_end() -> None:
    laboratory, summary = run(SHOVED)
    assert names(summary) == ["left"]
    assert summary["seconds"] == 4.0
    (departure,) = summary["server"]["left"]
    assert departure["what"] == "the object"
    assert departure["at_s"] == pytest.approx(2.8, abs=0.2)
    assert departure["position_m"][0] == pytest.approx(0.5, abs=0.01)
    judged = stable(summary)
    assert (judged.tone, judged.brief) == ("warn", "left (the object)")
    assert judged.sentence == f"Stable, but the object left the workspace after {departure['at_s']:.2f} s."
    assert succeeded(summary)
    assert laboratory.incident.startswith("the object left the workspace at 2.8")


def test_everybody_is_told_what_left() -> None:
    laboratory = Laboratory(resolve(SHOVED))
    laboratory.run()
    assert [event.text for event in laboratory.server.events if "left the workspace" in event.text]


def test_a_force_that_stays_at_its_limit_has_saturated_and_ends_in_a_fault_for_that_person_alone() -> None:
    laboratory, summary = run(PULLED)
    assert names(summary) == ["saturated"]
    assert summary["seconds"] == 5.0
    a, b = summary["users"]
    assert (a["state"], a["saturated"], a["unstable"], a["let_go"]) == ("fault", True, False, 3)
    assert (b["state"], b["saturated"], b["unstable"]) == ("live", False, False)
    assert summary["object"]["position_m"][0] == pytest.approx(b["position_m"][0], abs=5e-3), (
        "b goes on with the object"
    )
    judged = stable(summary)
    assert (judged.tone, judged.brief) == ("warn", "saturated (a)")
    assert "the force on a sat at the device's limit, and was let go" in judged.sentence
    assert not succeeded(summary), "somebody ended in a fault"
    assert any(tone == "bad" and text.startswith("a ended in fault: ") for tone, text in verdict(summary))
    assert laboratory.incident.startswith("a: the force sits at its limit of 8.5 N")


def test_who_was_let_go_at_a_limit_and_came_back_is_a_warning() -> None:
    """One release, before it is a fault."""
    laboratory = Laboratory(resolve(PULLED))
    laboratory.run(stopped=lambda: bool(laboratory.saturated))
    laboratory.close_ledger()
    summary = of_laboratory(laboratory)
    assert names(summary) == ["saturated"]
    assert [user["state"] for user in summary["users"]] == ["degraded", "live"]
    assert stable(summary).tone == "warn"
    assert succeeded(summary)


def test_a_ball_that_rolls_off_has_left_by_its_name_and_a_task_that_held_at_first_is_not_reached(
    tmp_path: Path,
) -> None:
    _, summary = run(scene(tmp_path))
    assert names(summary) == ["left"]
    assert summary["seconds"] == 2.0
    assert [body["what"] for body in summary["server"]["left"]] == ["ball"]
    assert (
        stable(summary).sentence
        == f"Stable, but ball left the workspace after {summary['server']['left'][0]['at_s']:.2f} s."
    )
    assert succeeded(summary)
    assert not summary["task"]["reached"]
    assert summary["task"]["dwell_s"] == 0.5


def test_any_body_of_a_scene_may_leave_and_one_beyond_reach_is_put_back(tmp_path: Path) -> None:
    """A marble that rises at 2 g: the workspace ends 0.79 m about the scene's middle, reach 3.18 m, 2.9 m up in 0.54 s."""
    marble = (
        '<body name="marble" pos=".3 .3 .5" gravcomp="3"><freejoint/><geom type="sphere" size=".01" mass=".01"/></body>'
    )
    laboratory, summary = run(scene(tmp_path, marble, seconds=0.7, task={}))
    (departure,) = summary["server"]["left"]
    assert departure["position_m"][2] == pytest.approx(0.205 + 0.795 - 0.5, abs=0.05)
    assert [body["what"] for body in summary["server"]["left"]] == ["marble"]
    assert names(summary) == ["left"]
    assert summary["passive"]
    place = laboratory.room.world.data.body("marble").xpos
    assert place[2] < 1.0, "it rises anew"
    assert summary["server"]["energy_limiter"]["limited_frames"] == 0


def test_the_workspace_of_a_large_scene_is_its_extent_and_a_cart_on_a_rail_may_leave_it(tmp_path: Path) -> None:
    """Its extent is 2 m, about its middle: a cart that starts at 0.9 m leaves after 1.1 m, and not after 0.5 m."""
    cart = (
        '<body name="cart" pos=".9 .5 .5" gravcomp="1"><joint name="rail" type="slide" axis="1 0 0"/>'
        '<geom size=".05" mass="1"/></body>'
        '<geom type="box" size="1 .01 .01" pos="0 1 .5"/></worldbody>'
        '<statistic center="0 0 0" extent="2"/><worldbody>'
    )
    laboratory = Laboratory(resolve(scene(tmp_path, cart, seconds=1.0, task={})))
    laboratory.room.world.data.joint("rail").qvel[0] = 2.0
    laboratory.run()
    (departure,) = of_laboratory(laboratory)["server"]["left"]
    assert departure["what"] == "cart"
    assert departure["position_m"][0] == pytest.approx(1.1, abs=0.02)
    assert departure["at_s"] == pytest.approx(0.55, abs=0.02)


def test_numbers_that_grow_are_unstable_whatever_left_by_that() -> None:
    """The paper's step is unstable by itself there."""
    laboratory, summary = run({
        "seconds": 1.0, "coupling": {"server_step": "paper", "stiffness_npm": 1e5}, "playout": {"frames": 0},
        "link": {"delay_ms": 31.25}, "users": [{"name": "anna"}, {"name": "ben"}],
    })  # fmt: skip
    assert "unstable" in names(summary)
    assert summary["seconds"] == 1.0
    assert stable(summary).tone == "bad"
    assert stable(summary).sentence.startswith("Not stable: ")
    assert not succeeded(summary)
    assert laboratory.unstable


@pytest.mark.parametrize(("table", "word"), [(SHOVED, "left"), (PULLED, "saturated")])
def test_a_list_of_runs_has_the_same_names(table: dict[str, Any], word: str, tmp_path: Path) -> None:
    folder = tmp_path / "20260101-120000-run"
    folder.mkdir()
    run_laboratory(resolve(table), folder)
    (listed,) = list_runs(tmp_path, lambda _: False)
    assert word in listed.verdict
    assert listed.brief == word
