"""Start of the solver in crowded scenes: the same answers, with less work, and none of it elsewhere."""

import numpy as np
import pytest

from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.server.worlds.scenes.warm_start import WarmStart

from tests.server.scene_worlds import hold, world_of


def shoved() -> SceneWorld:
    """Return the pile after two tools have been pushed into it for a while."""
    world = hold(world_of("pile"))
    for _ in range(15):
        world.step(np.array([[0.9, 0.0, -0.4], [-0.9, 0.0, -0.4]]))
    return world


def iterations(world: SceneWorld, frames: int) -> int:
    done = 0
    for _ in range(frames):
        world.step(np.array([[0.9, 0.0, -0.4], [-0.9, 0.0, -0.4]]))
        done += int(world.data.solver_niter[: world.data.nisland].sum())
    return done


def test_it_starts_on_the_line_through_the_last_two_accelerations() -> None:
    world = world_of("pile")
    warm, data = WarmStart(world.scene.model), world.data
    for last, expected in [(1.0, 2.0), (3.0, 5.0), (3.0, 3.0)]:
        data.qacc_warmstart[:] = last
        warm.extrapolate(data)
        assert data.qacc_warmstart == pytest.approx(np.full(36, expected))
    assert warm.save() == (3.0,) * 36


def test_a_scene_that_is_not_crowded_starts_as_mujoco_does() -> None:
    world = world_of("lift")
    warm = WarmStart(world.scene.model)
    world.data.qacc_warmstart[:] = 1.0
    warm.extrapolate(world.data)
    assert set(world.data.qacc_warmstart.tolist()) == {1.0}
    assert warm.save() == ()


def test_the_answers_are_the_same_and_cost_less(monkeypatch) -> None:
    world = shoved()
    saved = world.save()
    fewer = iterations(world, 10)
    place = world.data.qpos.copy()
    world.restore(saved)
    monkeypatch.setattr(WarmStart, "extrapolate", lambda *_: None)
    more = iterations(world, 10)
    assert world.data.qpos == pytest.approx(place, abs=1e-6)
    assert fewer < more
