"""The impedance that a session of the actual cores renders, measured: the counterpart of `cogrip.analysis.feel.feel`.

One user's hand swings its device as an even sine, whatever the force; after the ramps are over, velocity and force of every
tick over whole periods, which are whole frames too, give

    Z = sum_k F_k e^{-j w k T_c} / sum_k y_k e^{-j w k T_c}        F_k written at tick k, y_k = x'(t_k)

the same definition as `feel.impedance`.
"""

from dataclasses import dataclass
from math import pi
from types import SimpleNamespace
from typing import Any

import numpy as np
from msgspec.structs import replace

from cogrip.client.safety.limiter import NEAR_THERMAL_LIMIT
from cogrip.devices.device import Capability, Sample
from cogrip.devices.simulated.hands import SineSettings, directed, sine_course
from cogrip.protocol.settings.sections import Settings
from cogrip.sim.laboratory import Laboratory

RAMPS_S = 0.7  # the client's, and the object's if it can pay for it at once
LONGEST_S = 30.0


@dataclass(frozen=True)
class Measured:
    """The impedance [N s/m] at frequency_hz, the one used."""

    frequency_hz: float
    impedance: complex
    force_n: float
    amplitude_m: float


def swung(capability: Capability, settings: SineSettings) -> Any:
    """Return a `Device` in a hand that no force moves: position and velocity are exactly the intended ones."""
    hand = directed(sine_course)(settings, capability.axes)
    return SimpleNamespace(
        capability=capability,
        counts={},
        open=lambda rate_hz: hand.open(rate_hz, None),
        read=lambda tick: Sample(*hand.intended(tick)),
        write=lambda force_n: None,
        close=lambda: None,
    )


def measure(
    settings: Settings,
    user: int,
    frequency_hz: float,
    *,
    amplitude_m: float = 1e-3,
    offset_m: float = 0.0,
    periods: int = 4,
    settle_s: float = 3.0,
) -> Measured:
    """Measure the impedance rendered to one user near `frequency_hz` (moved so that `periods` are whole frames).

    The hand swings about offset_m on the first axis; everybody else is as in `settings`.
    """
    hz = settings.rates.network_hz
    frames = max(1, round(periods * hz / frequency_hz))
    frequency = periods * hz / frames
    laboratory = _with_ideal(settings, user, "hold")
    person = laboratory.people[user]
    # a slow start: a line that nothing is touched through has no loss of its own, and would ring on
    swing = SineSettings(
        amplitude_m=amplitude_m, frequency_hz=frequency, offset_m=offset_m, ramp_s=0.8 * max(settle_s, RAMPS_S)
    )
    person.device = swung(person.device.capability, swing)
    person.device.open(person.rates.device_hz)
    before = _settle(laboratory, max(settle_s, RAMPS_S))
    rows: dict[int, tuple[float, float, float]] = {}

    def watch(lab: Laboratory) -> None:
        core = person.core
        rows.setdefault(core.tick, (core.position_m[0], core.velocity_mps[0], core.force_n[0]))

    last = person.core.tick
    for _ in range(frames):
        laboratory.frame(watch)
    _check(laboratory, before)
    table = np.array([row for tick, row in rows.items() if tick > last])  # others' moments do not count
    tone = np.exp(-2j * pi * periods * np.arange(len(table)) / len(table))
    place, speed, force = (2.0 / len(table)) * (tone @ table)
    return Measured(frequency, complex(force / speed), abs(force), abs(place))


def static_stiffness(settings: Settings, user: int, settle_s: float = 8.0) -> float:
    """Measure F / x at rest of a constant push of 1 N against a wall [N/m], on an ideal device."""
    laboratory = _with_ideal(settings, user, "push&force_n=1.0")
    before = _settle(laboratory, settle_s)
    laboratory.frame()
    _check(laboratory, before)
    person = laboratory.people[user]
    return person.core.force_n[0] / person.core.position_m[0]


def _with_ideal(settings: Settings, user: int, hand: str) -> Laboratory:
    users = list(settings.users)
    users[user] = replace(users[user], device="sim:ideal", hand=hand)
    return Laboratory(replace(settings, users=tuple(users), seconds=1e6), bare=True)


def _settle(laboratory: Laboratory, seconds: float) -> list[dict[str, int]]:
    """Run until springs have grown; return what was limited until then, which what is measured does not depend on."""
    hz, world = laboratory.settings.rates.network_hz, laboratory.room.world
    for frame in range(round(LONGEST_S * hz)):
        if frame >= seconds * hz and np.array_equal(world.stiffness, world.target_stiffness):
            return [dict(person.core.safety.counts) for person in laboratory.people]
        laboratory.frame()
        assert not laboratory.incident
    raise AssertionError("a spring is still growing; only what its damper takes may pay for it: give damping_nspm > 0")


def _check(laboratory: Laboratory, before: list[dict[str, int]]) -> None:
    """Hold that the session stayed linear: no limit acted."""
    assert not laboratory.incident
    for person, then in zip(laboratory.people, before, strict=True):
        assert person.core.safety.state == "live", person.core.safety.reason
        now = {**person.core.safety.counts, NEAR_THERMAL_LIMIT: 0}
        assert now == {**then, NEAR_THERMAL_LIMIT: 0}, "use a smaller amplitude"
