"""Contact forces and slip of a scene's tools, against what statics and the hand's own motion say."""

from math import sqrt

import numpy as np
import pytest

from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.server.worlds.scenes.scene_contacts import LIFTED_M, SLIP_EVERY, Touch

from tests.server.scene_worlds import SLIDES, B, T, hold, world_of


def block(geom: str, option: str = "", flags: str = "") -> str:
    """Return a scene of a block and a ball beside it. geom, option: further attributes."""
    return f"""<mujoco><option gravity="0 0 0" {option}>{flags}</option><worldbody>
    <geom type="box" size=".03 .2 .2" pos="0 0 0" {geom}/>
    <body name="tool" pos="-.0401 0 0">{SLIDES}<geom type="sphere" size=".01" mass=".05" {geom}/></body>
  </worldbody></mujoco>"""


SMOOTH, ROUGH = block("friction='0 0 0'"), block("friction='.5 0 0'")
PYRAMID = block("friction='.5 0 0'", "cone='pyramidal'")


def push(world: SceneWorld, force_n: tuple[float, float, float], seconds: float) -> None:
    """Drive the tool by a force beside the port's damper."""
    for _ in range(round(seconds / T)):
        world.step(np.array([force_n]) / sqrt(2.0 * B))


@pytest.mark.parametrize("xml", [SMOOTH, ROUGH, PYRAMID], ids=["smooth", "rough", "pyramid"])
def test_at_rest_the_normal_force_is_the_push_and_friction_what_holds(xml: str) -> None:
    world = hold(world_of(xml, ("tool",)))
    assert world.accounts.contact(0) == Touch(0.0, 0.0, 0.0)
    push(world, (3.0, 0.0, 0.0), 1.0)
    assert world.accounts.contact(0).normal_n == pytest.approx(3.0, abs=1e-6)
    if xml is SMOOTH:
        assert world.accounts.contact(0).friction_n == pytest.approx(0.0, abs=1e-9)
        return
    push(world, (3.0, 0.6, 0.8), 1.0)
    assert world.accounts.contact(0).friction_n == pytest.approx(1.0, abs=1e-3), "less than 0.5 times 3 N: it is held"
    assert world.accounts.contact(0).slip_m < (1e-4 if xml is ROUGH else 1e-2)


def test_slip_is_the_way_along_the_surface_and_begins_anew_with_each_contact() -> None:
    world = hold(world_of(SMOOTH, ("tool",)))
    push(world, (3.0, 0.0, 0.0), 0.5)
    start = world.proxy(0)
    push(world, (3.0, 0.6, 0.8), SLIP_EVERY * T * 16)
    slid = world.proxy(0) - start
    assert slid[1] > 5e-3
    speed_mps = 1.0 / B  # against the port's damper alone
    assert world.accounts.contact(0).slip_m == pytest.approx(
        np.hypot(slid[1], slid[2]), abs=(SLIP_EVERY + 1) * T * speed_mps
    )
    peak = world.accounts.contact(0).slip_m
    push(world, (-3.0, 0.0, 0.0), 0.5)
    assert world.accounts.contact(0) == Touch(0.0, 0.0, 0.0)
    push(world, (3.0, 0.0, 0.0), 1.5)
    assert world.accounts.contact(0).normal_n > 2.0
    assert world.accounts.contact(0).slip_m < 1e-4
    account = world.accounts.scene()
    assert account["slip_m"] == account["tools"][0]["slip_m"] >= peak
    assert account["lifted_m"] is account["lifted_s"] is account["turned_deg"] is None, "there is no object"


def test_past_the_friction_that_the_normal_force_allows_it_slips() -> None:
    world = hold(world_of(ROUGH, ("tool",)))
    push(world, (3.0, 0.0, 0.0), 0.5)
    push(world, (3.0, 2.0, 0.0), 0.5)
    normal_n, friction_n, slip_m = world.accounts.contact(0)
    assert friction_n == pytest.approx(0.5 * normal_n, rel=1e-3)
    assert slip_m > 5e-3


def test_lift_and_turn_are_those_of_the_object() -> None:
    world = hold(world_of("lift"))
    world.position = np.array([0.0, 0.0, 0.9 * LIFTED_M])
    frames = 0
    while world.position[2] > 1e-4:
        world.step(np.zeros((2, 3)))
        frames += 1
    assert frames > SLIP_EVERY
    assert 0.0 < world.accounts.scene()["lifted_m"] < LIFTED_M
    assert world.accounts.scene()["lifted_s"] == 0.0
    world.position = np.array([0.0, 0.0, 2.0 * LIFTED_M])
    for _ in range(SLIP_EVERY):
        world.step(np.zeros((2, 3)))
    assert world.accounts.scene()["lifted_s"] == SLIP_EVERY * T
    assert world.accounts.scene()["turned_deg"] == pytest.approx(0.0, abs=1e-3)
    turn = np.radians(30.0)
    world.data.qpos[3:7] = [np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)]
    world._refresh()
    for _ in range(SLIP_EVERY):
        world.step(np.zeros((2, 3)))
    assert world.accounts.scene()["turned_deg"] == pytest.approx(30.0, abs=0.1)
    assert world.orientation == pytest.approx([np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)], abs=1e-3)
    assert world.drawing.poses().shape == (3, 7)


def test_slip_while_lifted_counts_from_the_moment_of_the_lift() -> None:
    """The hands close about the box and rise, then one goes on down along it, past what friction holds."""
    world = hold(world_of("lift"))

    def draw(seconds: float, grip_n: float, height_m: tuple[float, float]) -> None:
        for _ in range(round(seconds / T)):
            forces = [
                [side * grip_n, 0.0, 80.0 * (height_m[user] - world.proxy(user)[2])]
                for user, side in enumerate((1.0, -1.0))
            ]
            world.step(np.array(forces) / sqrt(2.0 * B))

    draw(1.5, 5.0, (0.0, 0.0))
    draw(1.5, 5.0, (0.05, 0.05))
    held = world.accounts.scene()
    assert held["lifted_m"] > 0.03
    assert held["lifted_slip_m"] < 1e-4
    draw(1.0, 5.0, (-0.05, 0.15))
    slid = world.accounts.scene()
    assert slid["lifted_slip_m"] > 2e-3
    assert slid["lifted_slip_m"] <= slid["slip_m"]


@pytest.mark.parametrize(
    ("flag", "own"),
    [
        ("", "<sensor><framepos objtype='body' objname='tool'/><clock/></sensor>"),
        ("<flag sensor='disable'/>", ""),
    ],
)
def test_a_scene_with_sensors_of_its_own_or_with_none_is_measured_all_the_same(flag: str, own: str) -> None:
    xml = block("", flags=flag).replace("</mujoco>", f"{own}</mujoco>")
    world = hold(world_of(xml, ("tool",)))
    push(world, (3.0, 0.0, 0.0), 1.0)
    assert world.accounts.contact(0).normal_n == pytest.approx(3.0, abs=1e-6)
