"""The free end of a session: a hand that touches nothing, held by nobody, lightly, or firmly (theory 3.6).

A line whose far end is free sends back all that comes, so it is a resonator that only hand, device and decimator damp; a device
whose damper acts late feeds it. So it is judged apart from contact, for every way in which somebody may hold the device.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

from cogrip.analysis.advice.finding import growth
from cogrip.analysis.feel.feel import no_contact
from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import LinearPerson, LinearSession
from cogrip.analysis.linear.stability import verdict
from cogrip.client.safety.rendered_damper import rounded_down

_HALVINGS = 7  # number of halvings in the search of the largest impedance with which nothing grows


@dataclass(frozen=True, slots=True)
class HandGrip:
    """How somebody holds a device: stiffness [N/m] and damping [N s/m] of the hand; 0: nobody does."""

    name: str
    stiffness_npm: float
    damping_nspm: float


GRIPS = (
    HandGrip("with nobody holding it", 0.0, 0.0),
    HandGrip("in a light grip", 60.0, 1.0),
    HandGrip("in a firm grip", 300.0, 5.0),
)


@dataclass(frozen=True, slots=True)
class FreeEnd:
    """One person's free end: the grips in which it grows, growth of the worst a frame, and the largest b [N s/m] that is
    quiet in all of them at this delay (0: none is known)."""

    growing: tuple[HandGrip, ...]
    radius: float
    quiet_nspm: float


def free_end_text(found: FreeEnd, frame_s: float, cure: str = "quiet with b =") -> str:
    """Return in words whether the force on a hand that touches nothing grows, and with which b it would not.

    cure: words before that b
    """
    if not found.growing:
        return f"touching nothing, no force grows: {', '.join(grip.name for grip in GRIPS)}"
    quiet = f"{cure} {rounded_down(found.quiet_nspm):g} or less" if found.quiet_nspm else "no b would do"
    grips = " and ".join(grip.name for grip in found.growing)
    return f"touching nothing, the force grows {grips}: {growth(found.radius, frame_s)} at most; {quiet}"


def free_end_record(found: FreeEnd) -> dict[str, object]:
    """Return what JSON answers say of it."""
    return {
        "quiet": not found.growing, "growing": [grip.name for grip in found.growing], "radius": found.radius,
        "quiet_impedance_nspm": found.quiet_nspm,
    }  # fmt: skip


def free_end(session: LinearSession, number: int) -> FreeEnd | None:
    """Return the judgement of a person's free end; None for a scheme whose free hand feels no line."""
    if not session.traits.waves or session.local:
        return None
    alone = no_contact(session, number)
    return _judged(replace(alone, people=(replace(alone.people[0], name=""),)))


@lru_cache(maxsize=256)
def _judged(alone: LinearSession) -> FreeEnd:
    (person,) = alone.people
    b = person.impedance_nspm
    radii = {grip: _radius(alone, person, grip, b) for grip in GRIPS}
    growing = tuple(grip for grip, radius in radii.items() if radius >= 1.0)
    if not growing:
        return FreeEnd((), max(radii.values()), b)

    def quiet(impedance_nspm: float) -> bool:
        return all(_radius(alone, person, grip, impedance_nspm) < 1.0 for grip in growing)

    low = next((share for power in range(1, _HALVINGS) if quiet((share := 0.5**power) * b)), 0.0)
    high = 2.0 * low
    for _ in range(_HALVINGS if low else 0):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if quiet(middle * b) else (low, middle)
    return FreeEnd(growing, max(radii.values()), low * b)


def _radius(alone: LinearSession, person: LinearPerson, grip: HandGrip, impedance_nspm: float) -> float:
    held = replace(
        person,
        hand_stiffness_npm=grip.stiffness_npm,
        hand_damping_nspm=grip.damping_nspm,
        impedance_nspm=impedance_nspm,
    )
    return verdict(LiftedModel(replace(alone, people=(held,)))).decaying
