"""The energy reserve of a ledger: what has been put in less what has been taken out. A margin is its least value ever, which
is 0 at most, as nothing has been put in at the start; so the least after the first second is kept beside it."""

from math import inf, isfinite

FIRST_S = 1.0


class EnergyReserve:
    """`elapse` once a frame, `see` whenever the reserve is known.

    now_j    the newest, None before the first
    least_j  the least after the first second: -inf until then, inf until it is known again
    """

    __slots__ = ("_left", "least_j", "now_j")

    def __init__(self, network_hz: int) -> None:
        self._left = round(FIRST_S * network_hz)
        self.now_j: float | None = None
        self.least_j = -inf

    def elapse(self, frames: int = 1) -> None:
        """Count the frames of the first second."""
        if self._left > 0:
            self._left -= frames
            if self._left <= 0:
                self.least_j = inf

    def see(self, reserve_j: float) -> None:
        """Take the reserve of now [J]."""
        self.now_j = reserve_j
        if reserve_j < self.least_j:
            self.least_j = reserve_j

    @property
    def told_j(self) -> float | None:
        """The least after the first second, None where there is none."""
        return known(self.least_j)


def known(least_j: float) -> float | None:
    """Return a least value, None where nothing has been seen yet."""
    return least_j if isfinite(least_j) else None
