"""The lifted model's impedances and stiffness against sessions of the actual cores with a sinusoidal hand."""

from collections.abc import Callable
from itertools import product
from math import pi
from typing import Any

import numpy as np
import pytest

from cogrip.analysis.feel.feel import alone, held, impedance, no_contact, on_wall, slow_feel
from cogrip.analysis.linear.linear_session import LinearSession, form_overrides, linear_session
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings

from tests.extent import every
from tests.sim.measured_impedance import measure, static_stiffness
from tests.sim.session_measures import FRAME_MS

AMPLITUDE_M = 2e-4


def base(scheme: Any, frames: int, kind: str, names: str = "a", **coupling: Any) -> Settings:
    table = {
        "object": {"kind": kind},
        "coupling": coupling,
        "link": {"delay_ms": frames * FRAME_MS},
        "users": [{"name": name, "device": "sim:ideal", "hand": "hold"} for name in names],
    }
    return resolve(table, form_overrides(scheme))


CONDITIONS: dict[str, tuple[str, str, float, Callable[[LinearSession], LinearSession]]] = {
    "no contact": ("wall", "a", -2.0 * AMPLITUDE_M, lambda session: no_contact(session, 0)),
    "on a wall": ("wall", "a", 10.0 * AMPLITUDE_M, lambda session: on_wall(session, 0)),
    "alone": ("cube", "a", 0.0, lambda session: alone(session, 0)),
    "others hold on": ("cube", "ab", 0.0, lambda session: held(session, 0, 300.0, 5.0)),
}
"""Object, people, the hand's offset, and the same condition of the lifted model."""
CASES = [
    (condition, scheme, frames)
    for condition in CONDITIONS
    for scheme, frames in (("passive", 0), ("passive", 3), ("paper", 1), ("coupling", 0))
    if not (condition == "no contact" and scheme == "coupling")  # nothing flows there at all
]


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("condition", "scheme", "frames", "frequency_hz"),
    every(18, [(*case, hz) for hz in (5.0, 1.0, 18.0) for case in CASES]),
)
def test_the_model_renders_what_a_session_does(condition: str, scheme: str, frames: int, frequency_hz: float) -> None:
    kind, names, offset, in_model = CONDITIONS[condition]
    settings = base(scheme, frames, kind, names)
    session = in_model(linear_session(settings, estimated=False))
    settle_s = 6.0 if frames == 3 else 3.0  # what a long line rings on for
    measured = measure(settings, 0, frequency_hz, amplitude_m=AMPLITUDE_M, offset_m=offset, settle_s=settle_s)
    model = impedance(session, 0, np.array([2.0 * pi * measured.frequency_hz]))[0]
    assert abs(measured.impedance - model) < 1e-3 * abs(model)  # asked: 3 %


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("scheme", "decimator", "frames"), every(7, product(("passive", "paper"), ("boxcar", "lowpass"), (0, 1, 3)))
)
def test_the_model_feels_as_stiff_as_a_session(scheme: str, decimator: str, frames: int) -> None:
    settings = resolve(
        {
            "object": {"kind": "wall"},
            "coupling": {"decimator": decimator, "server_step": scheme, "stiffness_npm": 250.0},
            "link": {"delay_ms": frames * FRAME_MS},
            "users": [{"name": "a", "device_damping_nspm": 2.0}],
        }
    )
    felt = slow_feel(on_wall(linear_session(settings, estimated=False), 0), 0).stiffness_npm
    assert static_stiffness(settings, 0, settle_s=4.0) == pytest.approx(felt, rel=0.005)


@pytest.mark.long
def test_twice_the_swing_is_the_same_impedance() -> None:
    settings = base("passive", 1, "cube", "ab")
    small, large = (measure(settings, 0, 3.0, amplitude_m=size, settle_s=1.5, periods=2) for size in (1e-4, 2e-4))
    assert large.impedance == pytest.approx(small.impedance, rel=1e-3)
    assert large.force_n == pytest.approx(2.0 * small.force_n, rel=1e-3)
    assert large.amplitude_m == pytest.approx(2e-4, rel=1e-6)
