"""Scene worlds with local models for tests, and hands that report proxies at random."""

from collections.abc import Callable, Iterator, Sequence
from math import inf

import numpy as np

from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.server.worlds.scenes.local_scene import LocalSceneWorld
from cogrip.server.worlds.scenes.scene_file import held_by, load_scene, make_scene
from cogrip.server.worlds.scenes.scene_springs import springs_j

from tests.server.scene_worlds import SCENES, SHIPPED, Array, T, port_j


def local_world(scene: str, tools: Sequence[str] = ("", ""), substeps: int = 4, axes: int = 3) -> LocalSceneWorld:
    """Return the world of a scene: a name of those that come with cogrip, or XML."""
    people = [{"tool": tool, "side": ("left", "right")[number % 2]} for number, tool in enumerate(tools)]
    thing = {"kind": "scene", "file": "x.xml", "axes": axes, "substeps": substeps}
    settings = resolve({"object": thing, "coupling": {"kind": "local"}, "users": people})
    held, step_s = held_by(settings), T / substeps
    loaded = load_scene(SCENES / f"{scene}.xml", held, step_s) if scene in SHIPPED else make_scene(scene, held, step_s)
    return LocalSceneWorld([seat_settings(settings, number) for number in range(len(tools))], loaded, substeps)


def join_all(world: LocalSceneWorld) -> LocalSceneWorld:
    """Let everybody take hold, each hand in the middle of its own frame."""
    for user in range(len(world.holding)):
        world.join(user, np.zeros(world.axes))
    return world


def report(world: LocalSceneWorld, proxies: Array) -> None:
    """Report a proxy of each hand, in its own frame."""
    for user, place in enumerate(proxies.tolist()):
        world.set_reported_positions(user, tuple(place), tuple(place))


def wanderers(world: LocalSceneWorld, seed: int) -> Callable[[Array], tuple[Array, Array]]:
    """Return proxies and waves from the waves that came back: slow and fast ways about the object, jumps, and any waves."""
    random, turning = np.random.default_rng(seed), np.random.default_rng(seed)
    people = len(world.holding)
    place, goal = np.zeros((2, people, 3))
    speed, gain, mode, left = np.full(people, 0.3), np.ones(people), np.zeros(people), np.zeros(people)

    def go_on(back: Array) -> tuple[Array, Array]:
        for user in np.flatnonzero(left <= 0).tolist():
            start = world.offset[user, :3]
            goal[user] = start + random.uniform((-0.08, -0.08, -0.03), 0.08)  # seldom below a floor
            left[user], mode[user] = random.integers(5, 150), random.integers(4)
            speed[user], gain[user] = 10.0 ** random.uniform(-1.5, 1.0), 10.0 ** random.uniform(-1.5, 0.5)
            if random.random() < 0.2:
                place[user] = goal[user]
        left[:] -= 1
        way = goal - place
        far = np.maximum(np.sqrt((way * way).sum(axis=1)), 1e-9)
        place[:] += way * np.minimum(1.0, speed * T / far)[:, None]
        tools = np.array([world.proxy(user)[:3] for user in range(people)])
        drawn = np.clip(30.0 * gain[:, None] * (place - tools), -2.0, 2.0)
        noise = random.normal(0.0, 0.3, (people, 3)) * gain[:, None]
        mirrored = np.clip(-back[:, :3], -2.0, 2.0) + 0.3 * drawn
        waves = np.select([(mode == each)[:, None] for each in (0, 1, 2)], [drawn, drawn + noise, mirrored], 0.0)
        return place.copy(), np.hstack((waves, turning.normal(0.0, 0.1, (people, world.axes - 3))))

    return go_on


def wander(world: LocalSceneWorld, seed: int, frames: int) -> Iterator[tuple[Array, Array, Array]]:
    """Step with hands that wander; yield which tools were clear before, the waves that came and those that went back."""
    hands, back = wanderers(world, seed), np.zeros((len(world.holding), world.axes))
    for _ in range(frames):
        proxies, waves = hands(back)
        report(world, proxies)
        clear = world.kinematic.copy()
        back = world.step(waves)
        yield clear, waves, back


def holds_no_more(
    world: LocalSceneWorld, seed: int, frames: int, worst_j: float, excess_j: float = inf
) -> set[tuple[bool, bool]]:
    """Check that the world has no more than came in, its springs included; return which tools were clear before and after."""
    seen: set[tuple[bool, bool]] = set()
    start, came, least = world.energy_j, 0.0, springs_j(world)
    places = np.arange(world.axes) < 3  # of a clear tool these waves do not count
    for clear, waves, back in wander(world, seed, frames):
        came += port_j(np.where((world.kinematic & clear)[:, None] & places, 0.0, waves), back)
        excess = world.energy_j - start - came
        assert excess <= excess_j, seed
        held = excess + springs_j(world)
        assert held - least <= worst_j, seed
        least = min(least, held)
        assert world.limiter.level_j >= 0.0
        seen |= set(zip(clear.tolist(), world.kinematic.tolist(), strict=True))
    assert world.limiter.limited == 0, seed
    assert world.balance_error_j <= 1e-14
    return seen


def course(world: LocalSceneWorld, seed: int, frames: int) -> list[object]:
    """Return all that is seen of a world where hands wander, bit for bit."""
    seen: list[object] = []
    for _, _, back in wander(world, seed, frames):
        seen.append((back.tobytes(), world.data.qpos.tobytes(), world.engaged_at(0), world.engaged_at(1)))
    return [*seen, world.save()]
