"""Velocity from encoder positions, for the devices that give no velocity of their own (theory section 3.6)."""

from collections.abc import Sequence

MEMORY = 0.6


class AlphaBeta:
    """Critically damped alpha-beta (g-h) filter, one state pair an axis.

    `memory` is the pole both errors decay with: alpha = 1 - memory^2, beta = (1 - memory)^2. An encoder step of q metres
    moves the estimate by beta q / T; that times b is the noise the hand feels. The estimate lags by about
    2 memory / (1 - memory) ticks, and lag in a damper gives energy: with 0.8 sessions of `sim:phantom` at b = 20 break into
    oscillation below 0.1 kg, with 0.6 they are quiet at 0.045 kg (tests/sim/test_estimated_damping.py).
    """

    __slots__ = ("_alpha", "_beta_rate", "_position", "_tick_s", "_velocity")

    def __init__(self, axes: int, tick_s: float, memory: float = MEMORY) -> None:
        self._alpha = 1.0 - memory * memory
        self._beta_rate = (1.0 - memory) ** 2 / tick_s
        self._tick_s = tick_s
        self._position: list[float] | None = None
        self._velocity = [0.0] * axes

    def update(self, position_m: Sequence[float], ticks: int = 1) -> list[float]:
        """Velocity [m/s], shape (axes,), after `ticks` ticks at the position [m] read now."""
        estimate, velocity = self._position, self._velocity
        if estimate is None:
            self._position = list(position_m)
            return velocity
        step_s = self._tick_s * ticks
        alpha, beta_rate = self._alpha, self._beta_rate / ticks
        for axis, measured in enumerate(position_m):
            predicted = estimate[axis] + step_s * velocity[axis]
            error = measured - predicted
            estimate[axis] = predicted + alpha * error
            velocity[axis] += beta_rate * error
        return velocity

    def reset(self) -> None:
        """Forget everything: the last sample was not to be used."""
        self._position = None
        self._velocity = [0.0] * len(self._velocity)
