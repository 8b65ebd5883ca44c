"""Words about scenes of rigid bodies: before a run by `advise`, after it in summary, verdict and report."""

from itertools import product
from math import pi
from pathlib import Path
from typing import Any

import msgspec
import pytest

from cogrip.analysis.advice.finding import plain
from cogrip.analysis.advice.laboratory_check import check
from cogrip.analysis.advice.line_advice import LIGHT_GRIP_N, loop_s, own_world_findings, press_n, stroke_s
from cogrip.analysis.advice.scene_advice import scene_findings
from cogrip.cli.settings.before_run import advice_on
from cogrip.cli.settings.settings_file import load
from cogrip.protocol.line.concealment import held_force
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.sections import Settings
from cogrip.results.report.tables import room_table
from cogrip.results.verdict.verdict import judgements
from cogrip.results.verdict.verdict_text import notes
from cogrip.results.writing.summary import of_laboratory
from cogrip.sim.laboratory import Laboratory

from tests.extent import every

LIFT = Path("lift")
OWN = """<mujoco><worldbody><geom type="plane" size="1 1 .1"/><body name="box" pos="0 0 .03"><freejoint/>
<geom type="box" size=".03 .03 .03" mass=".2" solref=".02 1.01"/></body></worldbody></mujoco>"""


def texts(settings: Settings, topic: str) -> list[str]:
    return [finding.text for finding in scene_findings(settings) if finding.topic == topic]


def test_advice_says_what_a_hand_will_feel_and_which_contact_is_set() -> None:
    """Theory 8.4 by hand: 50 g and 20 N s/m, a loop of twice 21 ticks and a frame of 1/128 s, steps of a quarter."""
    settings = load(LIFT)
    (contact,) = texts(settings, "contact")
    assert contact.startswith("contact that creates no energy is set: ")
    assert "geom solref" in contact
    felt = texts(settings, "felt")
    assert [text.partition(":")[0] for text in felt] == ["anna", "ben"]
    frame_s, loop_frames = 1.0 / 128.0, 6.25
    mass_kg = 0.05 + 0.5 * 20.0 * loop_frames * frame_s
    assert f"the free tool feels like {mass_kg:.3g} kg" in texts(settings, "free motion")[0]
    contact_mpn = 1.0 / (4e5 * (0.05 + 20.0 * frame_s / 4.0))
    line_mpn = (loop_frames * frame_s) / (2.0 * 20.0)
    said = float(felt[0].partition("felt with ")[2].partition(" N/m")[0])
    assert said == pytest.approx(1.0 / (contact_mpn + line_mpn), rel=0.02)  # the client's end adds parts of a frame


@pytest.mark.parametrize(
    ("delay_ms", "felt", "free"),
    [(20.0, "ok", "note"), (100.0, "note", "note"), (200.0, "warning", "warning"), (300.0, "warning", "warning")],
)
def test_a_scene_has_the_levels_that_other_objects_have(delay_ms: float, felt: str, free: str) -> None:
    """A line of loop T gives way by F T / 2b to the hands' 5 N, weighs b T / 2, and swings in pi T: their strokes take 1 s."""
    settings = load(LIFT, [f"link.delay_ms={delay_ms}", "coupling.impedance_nspm=20"])
    found = {finding.topic: finding for finding in scene_findings(settings) if finding.text.startswith("anna: ")}
    T = loop_s(seat_settings(settings, 0))
    assert (found["felt"].level, found["free motion"].level) == (felt, free)
    sunk_mm = float(found["felt"].text.partition("5 N go ")[2].partition(" mm")[0])
    assert sunk_mm == pytest.approx(1e3 * 5.0 * T / 40.0, rel=0.03)
    assert felt == ("ok" if sunk_mm <= 10.0 else "note" if sunk_mm <= 50.0 else "warning")
    assert f"like {plain(0.05 + 10.0 * T, 3)} kg" in found["free motion"].text
    assert (free == "warning") == (pi * T > 1.0) == ("too fast for it" in found["free motion"].text)
    assert ("lags behind" in found["free motion"].text) == (0.5 < pi * T <= 1.0)


