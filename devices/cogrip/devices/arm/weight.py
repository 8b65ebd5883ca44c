"""Compensation of an arm's own weight: which part of it the motors hold. Pure.

The motors' torque for it is the gradient of the arm's potential energy (`Kinematics.gravity`), so that on the hand it cancels
the weight of the links, and what is left is the force that the client asked for. It rises when the device is opened, as no
force may step, and falls when the device has failed: the hand takes the weight over.
"""

RISE_S = 0.3
FALL_S = 0.04  # gone before the 50 ms after which no force may be left


class WeightCompensation:
    """share: of the weight that is held, 0 to 1. active: whether this arm's weight is to be held at all."""

    def __init__(self, rate_hz: int, *, active: bool) -> None:
        self.fraction = 0.0
        self._rise = 1.0 / (RISE_S * rate_hz) if active else 0.0
        self._fall = 1.0 / (FALL_S * rate_hz)
        self._tick = 0

    def step(self, tick: int, *, failed: bool) -> float:
        """The share at `tick`, which does not fall. Ticks that were skipped do not make it rise in one step."""
        ticks, self._tick = tick - self._tick, tick
        change = -self._fall * ticks if failed else self._rise * min(1, ticks)
        self.fraction = min(1.0, max(0.0, self.fraction + change))
        return self.fraction
