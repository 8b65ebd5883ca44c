"""The forces that some people of a session feel, watched tick by tick."""

import math
from collections.abc import Callable

from cogrip.sim.laboratory import Laboratory


class Felt:
    """Watches the forces of some people; a jolt is a step of the force from one device tick to the next."""

    def __init__(self, laboratory: Laboratory, *numbers: int) -> None:
        self.laboratory = laboratory
        self._last: dict[int, tuple[float, ...]] = {}
        self._numbers = numbers or tuple(range(len(laboratory.people)))
        self.step_n = self.peak_n = 0.0
        self.zero_since: dict[int, int] = {}  # tick

    def tick(self, laboratory: Laboratory) -> None:
        for number in self._numbers:
            force = laboratory.people[number].core.force_n
            self.step_n = max(self.step_n, math.dist(force, self._last.get(number, force)))
            self.peak_n = max(self.peak_n, math.hypot(*force))
            if any(force):
                self.zero_since.pop(number, None)
            else:
                self.zero_since.setdefault(number, laboratory.tick)
            self._last[number] = force

    def run(self, frames: int) -> None:
        for _ in range(frames):
            self.laboratory.frame(self.tick)
        assert not self.laboratory.incident

    def until(self, done: Callable[[], bool], seconds: float) -> float:
        """Run until something is so. Returns how long that took [s]."""
        begun = self.laboratory.seconds
        while not done():
            assert self.laboratory.seconds - begun < seconds, "it takes too long"
            self.run(1)
        return self.laboratory.seconds - begun