@pytest.mark.parametrize(
    ("hand", "force_n", "seconds"),
    [
        ("grasp&press_n=7&stroke_s=1.5", 7.0, 1.5), ("reach&stroke_s=0.6", LIGHT_GRIP_N, 0.6), ("reach", LIGHT_GRIP_N, 0.8),
        ("crank&radius_m=0.06&speed_radps=2", LIGHT_GRIP_N, pi), ("sine&frequency_hz=0.5", LIGHT_GRIP_N, 1.0),
        ("push&force_n=-4", 4.0, None), ("hold", LIGHT_GRIP_N, None),
        ("waypoints&times_s=1,1.2,3,4&x_m=0,0,0.1,0.1&z_m=0.2,0.2,0.2,0", LIGHT_GRIP_N, 1.0),
    ],
)  # fmt: skip
def test_what_a_hand_demands_of_its_line(hand: str, force_n: float, seconds: float | None) -> None:
    [user] = resolve({"users": [{"name": "anna", "device": "sim:ideal", "hand": hand}]}).users
    assert press_n(user) == force_n
    assert stroke_s(user) == (None if seconds is None else pytest.approx(seconds))


def test_a_world_of_ones_own_hears_of_its_line_and_what_is_not_known() -> None:
    """40 ms each way, b = 20, m = 0.1 kg."""
    table = {
        "link": {"delay_ms": 40.0, "loss": 0.02},
        "users": [{"name": "anna", "hand": "reach&stroke_s=0.25"}],
    }
    table["object"] = {"kind": "python:own.py:Own"}
    settings = msgspec.convert(table, Settings)
    found = {finding.topic: finding for finding in own_world_findings(settings)}
    T = loop_s(seat_settings(settings, 0))
    assert f"a spring of {plain(40.0 / T)} N/m at rest" in found["felt"].text
    assert f"like {plain(0.1 + 10.0 * T, 3)} kg, 0.1 kg of it the device" in found["free motion"].text
    assert found["free motion"].level == "warning", "it swings in 0.3 s"
    assert "6.9 N are held in full" in found["gaps"].text
    assert "b = 20 of at most 25.6" in found["device"].text
    assert "no linear model" in found["conditions"].text


@pytest.mark.long
def test_a_session_of_a_scene_tells_whether_its_task_is_done() -> None:
    near, far = (check(load(LIFT, [f"link.delay_ms={delay_ms}"])) for delay_ms in (20.0, 300.0))
    assert (near.done, near.session.level) == (True, "ok")
    assert "task reached after 5.67 s" in near.session.text
    assert (far.done, far.session.level) == (False, "warning")
    assert "task not reached: box" in far.session.text


@pytest.mark.long
def test_advice_says_what_a_gripper_will_feel_and_the_fingers_feel_it() -> None:
    """Theory 8.8 by hand: b_g = 10 N s/m, a loop of 6.25 frames. A held block of 12 mm is in series, 1 % softer."""
    settings = load(Path("pinch"))
    _, grip = texts(settings, "felt")
    loop_s = 6.25 / 128.0
    said = float(grip.partition("a spring of ")[2].partition(" N/m")[0])
    assert said == pytest.approx(2.0 * 10.0 / loop_s, rel=1e-3)
    assert f"the free finger feels like {0.025 + 0.5 * 10.0 * loop_s:.3g} kg" in texts(settings, "free motion")[1]
    laboratory = Laboratory(load(Path("pinch"), ["seconds=4.0"]))
    laboratory.run()
    device = laboratory.people[0].device
    felt_npm = device.force_n[3] / (device.position_m[3] - 0.012)  # type: ignore[attr-defined]
    assert 0.97 * said < felt_npm < said
    assert not texts(settings, "gaps")


def test_advice_says_which_force_between_the_fingers_lasts_through_gaps() -> None:
    """Theory 3.5 with b_g and the gripper's continuous force: what is said to be enough is."""
    (said,) = texts(load(Path("pinch"), ["link.loss=0.01", "playout.tank_mj=1"]), "gaps")
    assert said.startswith("anna: between the fingers 0.27 N are held in full")
    enough_mj = float(said.rsplit("tank_mj = ", 1)[1])
    assert held_force(10.0, enough_mj * 1e-3, 1.0 / 128.0, 4) == pytest.approx(4.0, rel=0.03)
    (rich,) = texts(load(Path("pinch"), ["link.loss=0.01", f"playout.tank_mj={1.1 * enough_mj}"]), "gaps")
    assert rich.startswith("anna: between the fingers 4.2 N are held in full")
    assert not texts(load(LIFT, ["link.loss=0.01"]), "gaps")


def test_advice_warns_of_contact_that_a_scene_sets_itself(tmp_path: Path) -> None:
    (tmp_path / "own.xml").write_text(OWN)
    settings = load(LIFT, [f"object.file={tmp_path / 'own.xml'}"])
    warned = [finding for finding in scene_findings(settings) if finding.warns]
    assert len(warned) == 1
    assert warned[0].text.startswith("the scene sets geom solref itself")


