"""Base of the effects' laws. Rows have one number a place of the seat, F is the force on the law: it loads the hand.

Passive laws (`PassiveLaw`) are springs of a potential U and dampers; active ones (`ActiveLaw`) a force of their own course.
"""

from abc import ABC, abstractmethod
from typing import NamedTuple

from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Floats
from cogrip.protocol.settings.effects import Effect


class Box:
    """Box of an effect: `inside` it, along all axes in which it ends."""

    def __init__(self, effect: Effect, places: int) -> None:
        self.sides = [
            (axis, middle, half)
            for axis, (middle, half) in enumerate(zip(effect.place_m, effect.size_m, strict=True))
            if half and axis < places
        ]

    def inside(self, position_m: Floats) -> bool:
        return all(abs(position_m[axis] - middle) <= half for axis, middle, half in self.sides)


class PassiveForce(NamedTuple):
    """Law of a passive effect at a place: force of its spring and U, force of its damper; () none."""

    spring_n: Floats = ()
    stored_j: float = 0.0
    damper_n: Floats = ()


NOTHING = PassiveForce()


class PassiveLaw(ABC):
    """stiffness_npm: K with U(x + d) <= U + F d + K d^2 / 2 for every d; damping_nspm: B."""

    stiffness_npm = 0.0
    damping_nspm = 0.0

    @abstractmethod
    def felt(self, position_m: Floats, velocity_mps: Floats) -> PassiveForce:
        """Return what the law does here."""


class ActiveLaw(ABC):
    """most_n: its force is never larger. slope_nps: nor the slope of one that follows time, stiffness_npm: of one in place."""

    most_n = 0.0
    slope_nps = 0.0
    stiffness_npm = 0.0

    @abstractmethod
    def present(self, position_m: Floats) -> bool:
        """Return whether it is felt here."""

    @abstractmethod
    def force(self, position_m: Floats, ticks: int) -> Floats:
        """Return the force so many ticks after it began."""


def unit(direction: Floats, places: int) -> list[float]:
    """Return a direction in these axes with length 1."""
    row = list(direction[:places])
    length = add_floats([each * each for each in row]) ** 0.5
    return [each / length for each in row]
