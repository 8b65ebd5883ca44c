"""Felt stiffness at rest, measured by a probe: a static load on the same link and coupling.

Person i holds an ideal device against a constant force P_i, balanced over all people, until everything rests:

    K_felt,i = mean F_i / mean (x_i - x_o)        over the last LAST_S, x_i and x_o from where they began

F_i is the force on the hand, x_o the object itself. The device has damping b of its own, a matched termination, so that it
rests after a few round trips; a damper carries no force at rest, so K_felt is the method's alone. Frames lost under load let
the hand creep, which softens what it feels; that is included.

Theory section 4: waves make 1 / K_felt = 1 / K + (T_fwd + T_back + T_n) / (2 b).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from cogrip.analysis.feel.trace import TraceRecorder
from cogrip.machine.addition import add_floats
from cogrip.protocol.settings.object_kinds import kind_of
from cogrip.protocol.settings.room import coupling_of
from cogrip.protocol.settings.sections import Settings, User
from cogrip.sim.laboratory import Laboratory

LOAD_N = 1.0
START_S, APART_S = 0.5, 0.05
"""Time at which loads begin, when springs have their full stiffness, and time between two: so the object is moved."""
LAST_S = 2.0  # length of the stretch whose mean is what is felt: lost frames make the force flicker
SETTLE_S, SETTLE_ROUND_TRIPS = 2.0, 12.0
SHAKING = 2.0  # ratio of the force's swing to the load, above which nothing rests


@dataclass(frozen=True, slots=True)
class ProbedStiffness:
    """The felt stiffness of one person; None where the probe diverged, or the force on this hand never came to rest."""

    person: str
    asked_npm: float
    felt_npm: float | None

    @property
    def error_percent(self) -> float | None:
        """K_felt / K - 1 [%], comparable between people of different K."""
        return 100.0 * (self.felt_npm / self.asked_npm - 1.0) if self.felt_npm else None

    @property
    def added_mm_per_n(self) -> float | None:
        """1 / K_felt - 1 / K [mm/N]: the compliance that method and network add; with waves it does not depend on K."""
        return 1e3 * (1.0 / self.felt_npm - 1.0 / self.asked_npm) if self.felt_npm else None


def measure_felt(settings: Settings) -> tuple[ProbedStiffness, ...]:
    """Return the felt stiffness of every person with a spring; nothing where no balanced load exists."""
    loads = balanced_loads(settings)
    if loads is None:
        return ()
    probe = probe_settings(settings, loads)
    laboratory = Laboratory(probe)
    watch = TraceRecorder(laboratory, [(0.0,) * probe.object.axes] * len(probe.users))
    laboratory.run(watch.each_tick, watch.each_frame, lambda: bool(laboratory.incident))
    trace = watch.trace()
    frames = round(LAST_S * probe.rates.network_hz)
    ticks = round(len(trace.force_n) * frames / max(1, len(trace.position_m)))
    found: list[ProbedStiffness] = []
    for number, (user, load) in enumerate(zip(settings.users, loads, strict=True)):
        asked = coupling_of(settings, user).stiffness_npm
        if not asked:
            continue
        force = trace.force_n[-ticks:, number, 0]
        stretch = float((trace.position_m[-frames:, number, 0] - trace.object_m[-frames:, 0]).mean())
        rests = not laboratory.incident and np.ptp(force) <= SHAKING * abs(load) and stretch != 0.0
        found.append(ProbedStiffness(user.name, asked, float(force.mean()) / stretch if rests else None))
    return tuple(found)


def furthest_off(people: Sequence[ProbedStiffness]) -> ProbedStiffness | None:
    """Return the person with the largest |K_felt / K - 1|, or one who feels none; None for nobody."""
    errors = [(person, person.error_percent) for person in people]
    return next(
        (person for person, error in errors if error is None),
        max(people, key=lambda person: abs(person.error_percent or 0.0), default=None),
    )


def balanced_loads(settings: Settings) -> Sequence[float] | None:
    """Return the force of each person along the first axis [N]: +- LOAD_N, with sum 0 unless the object is fixed.

    None where that cannot be: one person alone at a free object, faces pushed from one side only, an object without springs.
    """
    users, kind = settings.users, settings.object.kind
    if not kind_of(kind).plain:
        return None
    if kind_of(kind).held:
        signs = [1.0 if number % 2 == 0 else -1.0 for number in range(len(users))]
    else:
        signs = [1.0 if user.side == "left" else -1.0 for user in users]
    if kind_of(kind).fixed:
        return [LOAD_N * sign for sign in signs]
    left, right = signs.count(1.0), signs.count(-1.0)
    if not left or not right:
        return None
    return [LOAD_N if sign > 0.0 else -LOAD_N * left / right for sign in signs]


def probe_settings(settings: Settings, loads_n: Sequence[float]) -> Settings:
    """Return the same session under a static load, long enough to settle."""
    directions = [settings.link.direction("up"), settings.link.direction("down")]
    round_trip_s = 1e-3 * add_floats(direction.delay_ms + 2.0 * direction.jitter_ms for direction in directions)
    users: list[User] = []
    for number, (user, load) in enumerate(zip(settings.users, loads_n, strict=True)):
        start_s = START_S + APART_S * number
        users.append(
            msgspec.structs.replace(
                user,
                device="sim:ideal",
                hand=f"push&force_n={load!r}&start_s={start_s!r}",
                device_damping_nspm=coupling_of(settings, user).impedance_nspm,
            )
        )
    seconds = START_S + APART_S * len(users) + SETTLE_S + SETTLE_ROUND_TRIPS * round_trip_s + LAST_S
    return msgspec.structs.replace(settings, users=tuple(users), seconds=seconds)
