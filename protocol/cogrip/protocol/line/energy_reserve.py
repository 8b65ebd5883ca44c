"""The balance of an energy ledger: energy put in less energy taken out.

An energy margin is the least balance of a run. It is at most 0, as the balance is 0 at the start, so the least balance after
the first second is reported as well: the energy reserve (SPEC.md 9).
"""

from math import inf, isfinite

FIRST_S = 1.0


class EnergyReserve:
    """Newest and least balance. Call `elapse` once a frame, `update` whenever the balance is known.

    balance_j  newest balance [J], -inf before the first
    least_j    least balance after the first second [J]: -inf until then, inf until the next `update`
    """

    __slots__ = ("_left", "balance_j", "least_j")

    def __init__(self, network_hz: int) -> None:
        self._left = round(FIRST_S * network_hz)  # frames of the first second to come
        self.balance_j = -inf
        self.least_j = -inf

    def elapse(self, frames: int = 1) -> None:
        """Count frames of the first second."""
        if self._left > 0:
            self._left -= frames
            if self._left <= 0:
                self.least_j = inf

    def update(self, balance_j: float) -> None:
        """Enter the balance of now [J]."""
        self.balance_j = balance_j
        if balance_j < self.least_j:
            self.least_j = balance_j

    @property
    def now_j(self) -> float | None:
        """Newest balance [J], None before the first."""
        return known(self.balance_j)

    @property
    def reported_j(self) -> float | None:
        """Least balance after the first second [J], None where there is none."""
        return known(self.least_j)


def known(least_j: float) -> float | None:
    """Return a least value, None where nothing has been seen yet."""
    return least_j if isfinite(least_j) else None
