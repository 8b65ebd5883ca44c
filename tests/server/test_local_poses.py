"""Tools that hands turn, in scenes whose clients render contact: turning is the line's, clear tools do no work, bad tools."""

import numpy as np
import pytest

from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.messages import Stamp, Waves
from cogrip.server.ports.local_port import LocalPort
from cogrip.server.ports.seat_limits import SeatLimits
from cogrip.server.worlds.scenes.local_scene import LocalSceneWorld
from cogrip.server.worlds.scenes.scene_text import SceneError

from tests.extent import long
from tests.server.local_worlds import holds_no_more, join_all, local_world, report
from tests.server.scene_worlds import WORST_J, T, port_j

BALLS = ("ball", "ball")


def poses(scene: str) -> LocalSceneWorld:
    return join_all(local_world(scene, BALLS, axes=6))


def test_a_clear_tool_is_where_its_proxy_is_and_turns_by_its_line() -> None:
    world, random = poses("lift"), np.random.default_rng(1)
    goals = world.offset[:, :3] + np.array([[-0.2, 0.0, 0.2], [0.2, 0.0, 0.2]])
    report(world, goals)
    for _ in range(20):
        world.step(np.zeros((2, 6)))
    start, came, turned = world.energy_j, 0.0, 0.0
    for _ in range(200):
        goals = goals + random.uniform(-0.01, 0.01, (2, 3))
        report(world, goals)
        waves = random.normal(0.0, 0.1, (2, 6))
        back = world.step(waves)
        came += port_j(waves[:, 3:], back[:, 3:])
        turned = max(turned, float(np.abs(world.proxy(0)[3:]).max()))
        assert world.kinematic.all()
        assert not back[:, :3].any()
        assert np.array([world.proxy(user)[:3] for user in (0, 1)]) == pytest.approx(goals, abs=1e-12)
        assert np.abs(world.data.qvel[world._dofs]).max() <= 1e-15
        assert world.energy_j - start <= came + 1e-12
    assert turned > 0.05
    assert world.balance_error_j <= 1e-14


@pytest.mark.parametrize(("seeds", "frames"), [(3, 300), long(100, 1000)])
def test_no_energy_comes_of_proxies_and_changes(seeds: int, frames: int) -> None:
    """1.3e-6 J; of the same scene under waves 1e-5."""
    seen = [holds_no_more(poses("lift"), seed, frames, WORST_J["lift"]) for seed in range(seeds)]
    assert len(set().union(*seen)) == 4


OFF = "<freejoint/><geom size='.01' pos='.02 0 0' mass='.05'/>"
HEAVY = (
    "<freejoint/><geom size='.01' mass='.05'/><geom size='.01' pos='.03 0 0' mass='.05' contype='0' conaffinity='0'/>"
)
BOX = "<freejoint/><geom type='box' size='.01 .01 .01' mass='.05'/>"
BALL = "<freejoint/><geom name='ball' size='.01' mass='.05'/>"
TIED = "<equality><weld body1='hand' body2='post'/></equality>"


def of_hand(tool: str, more: str = "") -> LocalSceneWorld:
    post = "<body name='post' pos='.5 0 .3'><freejoint/><geom size='.01' mass='.05'/></body><geom size='.1'/>"
    body = f"<body name='hand' pos='.5 0 .1'>{tool}</body>{post}"
    return local_world(f"<mujoco><worldbody>{body}</worldbody>{more}</mujoco>", ["hand"], axes=6)


@pytest.mark.parametrize(
    ("tool", "more", "why"),
    [
        (OFF, "", "it is not one ball about its own place"),
        (HEAVY, "", "it is not one ball about its own place"),
        (BOX, "", "it does not touch with balls alone"),
        (BALL, TIED, "it is tied to other bodies"),
    ],
    ids=["ball beside its place", "mass beside its place", "box", "welded"],
)
def test_a_tool_of_the_scene_that_turns_and_cannot_be_rendered_is_refused(tool: str, more: str, why: str) -> None:
    with pytest.raises(SceneError, match=why):
        of_hand(tool, more)
    (ball,) = of_hand(BALL).geometry
    assert [shape.seat for shape in ball.shapes] == [None, 0], "a ball can be"


@pytest.mark.parametrize("tool", ["", "pad", "box"])
def test_an_added_tool_that_turns_and_is_no_ball_is_refused_by_name(tool: str) -> None:
    whose = "^coupling.kind = \"local\": no client renders contact with the tool of user 'user2': "
    cure = '; set tool = "ball" or orientation = "fixed", or coupling.kind = "wave"$'
    with pytest.raises(SceneError, match=f"{whose}.*{cure}"):
        local_world("wall", ["ball", tool], axes=6)


def port_of_poses() -> LocalPort:
    table = {"object": {"kind": "scene", "axes": 6, "file": "x.xml"}, "coupling": {"kind": "local"}}
    settings = resolve({**table, "playout": {"frames": 0}, "users": [{"name": "anna", "tool": "ball"}]})
    return LocalPort(seat_settings(settings, 0), SeatLimits())


def up(number: int, wave: tuple[float, ...], state: tuple[float, ...], heard_ns: int = 0) -> Waves:
    total = tuple((number + 1) * each for each in wave)
    squares = tuple((number + 1) * each * each for each in wave)
    made_j = 0.5 * T * sum(squares)
    return Waves(1, number, wave, total, squares, made_j, made_j, 0, Stamp(number + 1, heard_ns), state)


def test_places_are_absorbed_while_the_tool_is_clear_and_turning_is_played() -> None:
    port, wave = port_of_poses(), (0.3, 0.0, -0.2, 0.1, 0.2, 0.3)
    state = (0.0,) * 6 + (0.01, 0.0, 0.0, 0.0, 0.0, 0.1) + (0.0, 0.0, 0.1) + (0.008, 0.0, 0.0)
    for number in range(5):
        assert port.receive(up(number, wave, state), number)
        assert port.pop(1) == pytest.approx(
            (0.0, 0.0, 0.0, *wave[3:]), rel=0.02
        )  # with what compensates the first frame
        port.push((0.0,) * 6)
        port.message(1, MessageClock(), number + 1, (0.0,) * 12, 0.0)
    assert port.absorbed_j == pytest.approx(5 * 0.5 * T * (0.09 + 0.04), rel=0.01)
    assert port.proxy == (0.008, 0.0, 0.0)
    assert port.hand == state[6:12]
    assert port.turned == ((0.0, 0.0, 0.1), (0.0, 0.0, 0.1))
    engaged = (0.0, 0.0, 0.05)
    for number in range(5, 8):
        port.message(1, MessageClock(), 100, (0.0,) * 12 + engaged, 0.0)
        assert port.receive(up(number, wave, state, heard_ns=100 if number > 5 else 0), number)
        played = wave if number > 5 else (0.0, 0.0, 0.0, *wave[3:])  # of before it was known: absorbed
        assert port.pop(1) == pytest.approx(played, rel=0.02)
        port.push((0.0,) * 6)


def test_states_of_another_length_are_unfit() -> None:
    port = port_of_poses()
    for length in (2, 12, 15, 17):
        assert not port.receive(up(0, (0.0,) * 6, (0.0,) * length), 0)
    assert port.receive(up(0, (0.0,) * 6, (0.0,) * 18), 0)
