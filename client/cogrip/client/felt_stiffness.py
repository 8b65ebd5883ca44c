"""Force over displacement once a hand has come to rest."""

from collections import deque

REST_S = 0.5  # for which the frames must agree


class FeltStiffness:
    """Stiffness felt at rest; fed once a frame."""

    def __init__(self, resolution_m: float, frame_s: float) -> None:
        self._samples: deque[tuple[float, float]] = deque(maxlen=max(2, round(REST_S / frame_s)))
        self._resolution_m = resolution_m

    def add(self, depth_m: float, force_n: float) -> None:
        """Take the depth pressed and the force along it."""
        self._samples.append((depth_m, force_n))

    def stiffness_npm(self) -> float | None:
        """Return the mean force over the mean depth; None while the hand moves, or where nothing pushes back."""
        count = len(self._samples)
        if count != self._samples.maxlen:
            return None
        depths = [depth for depth, _ in self._samples]
        depth = sum(depths) / count
        force = sum(force for _, force in self._samples) / count
        moved = max(depths) - min(depths)
        if depth <= 0.0 or force <= 0.0 or moved > max(2.0 * self._resolution_m, 1e-3 * depth):
            return None
        return force / depth
