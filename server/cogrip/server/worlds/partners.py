"""A free object that the server steps with a model of every hand about its intention (`coupling.kind = "partner"`, theory 5b).

It owns the object's place; each client steps a copy of its own. Inputs and answers are those of `ports.partner_port`. No
energy of this copy passes a line, so no work is counted.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cogrip.protocol.laws.partner_model import Model, step_object
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.worlds.world import Array, HandWorld

STEPS_A_FRAME = (
    2  # steps of object and models in a frame: 8 move the object by 0.1 mm at most, and cost 1.4 times as much
)

NOT_TURNED: Array = np.zeros((2, 0))


def told_partners(
    place_m: Array, velocity_mps: Array, rows: Array, offset: Array, holding: NDArray[np.bool_], turned: Array = NOT_TURNED
) -> Array:  # fmt: skip
    """Return to each person the object and all partners, in the hand's own frame.

    turned: rotation vector and angular velocity of the object, shape (2, 3), where they are not behind place and velocity
    rows, offset, holding: of all people: the inputs of a step, shape (n, 6, axes), and as a world has them
    """
    users = len(holding)
    told = np.concatenate((rows[:, 1:2] - offset[:, None, :], rows[:, 2:]), axis=1)  # (users, 5, axes)
    told[~holding] = 0.0
    answers = np.repeat(told[np.newaxis], users, axis=0)
    answers[:, :, 0] += offset[:, None, :]
    turn, moving = (
        np.repeat(each[np.newaxis], users, axis=0) for each in (turned[0], np.concatenate((velocity_mps, turned[1])))
    )
    return np.concatenate((place_m + offset, turn, moving, answers.reshape(users, -1)), axis=1)


class PartnersWorld(HandWorld):
    """`hand` is where each model's device is, in the object's frame; `speed` how fast it goes."""

    kept = ("speed",)
    inputs_per_axis = 6

    def __init__(self, seats: Sequence[SeatSettings]) -> None:
        super().__init__(seats)
        self.speed = np.zeros_like(self.hand)

    def join(self, user: int, position_m: Array) -> None:
        super().join(user, position_m)
        self.speed[user] = 0.0

    def leave(self, user: int) -> None:
        super().leave(user)
        self.speed[user] = 0.0

    def step(self, inputs: Array) -> Array:
        axes, users = self.axes, len(self.holding)
        rows = inputs.reshape(users, 6, axes)
        here = rows[:, :2] - self.offset[:, None, :]  # intentions, now and as they were told, in the object's frame
        held = np.flatnonzero(self.holding).tolist()
        models = []
        for user in held:
            model = Model(self.hand[user].tolist())
            model.velocity_mps = self.speed[user].tolist()
            model.intention_m, model.stiffness_npm = here[user, 0].tolist(), float(rows[user, 3, 0])
            models.append(model)
        place, velocity = self.position.tolist(), self.velocity.tolist()
        if held:
            # All springs are those of the room: the first person's stands for them.
            K, B = float(self.target_stiffness[held[0], 0]), float(self.target_damping[held[0], 0])
            for _ in range(STEPS_A_FRAME):
                step_object(
                    self.frame_s / STEPS_A_FRAME, place, velocity, self.mass_kg, self.object_damping, (K, B), models
                )
            for user, model in zip(held, models, strict=True):
                stretch = zip(model.place_m, place, model.velocity_mps, velocity, strict=True)
                self.force[user] = [K * (x - o) + B * (speed - v) for x, o, speed, v in stretch]
            self.stiffness[held], self.damping[held] = K, B
        else:
            place = [at + self.frame_s * rate for at, rate in zip(place, velocity, strict=True)]
        self.position, self.velocity = np.array(place), np.array(velocity)
        for user, model in zip(held, models, strict=True):
            self.hand[user], self.speed[user] = model.place_m, model.velocity_mps
        return told_partners(self.position, self.velocity, rows, self.offset, self.holding)
