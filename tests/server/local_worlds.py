"""Scene worlds with local models for tests, and hands that report proxies at random."""

from collections.abc import Callable, Sequence

import numpy as np

from cogrip.protocol.settings import resolve, seat_settings
from cogrip.server.worlds.local_scene import LocalScene
from cogrip.server.worlds.scene_file import held_by, load_scene, make_scene

from tests.server.scene_worlds import SCENES, SHIPPED, Array, T


def local_world(scene: str, tools: Sequence[str] = ("", ""), substeps: int = 4, axes: int = 3) -> LocalScene:
    """Return the world of a scene: a name of those that come with cogrip, or XML."""
    people = [{"tool": tool, "side": ("left", "right")[number % 2]} for number, tool in enumerate(tools)]
    thing = {"kind": "scene", "file": "x.xml", "axes": axes, "substeps": substeps}
    settings = resolve({"object": thing, "coupling": {"kind": "local"}, "users": people})
    held, step_s = held_by(settings), T / substeps
    loaded = load_scene(SCENES / f"{scene}.xml", held, step_s) if scene in SHIPPED else make_scene(scene, held, step_s)
    return LocalScene([seat_settings(settings, number) for number in range(len(tools))], loaded, substeps)


def join_all(world: LocalScene) -> LocalScene:
    """Let everybody take hold, each hand in the middle of its own frame."""
    for user in range(len(world.holding)):
        world.join(user, np.zeros(world.axes))
    return world


def report(world: LocalScene, proxies: Array) -> None:
    """Report a proxy of each hand, in its own frame."""
    for user, place in enumerate(proxies.tolist()):
        world.set_reported_positions(user, tuple(place), tuple(place))


def wanderers(world: LocalScene, seed: int) -> Callable[[Array], tuple[Array, Array]]:
    """Return proxies and waves from the waves that came back: slow and fast ways about the object, jumps, and any waves."""
    random = np.random.default_rng(seed)
    people = len(world.holding)
    place = np.zeros((people, 3))
    goal, speed, gain, mode, left = (
        place.copy(),
        np.full(people, 0.3),
        np.ones(people),
        np.zeros(people),
        np.zeros(people),
    )

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
        return place.copy(), waves

    return go_on
