"""Energy tank of one seat's effects: what active effects may give a hand, and what a fixture that appears around one costs.

    level <= capacity: begins there, and rises by what the hand has put into dampers

The level falls by the work of active forces and by what springs are paid for. Both are drawn within what was there before, for
any motion within the device's speed limit; what a late tick draws beyond that is counted.
"""


class EnergyTank:
    """capacity_j, level_j: of now; least_j: of the level; drawn_j: by active forces in all; overdrawn_j: by late ticks."""

    __slots__ = ("_damped_j", "_most_damped_j", "capacity_j", "drawn_j", "least_j", "level_j", "overdrawn_j")

    def __init__(self) -> None:
        self.capacity_j = self.level_j = self.least_j = self.drawn_j = self.overdrawn_j = 0.0
        self._damped_j = self._most_damped_j = 0.0

    def set_capacity(self, capacity_j: float) -> None:
        """Hold at most this from now on; a first tank is full."""
        if self.capacity_j == 0.0:
            self.level_j = self.least_j = capacity_j
        self.capacity_j = capacity_j
        self._set(min(self.level_j, capacity_j))

    @property
    def missing(self) -> float:
        """Return which share of the capacity is not there."""
        return 1.0 - self.level_j / self.capacity_j if self.capacity_j else 1.0

    def _set(self, level_j: float) -> None:
        self.level_j = level_j
        if level_j < self.least_j:
            self.least_j = level_j

    def damped(self, work_j: float) -> None:
        """Enter the hand's work against dampers: it fills the tank, once they have taken more than ever before.

        A damper is late and may give a little of it back (theory 3.6): that is never taken from the tank, but made good first.
        """
        self._damped_j += work_j
        if (more_j := self._damped_j - self._most_damped_j) > 0.0:
            self._most_damped_j = self._damped_j
            self.fill(more_j)

    def fill(self, energy_j: float) -> None:
        """Take in what a spring returns, or dampers took."""
        self.level_j = min(self.capacity_j, self.level_j + energy_j)

    def worked(self, work_j: float) -> None:
        """Enter the hand's work against active forces, below 0 where they gave it energy."""
        if work_j >= 0.0:
            self.fill(work_j)
            return
        self.drawn_j -= work_j
        left_j = self.level_j + work_j
        if left_j < 0.0:
            self.overdrawn_j -= left_j
            left_j = 0.0
        self._set(left_j)

    def pay(self, cost_j: float) -> None:
        """Take what a spring costs: no more than the level, as its payer has seen to."""
        self._set(max(0.0, self.level_j - cost_j))
