"""Shapes and poses of a scene's bodies: those of the model, and what observers are told of them, when."""

from functools import partial

import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest
from msgspec import structs
from numpy.typing import NDArray

from cogrip.client.observed_scene import ObservedScene
from cogrip.protocol.drawing import Shape
from cogrip.protocol.wire.messages import MAX_MESSAGE_BYTES, MOST_NOTES, MOST_POSES, Bodies, Geom, Note, decode, encode
from cogrip.server.seats.drawn_bodies import (
    BODIES_AT_REST,
    MOVED_DEG,
    MOVED_M,
    NOTE_EVERY,
    SHAPES_A_VIEW,
    VIEWS_A_TURN,
    DrawnBodies,
)
from cogrip.server.seats.observers import VIEWS_HZ
from cogrip.server.worlds.drawing import Drawing
from cogrip.server.worlds.scenes.scene import SceneWorld

from tests.server.scene_worlds import hold, world_of

Array = NDArray[np.float64]
KINDS = """<mujoco>
  <asset><material name="blue" rgba="0 0 1 .5"/></asset>
  <worldbody>
    <geom type="plane" size="0 0 .1" pos="0 0 -.1"/>
    <body name="table" pos="0 .3 0" quat="0 0 0 1"><geom type="box" size=".1 .2 .01" pos=".05 0 0" material="blue"/></body>
    <body name="thing" pos=".01 0 .03" quat=".8 0 .6 0">
      <freejoint/>
      <geom type="capsule" size=".01 .02" pos="0 0 .01" rgba="1 0 0 1"/>
      <geom type="cylinder" size=".01 .02" euler="30 0 0"/>
      <geom type="ellipsoid" size=".01 .02 .03"/>
      <geom type="sphere" size=".05" group="3"/>
      <geom type="sphere" size=".05" rgba="1 1 1 0"/>
    </body>
    <body name="arm" pos="0 -.2 0"><joint axis="0 0 1"/><geom type="sphere" size=".02"/></body>
  </worldbody>
</mujoco>"""


def pile(bodies: int) -> str:
    """A scene of many boxes that float apart from each other."""
    rows = "".join(
        f'<body pos="{0.1 * (each % 9)} {0.1 * (each // 9)} 1"><freejoint/><geom type="box" size=".01 .01 .01"/></body>'
        for each in range(bodies)
    )
    return f'<mujoco><option integrator="implicitfast" gravity="0 0 0"/><worldbody>{rows}</worldbody></mujoco>'


def turned(pose: Array, shape: Shape) -> tuple[Array, Array]:
    """Return place and rotation matrix of a shape whose body has this pose."""
    place, whole, matrix = np.zeros(3), np.zeros(4), np.zeros(9)
    mujoco.mju_rotVecQuat(place, np.array(shape.place_m), pose[3:])
    mujoco.mju_mulQuat(whole, pose[3:], np.array(shape.orientation))
    mujoco.mju_quat2Mat(matrix, whole)
    return place + pose[:3], matrix


def test_shapes_with_poses_are_where_the_model_has_its_geoms() -> None:
    world = hold(world_of(KINDS, ("ball",)))
    model, data = world.scene.model, world.data
    random = np.random.default_rng(1)
    for _ in range(40):
        world.step(random.uniform(-0.5, 0.5, (1, 3)))
    shapes, poses = world.drawing.shapes(), world.drawing.poses()
    seen = [geom for geom in range(model.ngeom) if model.geom_group[geom] < 3 and model.geom_rgba[geom][3] > 0.0]
    assert [shape.kind for shape in shapes] == ["plane", "box", "capsule", "cylinder", "ellipsoid", "sphere", "sphere"]
    assert len(poses) == 3
    start = np.array([0.01, 0.0, 0.03])
    for shape, geom in zip(shapes, seen, strict=True):
        pose = np.eye(1, 7, 3)[0] if shape.body is None else poses[shape.body]
        place, matrix = turned(pose, shape)
        assert place + start == pytest.approx(data.geom_xpos[geom], abs=1e-12)
        assert matrix == pytest.approx(data.geom_xmat[geom], abs=1e-12)
        assert list(shape.size_m) == model.geom_size[geom].tolist()
    assert [each.body is None for each in shapes] == [True, True] + [False] * 5
    assert [each.rgba for each in shapes[:4]] == [None, (0.0, 0.0, 1.0, 0.5), (1.0, 0.0, 0.0, 1.0), None]
    assert [each.object for each in shapes] == [False, False, True, True, True, False, False]
    assert [each.seat for each in shapes] == [None] * 6 + [0]
    assert poses[0, :3] == pytest.approx(world.position, abs=1e-15)


class Placed:
    """A world whose bodies are put where a test wants them."""

    def __init__(self, bodies: int) -> None:
        self.poses = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (bodies, 1))
        self.drawing = Drawing()
        self.drawing.shapes = lambda: [Shape("sphere", (0.01, 0.0, 0.0), body) for body in range(bodies)]  # type: ignore[method-assign]
        self.drawing.poses = lambda: self.poses  # type: ignore[method-assign]


def test_an_object_alone_has_neither_shapes_nor_messages() -> None:
    assert DrawnBodies().messages(2, Placed(1))  # type: ignore[arg-type]
    assert DrawnBodies().messages(2, Placed(0)) == []  # type: ignore[arg-type]


