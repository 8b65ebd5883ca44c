"""Tell whether somebody holds one's own device at all: a device that nobody holds moves as its mass and the force on it say.

Symbols, over all axes: F force of the client, m a inertia of the device, f = F + m a + d v + c sign(v) force of the hand, each
through one pole of FILTER_S.

    let go:  |f| < FREE |F| and |F| > LEAST_N, for LASTING_S        held again:  |f| > HELD |F| and |f| > AGAIN_N

No hand that is still there gives up its force so fast: it would have to follow the device. Where the force is small nothing is
told, and what was last known stays.
"""

from collections.abc import Sequence

from cogrip.client.coupling.partner.hand_stiffness import DeviceDrag
from cogrip.machine.addition import add_products

FILTER_S = 0.003
LASTING_S = 0.005
LEAST_N, FREE = 0.5, 0.2
AGAIN_N, HELD = 0.3, 0.5
AGAIN_S = 0.2  # time in which a hand that holds again comes to be as stiff as before


class Release:
    """share: of its stiffness that a hand is told to have; 0 from the tick in which it is known to have let go."""

    def __init__(self, axes: int, tick_s: float, drag: DeviceDrag) -> None:
        self._axes, self._drag = axes, drag
        self._pole, self._inertia, self._grown = tick_s / FILTER_S, drag.mass_kg / FILTER_S, tick_s / AGAIN_S
        self._lasting = max(1, round(LASTING_S / tick_s))
        self.begin()

    def begin(self) -> None:
        """Begin with a hand that holds."""
        self.share, self.held = 1.0, True
        self._free = 0  # ticks for which nobody seems to hold
        self._force, self._speed = [0.0] * self._axes, [0.0] * self._axes

    def enter(self, velocity_mps: Sequence[float], force_n: Sequence[float]) -> None:
        """Enter a tick."""
        pole, drag = self._pole, self._drag
        forces, speeds, hand = self._force, self._speed, []
        for axis, (v, force) in enumerate(zip(velocity_mps, force_n, strict=True)):
            forces[axis] += pole * (force - forces[axis])
            gained = v - speeds[axis]
            speeds[axis] += pole * gained
            hand.append(forces[axis] + self._inertia * gained + drag.force(speeds[axis]))
        own = add_products(hand, hand)
        loaded = add_products(forces, forces)
        if not self.held:
            self.held = own > max(AGAIN_N * AGAIN_N, HELD * HELD * loaded)
            self._free = 0
        elif loaded > LEAST_N * LEAST_N and own < FREE * FREE * loaded:
            self._free += 1
            self.held = self._free < self._lasting
        else:
            self._free = 0
        self.share = min(1.0, self.share + self._grown) if self.held else 0.0
