"""Scenes for the reference schemes: each tool is driven by a force that is held over the frame (theory section 8.6).

Per axis at a tool, e from its place to where it is to be and w the velocity of that, both at the frame's start, q the tool's
velocity then, K and B of the coupling, T frame:

    virtual coupling    e, w: the hand's, as received last            F = K e + B (w - q)
    tdpa                e: proxy's, w: as asked for, g                F = K e + B (g - q),   w = min(g, W / (F T)) along F

A force that is held while the tool moves can create energy, whatever the link does: neither is passive as a world. tdpa's
controller keeps to W, what has come in at the hand, at its own port, where it takes out F w T in a frame.
"""

from collections.abc import Sequence

import numpy as np

from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.worlds.power import DRIFT_MPS, DRIFT_SHARE, GIVE_SHARE
from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.server.worlds.scenes.scene_accounts import DrivenAccounts
from cogrip.server.worlds.scenes.scene_file import Scene
from cogrip.server.worlds.world import Array


class DrivenScene(SceneWorld):
    """Base of both: tools without the damper of a wave port, and no limiter of waves."""

    port_damped = False

    def __init__(self, seats: Sequence[SeatSettings], scene: Scene, substeps: int) -> None:
        super().__init__(seats, scene, substeps)
        self.accounts = DrivenAccounts(self, [seat.user for seat in seats])

    def tools(self) -> tuple[Array, Array]:
        """Return place [m], in each hand's own frame, and velocity [m/s] of every tool, shapes (n, 3)."""
        return self.data.qpos[self._places] - self._zero, self.data.qvel[self._dofs]

    def drive(self, force: Array) -> Array:
        """Move the tools by held forces for a frame; return how far each went [m]."""
        self.force = np.where(self.holding[:, None], force, 0.0)
        before = self.data.qpos[self._places]
        self.integrate(self.force)
        self._gain()
        self._make_solid()
        moved: Array = self.data.qpos[self._places] - before
        return moved


class CoupledScene(DrivenScene):
    """Virtual coupling. Inputs are device position and velocity, shape (n, 6); back go those of the person's tool."""

    inputs_per_axis = 2

    def step(self, inputs: Array) -> Array:
        place, speed = self.tools()
        stretch, relative = inputs[:, :3] - place, inputs[:, 3:] - speed
        moved = self.drive(self.target_stiffness * stretch + self.target_damping * relative)
        self._count_work((self.force * moved).sum(axis=1))
        answers: Array = np.concatenate(self.tools(), axis=1)
        return answers


class PowerScene(DrivenScene):
    """Time-domain passivity. Inputs and answers are those of `power.PowerWorld`; `hand` is each proxy in its own frame."""

    inputs_per_axis = 4

    def __init__(self, seats: Sequence[SeatSettings], scene: Scene, substeps: int) -> None:
        super().__init__(seats, scene, substeps)
        self.hand = np.zeros((len(seats), 3))

    def join(self, user: int, position_m: Array) -> None:
        super().join(user, position_m)
        self.hand[user] = position_m

    def step(self, inputs: Array) -> Array:
        period = self.frame_s
        aim, pace, energy, filled = (inputs[:, 3 * part : 3 * part + 3] for part in range(4))
        place, speed = self.tools()
        drift = np.clip(DRIFT_SHARE * ((aim - self.hand) / period - pace), -DRIFT_MPS, DRIFT_MPS)
        asked = pace + drift
        force = self.target_stiffness * (self.hand - place) + self.target_damping * (asked - speed)
        force = np.where(self.holding[:, None], force, 0.0)
        led = asked - GIVE_SHARE / self.impedance * (1.0 - filled) * force
        most = np.maximum(0.0, energy) / period  # power that may come out
        over = force * led > most
        led[over] = most[over] / force[over]
        self.hand = self.hand + period * np.where(self.holding[:, None], led, 0.0)
        self.drive(force)
        self._count_work(period * (force * led).sum(axis=1))
        answers: Array = np.concatenate((force, led), axis=1)
        return answers