@pytest.mark.parametrize("kind", ["coupling", "tdpa"])
def test_a_scheme_that_bounds_no_energy_of_a_scene_is_refused(kind: str) -> None:
    settings = load(LIFT, [f"coupling.kind={kind}"])
    (warned,) = [finding for finding in scene_findings(settings) if finding.warns]
    assert warned.refused
    assert warned.text.startswith(f'coupling.kind = "{kind}": nothing bounds the energy')
    assert advice_on(settings) == ((warned.text,), (warned.text,))
    assert not texts(settings, "felt"), "theory 8.4 is of waves"
    assert advice_on(load(LIFT)) == ((), ())


def test_a_lift_is_judged_without_a_stiffness_and_its_limiter_is_told() -> None:
    laboratory = Laboratory(load(LIFT, ["seconds=2.5"]))
    laboratory.run()
    summary = of_laboratory(laboratory)
    limiter = summary["server"]["energy_limiter"]
    assert limiter["limited_frames"] == 0
    assert limiter["level_j"] >= 0.0
    passive, stable, felt = judgements(summary)
    assert (passive.tone, stable.tone, felt.tone) == ("good", "good", "good")
    assert felt.sentence == (
        "Felt as intended; no stiffness is asked for here, so none is judged; "
        "the force shook by 0.01 N rms above 12 Hz at most."
    )
    assert not any(about == "energy limiter" for _, _, about in notes(summary))
    assert "taken by the energy limiter" in str(room_table(summary))
    limiter |= {"limited_frames": 4, "paid_j": 2e-3}
    assert judgements(summary)[2].sentence.startswith(
        "Not felt as intended: the scene's energy limiter acted in 1.2 % of"
    )
    (told,) = [text for _, text, about in notes(summary) if about == "energy limiter"]
    assert "took 2 mJ from the returning waves in 4 frames" in told


BLOCK = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 .1"/>
  <body name="block" pos="0 0 .015"><freejoint/><geom type="box" size=".006 .006 .015" mass="{mass_kg}"/></body>
</worldbody></mujoco>"""
CLOSING = "sim:gripper?squeeze_m=0.002&squeeze_s=2.2&grip_friction_n=0&friction_n=0&hold_s=9&resolution_m=0&grip_resolution_m=0"
BESIDE = "waypoints&times_s=0.5,1.2,2.0&y_m=0,-0.007,-0.007&x_m=0,0,0.047&z_m=0,0,0"


@pytest.mark.parametrize(("mass_kg", "delay_ms"), every(3, product((0.005, 0.05, 0.5), (5.0, 20.0))))
def test_what_an_added_gripper_holds_is_felt_as_stiff_as_foretold(
    mass_kg: float, delay_ms: float, tmp_path: Path
) -> None:
    """Force over how far the fingers are closed beyond the block's sides, at rest, in a session."""
    file = tmp_path / "block.xml"
    file.write_text(BLOCK.format(mass_kg=mass_kg))
    settings = resolve(
        {
            "seconds": 4.4, "object": {"kind": "scene", "file": str(file), "axes": 3}, "link": {"delay_ms": delay_ms},
            "coupling": {"grip_impedance_nspm": 10.0},
            "users": [{"name": "anna", "device": CLOSING, "hand": BESIDE, "tool": "pinch"}],
        }
    )  # fmt: skip
    (told,) = [each.text for each in scene_findings(settings) if "between them is felt" in each.text]
    foretold_npm = float(told.rpartition("felt with ")[2].removesuffix(" N/m"))
    laboratory = Laboratory(settings)
    laboratory.run()
    device: Any = laboratory.people[0].device
    felt_npm = -device.force_n[3] / (0.012 - device.position_m[3])
    assert felt_npm > 300.0
    assert felt_npm == pytest.approx(foretold_npm, rel=0.03)


def test_what_a_gripper_of_the_scenes_own_holds_is_not_foretold(tmp_path: Path) -> None:
    file = tmp_path / "block.xml"
    file.write_text(BLOCK.format(mass_kg=0.05).replace('mass="0.05"', 'mass="0.05" solref="-1e5 -500"'))
    settings = resolve(
        {
            "object": {"kind": "scene", "file": str(file), "axes": 3},
            "users": [{"name": "anna", "device": "sim:gripper", "tool": "pinch"}],
        }
    )
    texts = [each.text for each in scene_findings(settings)]
    assert any("the gripper's line is a spring" in text for text in texts)
    assert not any("between them is felt" in text for text in texts)
