"""Energy that a scene makes while its tools are pushed at random, which no hand put in.

With E the energy of its bodies, S that of the springs of contacts, equalities and limits, and W what has come in at the ports,

    made = max over j < k of (E + S - W)_k - (E + S - W)_j

A scene that is passive never makes any; what dampers and friction take is not counted against it. Of bodies on hinges and ball
joints E is also taken with its velocities at places half a step before, where they belong (`half_step_j`): the lesser counts,
as what is made for good is in both. Hands are drawn to places in and about what the tools can reach, jerk, swing, and send back
what comes.
"""

from typing import NamedTuple

import numpy as np

from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.server.worlds.scenes.scene_springs import half_step_j, uncounted_j
from cogrip.server.worlds.world import Array, dot

PUSHES = 100
PUSH_FRAMES = 48  # most frames of one push
MOST_MADE_J = 1e-3
_MOST_WAVE = 2.0  # largest wave of a push [sqrt(W)]
_REACH_M = 0.12


class Pushed(NamedTuple):
    """Finding of pushes. made_j: as above; touched: share of the frames in which a tool met something; pushes: how many."""

    made_j: float
    touched: float
    pushes: int


def push(world: SceneWorld, seed: int, pushes: int = PUSHES) -> Pushed:
    """Push the tools of a world that nobody holds. Raises WorldError where it leaves all bounds."""
    random = np.random.default_rng(seed)
    seats, axes = len(world.holding), world.axes
    for user in range(seats):
        world.join(user, np.zeros(axes))
    work_j, touched, frames = 0.0, 0, 0
    least_j, made_j = np.full(2, np.inf), np.zeros(2)
    back: Array = np.zeros((seats, axes))
    for _ in range(pushes):
        goal = random.uniform(-_REACH_M, _REACH_M, (seats, axes))
        gain, manner = 10.0 ** random.uniform(0.5, 2.0), int(random.integers(4))
        period = int(random.integers(2, 24))
        for frame in range(int(random.integers(8, PUSH_FRAMES))):
            place = np.array([world.proxy(user) for user in range(seats)])
            u = np.clip(gain * (goal - place), -_MOST_WAVE, _MOST_WAVE)
            if manner == 1:
                u = u + random.normal(0.0, 0.3, u.shape)
            elif manner == 2:
                u = u if frame % period < period // 2 else -u
            elif manner == 3:
                u = np.clip(-back + 0.3 * u, -_MOST_WAVE, _MOST_WAVE)
            back = world.step(u)
            work_j += 0.5 * world.frame_s * (dot(u, u) - dot(back, back))
            stored_j = world.energy_j + uncounted_j(world) - work_j + np.array([0.0, half_step_j(world)])
            least_j = np.minimum(least_j, stored_j)
            made_j = np.maximum(made_j, stored_j - least_j)
            touched += any(touch.normal_n > 0.0 for touch in world.contacts.touches)
            frames += 1
    return Pushed(float(made_j.min()), touched / frames, pushes)
