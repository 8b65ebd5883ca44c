"""A free object that the server steps with a model of every hand about its intention (`coupling.kind = "partner"`, theory 5b).

It owns the object's place; each client steps a copy of its own. Inputs and answers are those of `ports.partner_port`. No
energy of this copy passes a line, so no work is counted.
"""

from collections.abc import Sequence

import numpy as np

from cogrip.machine.rows import Row
from cogrip.protocol.laws.partner_model import Model, step_object
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.worlds.world import Array, HandWorld

STEPS_A_FRAME = (
    2  # steps of object and models in a frame: 8 move the object by 0.1 mm at most, and cost 1.4 times as much
)


def told_partners(
    object_state: tuple[Sequence[float], Sequence[float]], rows: Sequence[Sequence[float]], offsets: Sequence[Sequence[float]],
    holding: Sequence[bool],
) -> list[list[float]]:  # fmt: skip
    """Return to each person the object and all partners, in the hand's own frame.

    object_state             place and velocity of the object, each with its rotation behind it or without
    rows, offsets, holding   of all people: the inputs of a step, and as a world has them
    """
    axes = len(offsets[0])
    place, velocity = object_state
    intended = [
        [x - at for x, at in zip(row[axes : 2 * axes], own, strict=True)] if held else [0.0] * axes
        for row, own, held in zip(rows, offsets, holding, strict=True)
    ]
    rests = [row[2 * axes :] if held else [0.0] * (4 * axes) for row, held in zip(rows, holding, strict=True)]
    answers = []
    for own in offsets:
        answer = [x + at for x, at in zip(place, own, strict=False)]
        answer += (*place[axes:], *velocity)
        for there, rest in zip(intended, rests, strict=True):
            answer += [x + at for x, at in zip(there, own, strict=True)]
            answer += rest
        answers.append(answer)
    return answers


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
        return np.array(self.advance(inputs.tolist()))

    def advance(self, rows: Sequence[Row]) -> Sequence[Sequence[float]]:
        axes, offsets, holding = self.axes, self.offset.tolist(), self.holding.tolist()
        hands, speeds = self.hand.tolist(), self.speed.tolist()
        place, velocity = self.position.tolist(), self.velocity.tolist()
        models = {}
        for user, row in enumerate(rows):
            if holding[user]:
                models[user] = model = Model(hands[user])
                model.velocity_mps = speeds[user]
                model.intention_m = [x - at for x, at in zip(row[:axes], offsets[user], strict=True)]
                model.stiffness_npm = row[3 * axes]
        if models:
            # All springs are those of the room: the first person's stands for them.
            first = next(iter(models))
            K, B = float(self.target_stiffness[first, 0]), float(self.target_damping[first, 0])
            period, held = self.frame_s / STEPS_A_FRAME, list(models.values())
            for _ in range(STEPS_A_FRAME):
                step_object(period, place, velocity, self.mass_kg, self.object_damping, (K, B), held)
            for user, model in models.items():
                stretch = zip(model.place_m, place, model.velocity_mps, velocity, strict=True)
                self.force[user] = [K * (x - o) + B * (speed - v) for x, o, speed, v in stretch]
                self.hand[user], self.speed[user] = model.place_m, model.velocity_mps
                self.stiffness[user], self.damping[user] = K, B
        else:
            place = [at + self.frame_s * rate for at, rate in zip(place, velocity, strict=True)]
        self.position, self.velocity = np.array(place), np.array(velocity)
        return told_partners((place, velocity), rows, offsets, holding)
