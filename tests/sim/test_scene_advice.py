"""Words about scenes of rigid bodies: before a run by `advise`, after it in summary, verdict and report."""

from pathlib import Path

import pytest

from cogrip.cli.session.before_run import advice_on
from cogrip.cli.session.settings_file import load
from cogrip.protocol.line.concealment import held_force
from cogrip.protocol.settings import Settings
from cogrip.sim.analysis.scene_advice import scene_findings
from cogrip.sim.runs.report.tables import room_table
from cogrip.sim.runs.summary import of_laboratory
from cogrip.sim.runs.verdict import judgements
from cogrip.sim.runs.verdict_text import notes
from cogrip.sim.session.laboratory import Laboratory

LIFT = Path("lift")
OWN = """<mujoco><worldbody><geom type="plane" size="1 1 .1"/><body name="box" pos="0 0 .03"><freejoint/>
<geom type="box" size=".03 .03 .03" mass=".2" solref=".02 1.01"/></body></worldbody></mujoco>"""


def texts(settings: Settings, topic: str) -> list[str]:
    return [finding.text for finding in scene_findings(settings) if finding.topic == topic]


def test_advice_says_what_a_hand_will_feel_and_which_contact_is_set() -> None:
    """Theory 8.4 by hand: 50 g and 20 N s/m, a loop of 2 d + 1 frames of 1/128 s with d = 3 + 1, steps of a quarter."""
    settings = load(LIFT)
    (contact,) = texts(settings, "contact")
    assert contact.startswith("contact that creates no energy is set: ")
    assert "geom solref" in contact
    felt = texts(settings, "felt")
    assert [text.partition(":")[0] for text in felt] == ["anna", "ben"]
    frame_s, loop_frames = 1.0 / 128.0, 9.0
    mass_kg = 0.05 + 0.5 * 20.0 * loop_frames * frame_s
    assert f"the free tool as {mass_kg:.3g} kg" in felt[0]
    contact_mpn = 1.0 / (4e5 * (0.05 + 20.0 * frame_s / 4.0))
    line_mpn = (loop_frames * frame_s) / (2.0 * 20.0)
    said = float(felt[0].partition("felt with ")[2].partition(" N/m")[0])
    assert said == pytest.approx(1.0 / (contact_mpn + line_mpn), rel=0.02)  # the client's end adds parts of a frame


@pytest.mark.long
def test_advice_says_what_a_gripper_will_feel_and_the_fingers_feel_it() -> None:
    """Theory 8.8 by hand: b_g = 10 N s/m, a loop of 9 frames. A held block of 12 mm is in series, 1 % softer."""
    settings = load(Path("pinch"))
    _, grip = texts(settings, "felt")
    loop_s = 9.0 / 128.0
    said = float(grip.partition("a spring of ")[2].partition(" N/m")[0])
    assert said == pytest.approx(2.0 * 10.0 / loop_s, rel=1e-3)
    assert f"the free finger is felt as {0.025 + 0.5 * 10.0 * loop_s:.3g} kg" in grip
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
        "Felt as intended; no stiffness is asked for here, so none is judged; the force shook by 0.02 N rms above 12 Hz at most."
    )
    assert not any(about == "energy limiter" for _, _, about in notes(summary))
    assert "taken by the energy limiter" in str(room_table(summary))
    limiter |= {"limited_frames": 4, "paid_j": 2e-3}
    assert judgements(summary)[2].sentence.startswith(
        "Not felt as intended: the scene's energy limiter acted in 1.2 % of"
    )
    (told,) = [text for _, text, about in notes(summary) if about == "energy limiter"]
    assert "took 2 mJ from the returning waves in 4 frames" in told