def told(drawn: DrawnBodies, world: SceneWorld | Placed) -> tuple[dict[int, tuple[float, ...]], list[int]]:
    """Return poses by body and numbers of shapes that are told after a view; every message fits a datagram."""
    poses: dict[int, tuple[float, ...]] = {}
    shapes: list[int] = []
    for message in drawn.messages(2, world):  # type: ignore[arg-type]
        assert len(encode(message)) <= MAX_MESSAGE_BYTES
        assert decode(encode(message)) == message
        if isinstance(message, Geom):
            shapes.append(message.number)
        else:
            poses |= dict(message.read())
    return poses, shapes


def test_bodies_that_moved_are_told_at_once_and_the_others_in_turn() -> None:
    world, drawn = Placed(60), DrawnBodies()
    seen: list[int] = []
    for _ in range(-(-60 // BODIES_AT_REST)):
        seen += told(drawn, world)[0]
    assert sorted(set(seen)) == list(range(60))
    half = np.radians(0.5 * MOVED_DEG)
    world.poses[5, 0] += 1.01 * MOVED_M
    world.poses[7, 3:] = [np.cos(1.01 * half), 0.0, np.sin(1.01 * half), 0.0]
    world.poses[8, 3:] = -world.poses[8, 3:]  # the same orientation
    world.poses[9, 0] += 0.5 * MOVED_M
    poses = told(drawn, world)[0]
    assert list(poses)[:2] == [5, 7]
    assert poses[5] == pytest.approx(world.poses[5], abs=1e-7)
    assert len(poses) == 2 + BODIES_AT_REST


def test_of_more_moving_bodies_than_fit_all_have_their_turn() -> None:
    world, drawn = Placed(100), DrawnBodies()
    counts = np.zeros(100, dtype=int)
    told(drawn, world)
    for _ in range(60):
        world.poses[:90, 0] += 2.0 * MOVED_M
        poses = told(drawn, world)[0]
        assert len(poses) == MOST_POSES
        counts[list(poses)] += 1
    assert counts.min() >= 15, "23 if all were alike"


def test_a_pose_out_of_bounds_takes_the_others_from_nobody() -> None:
    world = Placed(3)
    rest = tuple(world.poses[2])
    world.poses[0], world.poses[1, 0] = np.nan, 1e9
    assert told(DrawnBodies(), world)[0] == {0: rest, 1: (1000.0, *rest[1:]), 2: rest}


@pytest.mark.parametrize("scene", ["lift", pile(120)])
def test_an_observer_who_loses_a_third_knows_all_within_three_seconds(scene: str) -> None:
    world, drawn, observed = world_of(scene), DrawnBodies(), ObservedScene()
    random = np.random.default_rng(3)
    views = 0
    while not observed.shapes or any(np.isnan(pose[0]) for pose in observed.poses()):
        views += 1
        assert views <= 3 * VIEWS_HZ
        for message in drawn.messages(2 * views, world):
            if random.random() >= 0.3:
                received = decode(encode(message))
                assert isinstance(received, Geom | Bodies | Note)
                assert observed.receive(received) == ""
    assert observed.shapes == tuple(world.drawing.shapes())
    assert np.array(observed.poses()) == pytest.approx(world.drawing.poses(), abs=1e-6)
    assert len(told(drawn, world)[1]) == min(SHAPES_A_VIEW, -(-len(observed.shapes) // VIEWS_A_TURN))


def test_observers_are_told_each_note_again_and_again_cut_to_a_message_and_keep_those_of_one_session() -> None:
    world, drawn, observed = Placed(0), DrawnBodies(), ObservedScene()
    notes = [f"note {number}" for number in range(MOST_NOTES + 1)]
    notes[1] = "x\n" * 400
    world.drawing.notes = lambda: notes
    told = [message for _ in range(2 * MOST_NOTES * NOTE_EVERY) for message in drawn.messages(2, world)]  # type: ignore[arg-type]
    assert len(told) == 2 * MOST_NOTES
    for message in told:
        assert observed.receive(decode(encode(message))) == ""  # type: ignore[arg-type]
    assert len(observed.notes) == MOST_NOTES
    assert [observed.notes[number] for number in (0, 2, MOST_NOTES - 1)] == [
        "note 0",
        "note 2",
        f"note {MOST_NOTES - 1}",
    ]
    assert observed.notes[1] == "x\\n" * 100
    assert observed.receive(Note(1, 2, 2, "x")) == "unfit"
    assert observed.receive(Note(2, 1, 0, "another")) == ""
    assert observed.notes == ("another",)


def test_messages_about_other_scenes_and_late_ones_are_dropped() -> None:
    geom = Geom(5, 2, 0, "box", (0.1,) * 3, 0, (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), None, None, True)
    replace = partial(structs.replace, geom)
    observed = ObservedScene()
    assert observed.receive(replace(number=2)) == "unfit"
    assert observed.receive(geom) == ""
    assert observed.receive(replace(count=3, number=1)) == "unfit"
    assert observed.shapes == ()
    world, drawn = Placed(1), DrawnBodies()
    (first, *_) = drawn.messages(4, world)  # type: ignore[arg-type]
    assert isinstance(first, Bodies)
    assert [observed.receive(Bodies(5, step, first.poses)) for step in (4, 4, 3)] == ["", "late poses", "late poses"]
    assert observed.receive(replace(number=1, body=1)) == ""
    assert len(observed.shapes) == 2
    assert [np.isnan(pose[0]) for pose in observed.poses()] == [False, True]
    assert observed.receive(replace(session=6)) == "", "another session begins anew"
    assert observed.shapes == ()
