"""Stiffness that a hand feels where it rests."""

from collections import deque

from cogrip.machine.addition import add_floats

REST_S = 0.5  # time for which frames must agree before a hand is at rest
STILL_FRACTION = 0.1  # A hand at rest stays within this part of its depth: half of what tells two stiffnesses apart.
LEAST_N = 0.05  # least force of a hand that presses; less is the rounding of a hand that touches nothing


class FeltStiffness:
    """Stiffness felt at rest: force over displacement, fed once a frame. resolution_m: of the device."""

    def __init__(self, resolution_m: float, frame_s: float) -> None:
        self.resolution_m = resolution_m
        self._samples: deque[tuple[float, float]] = deque(maxlen=max(2, round(REST_S / frame_s)))

    def add(self, depth_m: float, force_n: float) -> None:
        """Take the depth pressed and the force along it."""
        self._samples.append((depth_m, force_n))

    def stiffness_npm(self) -> float | None:
        """Return the mean force over the mean depth; None while the hand moves, or where nothing pushes back."""
        count = len(self._samples)
        if count != self._samples.maxlen:
            return None
        depths = [depth for depth, _ in self._samples]
        depth, force = add_floats(depths) / count, add_floats([force for _, force in self._samples]) / count
        if (
            depth <= 0.0
            or force < LEAST_N
            or max(depths) - min(depths) > max(2.0 * self.resolution_m, STILL_FRACTION * depth)
        ):
            return None
        return force / depth
