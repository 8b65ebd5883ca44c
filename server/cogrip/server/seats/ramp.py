"""A number that goes to its goal by a factor of e a second at most, so that no hand feels a step of what is set."""

RAMP_S = 1.0  # time in which a number changes by a factor of e


class Ramp:
    """Call `update` once a frame.

    value  now
    goal   where it goes
    """

    __slots__ = ("_least", "_share", "goal", "value")

    def __init__(self, value: float, least: float, frame_s: float) -> None:
        """least: of numbers below this one the step is that of this one, so that 0 is reached, and left."""
        self.value = self.goal = value
        self._least, self._share = least, frame_s / RAMP_S

    def update(self) -> float | None:
        """Return the number from now on; None where it is at its goal."""
        if self.value == self.goal:
            return None
        step = max(self.value, self._least) * self._share
        self.value = min(max(self.goal, self.value - step), self.value + step)
        return self.value
