"""Times in which a device's force is released, because it oscillated or a limit held it: each alone, and whether they help."""

RELEASED_S = 0.5  # time for which the force is released
MOST_RELEASES = 2  # most releases within PERSISTS_S; one more is a fault
PERSISTS_S = 10.0


class Releases:
    """Releases of one device's force.

    count  how many there have been
    ticks  for how many one lasts
    """

    __slots__ = ("_at", "_left", "_persists_ticks", "count", "ticks")

    def __init__(self, tick_s: float) -> None:
        self.ticks, self._persists_ticks = round(RELEASED_S / tick_s), round(PERSISTS_S / tick_s)
        self._at: list[int] = []  # ticks of those of the last PERSISTS_S
        self._left = self.count = 0

    def begin(self, tick: int) -> None:
        """Release the force from this tick on."""
        self.count += 1
        self._left = self.ticks
        self._at = [*[each for each in self._at if tick - each < self._persists_ticks], tick]

    def elapse(self) -> None:
        """Count a tick."""
        if self._left:
            self._left -= 1

    def forget(self) -> None:
        """Begin anew, as after a fault."""
        self._at.clear()
        self._left = 0

    @property
    def releasing(self) -> bool:
        """True while the force is released."""
        return self._left > 0

    @property
    def persists(self) -> bool:
        """True where releases have not helped."""
        return len(self._at) > MOST_RELEASES
