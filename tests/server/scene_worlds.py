"""Scene worlds for tests, hands that push at random, and a person at a wave line."""

from collections import deque
from collections.abc import Callable, Sequence
from itertools import zip_longest
from math import sqrt
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cogrip.cli.settings.settings_file import load
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.server.schemes import make_scene_world
from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.server.worlds.scenes.scene_file import held_by, load_scene, make_scene

Array = NDArray[np.float64]
T, B = 1 / 128, 20.0
SLIDES = "".join(f"<joint type='slide' axis='{axis}'/>" for axis in ("1 0 0", "0 1 0", "0 0 1"))
SCENES = Path(__file__).parents[2] / "configs" / "scenes"
NOTHING = "<mujoco><option gravity='0 0 0'/><worldbody>{}</worldbody></mujoco>"
SHIPPED = ("wall", "lift", "pile")
WORST_J = {"wall": 1e-5, "lift": 1e-5, "pile": 1e-5, "peg": 1e-2, "table": 1e-2, "valve": 1e-2, "wheel": 1e-2}
"""Settings of scenes that come with cogrip: most energy that a window of any length may give back beyond what came in."""


def world_of(
    scene: str | Path, tools: Sequence[str] = ("", ""), substeps: int = 4, b: float = B, axes: int = 3,
    orientations: Sequence[str] = (), **coupling: float,
) -> SceneWorld:  # fmt: skip
    """Return the world of a scene: a name of those that come with cogrip, a path, or XML."""
    people = [
        {"tool": tool, "side": ("left", "right")[number % 2], "orientation": orientation}
        for number, (tool, orientation) in enumerate(zip_longest(tools, orientations, fillvalue=""))
    ]
    thing = {"kind": "scene", "file": "x.xml", "axes": axes, "substeps": substeps}
    settings = resolve({"object": thing, "coupling": {"impedance_nspm": b, **coupling}, "users": people})
    if scene in SHIPPED:
        scene = SCENES / f"{scene}.xml"
    load_it = load_scene if isinstance(scene, Path) else make_scene
    loaded = load_it(scene, held_by(settings), T / substeps)  # type: ignore[operator]
    return SceneWorld([seat_settings(settings, number) for number in range(len(tools))], loaded, substeps)


def world_of_settings(name: str) -> SceneWorld:
    """Return the world of settings that come with cogrip: their scene, tools and axes."""
    settings = load(Path(name))
    world = make_scene_world(settings, [seat_settings(settings, number) for number in range(len(settings.users))])
    assert isinstance(world, SceneWorld)
    return world


def hold(world: SceneWorld, *opening_m: float) -> SceneWorld:
    """Let everybody take hold, each hand in the middle of its own frame, and open so far where it has a gripper."""
    for user in range(len(world.holding)):
        world.join(user, np.concatenate((np.zeros(world.axes - len(opening_m)), opening_m)))
    return world


def port_j(u: Array, v: Array) -> float:
    """Return what one frame brought in at all ports."""
    return 0.5 * T * float((u * u - v * v).sum())


def adversary(world: SceneWorld, seed: int) -> Callable[[Array], Array]:
    """Return waves from the waves that came back: hands drawn to places about the object, jerks, mirrors, periods."""
    random = np.random.default_rng(seed)
    shape = len(world.holding), world.axes
    state = {"left": 0, "mode": 0, "goal": np.zeros(shape), "frame": 0, "gain": 1.0, "period": 8}

    def next_waves(back: Array) -> Array:
        if state["left"] == 0:
            state.update(
                left=int(random.integers(5, 120)), mode=int(random.integers(4)), gain=float(10.0 ** random.uniform(-1, 0.5)),
                goal=random.uniform(-0.12, 0.12, shape), period=int(random.integers(2, 30)),
            )  # fmt: skip
        state["left"] -= 1
        state["frame"] += 1
        place = np.array([world.proxy(user) for user in range(shape[0])])
        drawn = np.clip(30.0 * state["gain"] * (state["goal"] - place), -2.0, 2.0)
        if state["mode"] == 1:
            return drawn + random.normal(0.0, 0.3 * state["gain"], drawn.shape)
        if state["mode"] == 2:
            return drawn * (1.0 if state["frame"] % state["period"] < state["period"] // 2 else -1.0)
        if state["mode"] == 3:
            return np.clip(random.choice([-1.0, 1.0]) * back, -2.0, 2.0) + 0.3 * drawn
        return drawn

    return next_waves


def course(world: SceneWorld, seed: int, frames: int) -> str:
    """Step through waves at random; return the last answer and the state, bit for bit."""
    random = np.random.default_rng(seed)
    bits = b""
    for _ in range(frames):
        bits = world.step(random.uniform(-0.8, 1.0, (2, 3)) * [1.0, 0.3, 0.3]).tobytes()
    return (bits + world.data.qpos.tobytes()).hex()


class Person:
    """An ideal device on one axis at a line of `delay` frames each way and of impedance b, one tick a frame."""

    def __init__(self, delay: int, b: float = B) -> None:
        self.b = b
        self.up, self.down = deque([0.0] * delay), deque([0.0] * delay)
        self.arrived = 0.0
        self.force_n = 0.0

    def exchange(self, moved_m: float, serve: Callable[[float], float]) -> None:
        """Move by moved_m in one frame: the force is from the wave that has arrived, held over the frame."""
        velocity = moved_m / T
        self.force_n = self.b * velocity - sqrt(2.0 * self.b) * self.arrived
        self.up.append(sqrt(2.0 * self.b) * velocity - self.arrived)
        self.down.append(serve(self.up.popleft()))
        self.arrived = self.down.popleft()
