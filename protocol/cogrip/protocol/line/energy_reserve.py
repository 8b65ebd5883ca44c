"""The energy reserve of a ledger: energy put in less energy taken out.

An energy margin is the least reserve of a run. It is at most 0, as the reserve is 0 at the start, so the least one after
the first second is reported as well (SPEC.md 9).
"""

from math import inf, isfinite

FIRST_S = 1.0


class EnergyReserve:
    """Newest and least reserve. Call `elapse` once a frame, `update` whenever the reserve is known.

    newest_j   newest reserve [J], -inf before the first
    least_j    least reserve after the first second [J]: -inf until then, inf until the next `update`
    """

    __slots__ = ("_left", "least_j", "newest_j")

    def __init__(self, network_hz: int) -> None:
        self._left = round(FIRST_S * network_hz)  # frames of the first second to come
        self.newest_j = -inf
        self.least_j = -inf

    def elapse(self, frames: int = 1) -> None:
        """Count frames of the first second."""
        if self._left > 0:
            self._left -= frames
            if self._left <= 0:
                self.least_j = inf

    def update(self, newest_j: float) -> None:
        """Enter the reserve of now [J]."""
        self.newest_j = newest_j
        if newest_j < self.least_j:
            self.least_j = newest_j

    @property
    def now_j(self) -> float | None:
        """Newest reserve [J], None before the first."""
        return known(self.newest_j)

    @property
    def reported_j(self) -> float | None:
        """Least reserve after the first second [J], None where there is none."""
        return known(self.least_j)


def known(least_j: float) -> float | None:
    """Return a least value, None where nothing has been seen yet."""
    return least_j if isfinite(least_j) else None
