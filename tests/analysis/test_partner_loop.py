"""The loop gain of partners' models: against the client's own estimate, copy and models, stepped in time."""

from math import pi

import numpy as np
import pytest

from cogrip.analysis.linear.partner_loop import PartnerLoop
from cogrip.client.coupling.partner.hand_stiffness import HAND_NSPM
from cogrip.client.coupling.partner.intention import Intention
from cogrip.protocol.laws.partner_model import DRIFTING, HORIZON_S, Model, step_object

PAIR = PartnerLoop(2, 1000.0, 10.0, 0.2, 0.0, 0.1, 0.5)
TICK_S, SECONDS = 1.0 / 16384, 3.0  # a step so short that what it holds is not seen


def stepped(loop: PartnerLoop, hand_npm: float, told_npm: float, frequency_hz: float) -> float:
    """Return what an intention of 1 mm of each partner makes of one's own as its partners take it on, in mm."""
    K, B = loop.spring_npm, loop.spring_nspm
    own, models = Intention(1, TICK_S, loop.device_kg), [Model([0.0]) for _ in range(loop.people - 1)]
    x = v = 0.0
    o, rate = [0.0], [0.0]
    force, told, taken = 0.0, [], Model([0.0])
    taken.stiffness_npm = told_npm
    ticks = int(SECONDS / TICK_S)
    for tick in range(ticks):
        wave = 1e-3 * np.sin(2.0 * pi * frequency_hz * tick * TICK_S)
        for model in models:
            model.intention_m, model.stiffness_npm = [wave], told_npm
        step_object(TICK_S, o, rate, loop.object_kg, loop.object_nspm, (K, B), models, ([x], [v]))
        force = K * (x - o[0]) + B * (v - rate[0])
        v += TICK_S / loop.device_kg * (-hand_npm * x - (HAND_NSPM + loop.device_nspm) * v - force)
        x += TICK_S * v
        own.update([x], [v], [force], told_npm)
        taken.follow(own.rate_mps, TICK_S)
        carried = DRIFTING * taken.added_nspm / told_npm * taken.drift_mps[0]
        told.append(own.place_m[0] + HORIZON_S * own.rate_mps[0] + carried)
    turns = int(0.5 * SECONDS * frequency_hz) / frequency_hz
    last = np.array(told[-round(turns / TICK_S) :])
    phases = np.exp(-2j * pi * frequency_hz * TICK_S * np.arange(len(last)))
    return float(abs(2.0 * (last * phases).mean()) * 1e3)


@pytest.mark.parametrize(("people", "hand_npm", "told_npm"), [(2, 300.0, 150.0), (2, 600.0, 400.0), (3, 80.0, 80.0)])
@pytest.mark.parametrize("frequency_hz", [1.0, 6.0])
def test_it_is_that_of_estimate_copy_and_models(
    people: int, hand_npm: float, told_npm: float, frequency_hz: float
) -> None:
    loop = PAIR._replace(people=people)
    found = loop.gains(np.array([frequency_hz]), hand_npm, told_npm, HAND_NSPM)[0]
    assert stepped(loop, hand_npm, told_npm, frequency_hz) == pytest.approx(found, rel=0.03, abs=2e-3)


def test_told_too_stiff_is_what_makes_a_loop_unstable() -> None:
    assert PAIR.gain(80.0, 600.0) > 1.0 > PAIR.worst(80.0)
    assert PAIR._replace(people=5).worst(80.0) > PAIR._replace(people=3).worst(80.0) > PAIR.worst(80.0)


@pytest.mark.parametrize(("people", "felt_npm"), [(2, 187.5), (3, 1.0 / (1e-3 + 1.0 / (2.0 / (1e-3 + 1.0 / 300.0))))])
def test_hands_at_rest_are_springs_in_a_row(people: int, felt_npm: float) -> None:
    assert PAIR._replace(people=people).felt_npm(300.0) == pytest.approx(felt_npm)
