"""The impedance that a session of the actual cores renders, measured: the counterpart of `feel`.

One user's hand swings its device as an even sine, whatever the force; after the ramps are over, velocity and force of every
tick over whole periods, which are whole frames too, give

    Z = sum_k F_k e^{-j w k T_c} / sum_k y_k e^{-j w k T_c}        F_k written at tick k, y_k = x'(t_k)

the same definition as `feel.impedance`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
from msgspec.structs import replace

from cogrip.client.safety import WARNED
from cogrip.devices.device import Capability, Sample
from cogrip.devices.simulated.hands import SineSettings, directed, sine_course
from cogrip.protocol.settings import Settings
from cogrip.sim.session.laboratory import Laboratory

_RAMPS_S = 0.7  # the client's, and the object's if it can pay for it at once
_LONGEST_S = 30.0


class MeasurementError(RuntimeError):
    """A session that did not stay linear, or did not settle: it has no impedance."""


@dataclass(frozen=True, slots=True)
class Measured:
    """The impedance [N s/m] at frequency_hz, the one used; `other_share`: the share of the force's energy elsewhere."""

    frequency_hz: float
    impedance: complex
    force_n: float
    amplitude_m: float
    other_share: float


class SwungDevice:
    """A `Device` in a hand that no force moves: position and velocity are exactly the intended ones."""

    def __init__(self, capability: Capability, settings: SineSettings) -> None:
        self.capability = capability
        self.counts: dict[str, int] = {}
        self._hand = directed(sine_course)(settings, capability.axes)

    def open(self, rate_hz: int) -> None:
        self._hand.open(rate_hz, None)

    def read(self, tick: int) -> Sample:
        return Sample(*self._hand.intended(tick))

    def write(self, force_n: Sequence[float]) -> None:
        pass

    def close(self) -> None:
        pass


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
    Raises MeasurementError where a limit acted, the session diverged, or a ramp did not end within 30 s.
    """
    hz = settings.rates.network_hz
    frames = max(1, round(periods * hz / frequency_hz))
    frequency = periods * hz / frames
    if not 0.0 < frequency < 0.5 * hz:
        raise MeasurementError(f"frequency of {frequency:g} Hz is out of 0 to {0.5 * hz:g}: half the network rate")
    laboratory = _with_ideal(settings, user, "hold")
    person = laboratory.people[user]
    # a slow start: a line that nothing is touched through has no loss of its own, and would ring on
    swing = SineSettings(
        amplitude_m=amplitude_m, frequency_hz=frequency, offset_m=offset_m, ramp_s=0.8 * max(settle_s, _RAMPS_S)
    )
    person.device = SwungDevice(person.device.capability, swing)
    person.device.open(person.rates.device_hz)
    before = _settle(laboratory, max(settle_s, _RAMPS_S))
    rows: list[tuple[float, float, float]] = []
    ticked = person.core.tick

    def watch(lab: Laboratory) -> None:
        nonlocal ticked
        if person.core.tick == ticked:
            return  # somebody else's moment
        ticked = person.core.tick
        rows.append((person.core.position_m[0], person.core.velocity_mps[0], person.core.force_n[0]))

    for _ in range(frames):
        laboratory.frame(watch)
    _check(laboratory, before)
    table = np.array(rows)
    tone = np.exp(-2j * pi * periods * np.arange(len(table)) / len(table))
    place, speed, force = (2.0 / len(table)) * (tone @ table)
    varying = table[:, 2] - table[:, 2].mean()
    energy = float((varying**2).mean())
    other = 1.0 - 0.5 * abs(force) ** 2 / energy if energy else 0.0
    return Measured(frequency, complex(force / speed), abs(force), abs(place), max(0.0, other))


def static_stiffness(settings: Settings, user: int, force_n: float = 1.0, settle_s: float = 8.0) -> float:
    """Measure F / x at rest of a constant push against a wall [N/m], on an ideal device. Raises MeasurementError."""
    laboratory = _with_ideal(settings, user, f"push&force_n={force_n!r}")
    before = _settle(laboratory, settle_s)
    laboratory.frame()
    _check(laboratory, before)
    person = laboratory.people[user]
    return person.core.force_n[0] / person.core.position_m[0]


def _with_ideal(settings: Settings, user: int, hand: str) -> Laboratory:
    users = list(settings.users)
    users[user] = replace(users[user], device="sim:ideal", hand=hand)
    return Laboratory(replace(settings, users=tuple(users), seconds=1e6), bare=True)


Counts = list[dict[str, int]]


def _settle(laboratory: Laboratory, seconds: float) -> Counts:
    """Run until nothing changes any more; what was limited until then, which what is measured does not depend on."""
    hz = laboratory.settings.rates.network_hz
    world = laboratory.room.world
    for frame in range(round(_LONGEST_S * hz)):
        if frame >= seconds * hz and np.array_equal(world.stiffness, world.target_stiffness):
            return [dict(person.core.safety.counts) for person in laboratory.people]
        laboratory.frame()
        if laboratory.diverged:
            raise MeasurementError(f"the session diverged: {laboratory.diverged}")
    raise MeasurementError(
        f"after {_LONGEST_S:g} s a spring is still growing towards its stiffness, {world.stiffness.ravel().tolist()} of "
        f"{world.target_stiffness.ravel().tolist()} N/m: only what its damper takes may pay for it, so give damping_nspm > 0"
    )


def _check(laboratory: Laboratory, before: Counts) -> None:
    if laboratory.diverged:
        raise MeasurementError(f"the session diverged: {laboratory.diverged}")
    for person, then in zip(laboratory.people, before, strict=True):
        now = {name: count - then.get(name, 0) for name, count in person.core.safety.counts.items()}
        limits = [f"{name}: {count}" for name, count in now.items() if count and name != WARNED]
        if limits or person.core.safety.state != "live":
            raise MeasurementError(
                f"{person.name}: a limit acted ({', '.join(limits) or person.core.safety.reason}); use a smaller amplitude"
            )
