"""Delay up to which two people hold a scene's object: what the hands do, what counts as held, and when nobody holds it."""

from pathlib import Path

import pytest

from cogrip.analysis.advice.scene_hold import LIFT_M, MOST_SLIP_M, SECONDS, Hold, HoldResult, hold
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings

from tests.extent import long

GRAVITY = 9.81  # m/s^2
FLOOR = '<geom name="floor" type="plane" size="1 1 .1"/>'
BOX = '<body name="box" pos="0 0 {half}"><freejoint/><geom type="box" size="{half} {half} {half}" mass="{kg}" {more}/></body>'


def settings_of(folder: Path, bodies: str, rest: str = "", **users: object) -> Settings:
    (folder / "scene.xml").write_text(f"<mujoco><worldbody>{FLOOR}{bodies}</worldbody>{rest}</mujoco>")
    people = [{"name": side, "side": side, **users} for side in ("left", "right")]
    return resolve({"object": {"kind": "scene", "file": str(folder / "scene.xml"), "axes": 3}, "users": people})


def box(kg: float = 0.2, half: float = 0.03, more: str = "") -> str:
    return BOX.format(kg=kg, half=half, more=more)


def test_a_box_is_lifted_as_far_as_asked_and_held_up_to_the_delay_at_which_it_slips(tmp_path: Path) -> None:
    found = hold(settings_of(tmp_path, box()), delays_ms=(0.0, 200.0, 300.0, 400.0))
    assert [each.held for each in found.tried] == [True, True, False], "it ends at the first that fails"
    assert found.up_to_ms == 200.0
    assert found.tried[0].lifted_m == pytest.approx(LIFT_M, abs=0.001), "what the weight stretches is made up for"
    assert found.tried[1].slip_m <= MOST_SLIP_M < found.tried[2].slip_m
    text = found.finding().text
    assert "box stays held by two hands that press with 3 N" in text
    assert (
        f"up to 200 ms of delay each way, slipping by at most {1e3 * MOST_SLIP_M:g} mm; at 300 ms it slips by " in text
    )
    assert f"3 sessions of {SECONDS:g} s" in text


@pytest.mark.parametrize(("kg", "friction"), [(0.5, 1.0), long(0.2, 0.3)])
def test_hands_press_with_three_times_what_friction_needs(tmp_path: Path, kg: float, friction: float) -> None:
    slippery = f'friction="{friction} .005 .0001" priority="1"'
    found = hold(settings_of(tmp_path, box(kg, more=slippery)), delays_ms=(0.0,))
    assert found.press_n == pytest.approx(3.0 * kg * GRAVITY / (2.0 * friction))
    assert found.tried[0].held


def test_a_box_that_is_tied_down_is_not_held_at_any_delay(tmp_path: Path) -> None:
    found = hold(settings_of(tmp_path, box(), '<equality><weld body1="box"/></equality>'))
    assert (found.up_to_ms, len(found.tried)) == (None, 1)
    assert found.finding().level == "note"
    assert "is not held by two hands" in found.finding().text
    assert "without any delay: box was lifted by 0." in found.finding().text


DOOR = '<body name="door" pos="0 0 .1"><joint type="hinge"/><geom type="box" size=".05 .005 .05" mass=".2"/></body>'
NOBODY = {
    "has no free body": (DOOR, {}),
    "box weighs 49 N, and with 3 times what friction needs hands would press with 74 N, more than 20": (box(5.0), {}),
    "has no two sides along x at which both tools touch it and nothing else": (box(0.1, half=0.004), {}),
    "box has no friction": (box(more='friction="0 0 0" priority="1"'), {}),
    "one on the left and one on the right": (box(), {"side": "left"}),
}


@pytest.mark.parametrize("words", NOBODY)
def test_it_says_why_nobody_holds_anything(tmp_path: Path, words: str) -> None:
    bodies, users = NOBODY[words]
    found = hold(settings_of(tmp_path, bodies, **users))
    assert (found.tried, found.up_to_ms) == ((), None)
    assert words in found.finding().text


def test_a_session_that_takes_too_long_is_no_result(tmp_path: Path) -> None:
    frames = iter(range(10_000))
    whole = round(SECONDS * 128)
    found = hold(settings_of(tmp_path, box()), lambda: next(frames) > 1.1 * whole, (0.0, 10.0))
    assert [each.delay_ms for each in found.tried] == [0.0]
    assert "up to 0 ms of delay each way" in found.finding().text
    assert "; from 10 ms on nothing was tried, as that takes too long (1 session of" in found.finding().text


def test_no_delay_is_told_that_was_not_tried() -> None:
    stays = HoldResult(0.0, 0.03, 0.0, "")
    assert Hold("box", 3.0, (stays,)).up_to_ms == 0.0
    assert Hold("box", 3.0, (), "too slow").finding().text.endswith("hold something: too slow")
