"""Energy limiter: what goes back from a world's wave ports never exceeds what came in, whatever the world computes.

Per frame of T seconds; u, v waves in and back [sqrt(W)], E energy of the world [J] (kinetic and potential), L its level [J]:

    in = sum (u^2 - v^2) T/2      R = sum v^2 T/2      L' = L + in - (E - E_before)
    if L' < 0:  pay = min(-L', R),  every v is multiplied by sqrt(1 - pay/R),  L' grows by pay
    L = min(L', most_j)

A wave that is not 0 leaves only with L >= 0: below 0 every v is 0. The level never counts more than what came in less what
is stored, so at each such moment sum of in >= E - E(0) - start_j: no more comes out than the world held at first and `start_j`.
Whoever changes the world by hand (a body put back, a tool put in) takes the energy after that change as E_before.
"""

from dataclasses import dataclass
from math import sqrt

START_J = 1e-3
MOST_J = 50e-3  # largest level of the limiter: more than contacts store


@dataclass(slots=True)
class EnergyLimiter:
    """The ledger of one world.

    level_j   L: what came in and is not stored
    paid_j    energy that was taken from returning waves so far
    limited   frames in which it acted
    """

    frame_s: float
    start_j: float = START_J
    most_j: float = MOST_J
    level_j: float = START_J
    paid_j: float = 0.0
    limited: int = 0

    def __post_init__(self) -> None:
        self.level_j = self.start_j

    def limit(self, squares_in: float, squares_back: float, change_j: float) -> float:
        """Book one frame and return the factor of every returning wave, 0 to 1.

        squares_in, squares_back: sums of u^2 and v^2 over all ports [W]; change_j: E - E_before.
        """
        back_j = 0.5 * self.frame_s * squares_back
        level_j = self.level_j + 0.5 * self.frame_s * squares_in - back_j - change_j
        factor = 1.0
        if level_j < 0.0:
            pay_j = min(-level_j, back_j)
            factor = sqrt(1.0 - pay_j / back_j) if pay_j < back_j else 0.0
            level_j += pay_j
            self.paid_j += pay_j
            self.limited += 1
        self.level_j = min(level_j, self.most_j)
        return factor

    def account(self) -> dict[str, float]:
        """Return the ledger as a summary has it."""
        return {"level_j": self.level_j, "paid_j": self.paid_j, "limited_frames": self.limited}
