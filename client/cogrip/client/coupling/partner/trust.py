"""How far a partner's model is trusted: from all of its force to none, by how well it has foretold that partner (theory 5b.2).

Symbols, over all axes: e_i, e_j intentions of this hand and of partner j, ê_j what the model took e_j to be at the time; all
three for the moment at which the newest intention was made, a loop ago. k_i, k_j stiffness of the hands, K spring of a seat.

    d = e_i - ê_j        y = e_i - e_j        w = (mean y d + r^2) / (mean d^2 + r^2), from 0 to 1

d is what this hand felt of its partner, as a stretch, and y what it should have felt: of all factors on that force w is the one
that would have left the least error. A model is made softer until its hand, both springs and this hand in series give w of
their force:

    1/k = 1/k_j + (1/w - 1) (1/k_i + 2/K + 1/k_j)
"""

from collections import deque
from collections.abc import Sequence

from cogrip.machine.addition import add_products
from cogrip.protocol.laws.poses import IN_PLACES, Places

MEAN_S = 2.0  # time constant of the means
ROUGH_M = 0.001  # r: intentions that differ by less tell nothing
LEAST = 0.02  # w below which a model has no stiffness at all
KEPT_S = 2.0  # longest loop for which intentions are remembered


class Trust:
    """Trust in one partner's model; call `enter` once a frame, and `learn` for each new intention.

    share  w
    """

    def __init__(self, frame_s: float, space: Places = IN_PLACES) -> None:
        self._frame_s, self._space = frame_s, space
        self._past: deque[tuple[Sequence[float], Sequence[float]]] = deque(maxlen=max(2, round(KEPT_S / frame_s)))
        self._pole = min(1.0, frame_s / MEAN_S)
        self._both = self._square = 0.0
        self.share = 1.0

    def enter(self, own_m: Sequence[float], taken_m: Sequence[float]) -> None:
        """Enter what this hand intends now, and what the model takes its partner to intend."""
        self._past.append((own_m, taken_m))

    def learn(self, intention_m: Sequence[float], age_s: float) -> None:
        """Learn what the partner intended so long ago."""
        back = 1 + round(age_s / self._frame_s)
        if back > len(self._past):
            return
        own, taken = self._past[-back]
        felt, right = self._space.way(taken, own), self._space.way(intention_m, own)
        self._both += self._pole * (add_products(felt, right) - self._both)
        self._square += self._pole * (add_products(felt, felt) - self._square)
        rough = ROUGH_M * ROUGH_M
        self.share = min(1.0, max(0.0, (self._both + rough) / (self._square + rough)))

    def stiffness_npm(self, told_npm: float, own_npm: float, spring_npm: float) -> float:
        """Return the stiffness of a model whose hand is told to have `told_npm`."""
        if self.share >= 1.0 or told_npm <= 0.0 or spring_npm <= 0.0:
            return told_npm
        if self.share < LEAST:
            return 0.0
        series = 1.0 / max(1.0, own_npm) + 2.0 / spring_npm + 1.0 / told_npm
        return 1.0 / (1.0 / told_npm + (1.0 / self.share - 1.0) * series)
