"""Viscous field: F = B v in a box."""

from cogrip.client.effects.laws import NOTHING, Box, PassiveForce, PassiveLaw
from cogrip.machine.rows import Floats
from cogrip.protocol.settings.effects import Effect


class ViscousField(PassiveLaw):
    """Dissipates B v^2; its border stores nothing, so it may lie anywhere."""

    def __init__(self, effect: Effect, places: int, tick_s: float) -> None:
        self._box, self._places = Box(effect, places), places
        self.damping_nspm = effect.damping_nspm

    def felt(self, position_m: Floats, velocity_mps: Floats) -> PassiveForce:
        if not self._box.inside(position_m):
            return NOTHING
        damping = self.damping_nspm
        return PassiveForce((), 0.0, [damping * speed for speed in velocity_mps[: self._places]])
