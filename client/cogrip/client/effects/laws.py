"""Base of the effects' laws. Rows have one number a place of the seat, F is the force on the law: it loads the hand.

Passive laws (`PassiveLaw`) are springs of a potential U and dampers; active ones (`ActiveLaw`) whatever their work alone
accounts for.
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


class Moment(NamedTuple):
    """Hand in one tick, as an active law sees it. ticks: since it was told; missing: share of the tank that is not there."""

    position_m: Floats
    velocity_mps: Floats
    ticks: int
    missing: float


class ActiveLaw(ABC):
    """most_n: its force is never larger, but for one that follows the motion (`size_n`).

    slope_nps: nor the slope of one that follows time, stiffness_npm: of one in place, damping_nspm: by velocity, of one that
    follows the motion.
    """

    most_n = 0.0
    slope_nps = 0.0
    stiffness_npm = 0.0
    damping_nspm = 0.0

    @abstractmethod
    def present(self, position_m: Floats, ticks: int) -> bool:
        """Return whether it is felt here, so many ticks after it was told."""

    @abstractmethod
    def force(self, at: Moment) -> Floats:
        """Return the force of a tick."""

    def size_n(self, velocity_mps: Floats) -> float:
        """Return what its force is at most at this velocity."""
        return self.most_n

    def at_zero(self, ticks: int) -> bool:
        """Return whether its course passes 0 now: then it begins without a ramp."""
        return False


def unit(direction: Floats, places: int) -> list[float]:
    """Return a direction in these axes with length 1."""
    row = list(direction[:places])
    length = add_floats([each * each for each in row]) ** 0.5
    return [each / length for each in row]
