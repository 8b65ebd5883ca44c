"""How a hand lets go of the object after `stop`, without a jerk for the others."""

from collections.abc import Sequence

FADE_S = 0.5  # time from `stop` in which what the line still holds the object by fades
MOST_LOOP_S = 0.5
"""A client that leaves then stays for one measured loop, and this at most, so that the end of the fade arrives."""


class Leaving:
    """The fade of a line after `stop`. The fading force lets the hand move off, so the line gets the velocity at `stop`.

    began         tick of `stop`; None before it
    velocity_mps  mean velocity of the hand in the newest tick before it, shape (axes,)
    """

    __slots__ = ("_rate_hz", "began", "velocity_mps")

    def __init__(self, axes: int, rate_hz: float) -> None:
        self.began: int | None = None
        self._rate_hz = rate_hz
        self.velocity_mps: Sequence[float] = (0.0,) * axes

    def hold(self, tick: int) -> float:
        """Return the factor on the forward wave, from 1 down to 0."""
        return 1.0 if self.began is None else max(0.0, 1.0 - (tick - self.began) / (FADE_S * self._rate_hz))

    def over(self, tick: int, loop_s: float) -> bool:
        """Return whether the server knows the end of the fade. loop_s: measured loop of the line."""
        return self.began is not None and tick - self.began >= (FADE_S + min(loop_s, MOST_LOOP_S)) * self._rate_hz
