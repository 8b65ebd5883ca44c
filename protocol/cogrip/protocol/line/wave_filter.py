"""A one-pole low-pass filter of a wave, passive over every horizon, for any lengths that its inputs are held (theory 7.2).

Symbols, per axis: x input and y output, held for h ticks [sqrt(W)]; S time constant [ticks]; C content [sqrt(W) ticks]

    y = (C + h x) / (S + h)        C <- C + h (x - y) = S y        h (x^2 - y^2) = (C_after^2 - C^2) / S + h (1 + h/S) (x - y)^2

The last line is exact: what comes in goes out, is stored, or is dissipated. The outputs so far add up to the inputs less C, so
at rest the filter adds exactly S ticks to the loop.
"""

from math import sqrt

from cogrip.machine.rows import Row


class WaveFilter:
    """Filter of all axes. lag_ticks: S, 0 for none."""

    __slots__ = ("_content", "_newest", "lag_ticks")

    def __init__(self, axes: int, lag_ticks: float) -> None:
        self.lag_ticks = lag_ticks
        self._content = [0.0] * axes
        self._newest: tuple[Row, Row] = (0.0,) * axes, (0.0,) * axes  # input and output

    def step(self, wave: Row, ticks: int) -> Row:
        """Return the output for an input that both are held for `ticks` ticks."""
        lag = self.lag_ticks
        if not lag:
            return wave
        gain = 1.0 / (lag + ticks)
        out = tuple([gain * (held + ticks * x) for held, x in zip(self._content, wave, strict=True)])
        self._newest = wave, out
        self._hold(ticks)
        return out

    def cut(self, ticks: int) -> None:
        """Take the newest output back for the last `ticks` ticks of its time: energy falls along with the time."""
        if self.lag_ticks:
            self._hold(-ticks)

    def _hold(self, ticks: int) -> None:
        self._content = [held + ticks * (x - y) for held, x, y in zip(self._content, *self._newest, strict=True)]

    def retune(self, lag_ticks: float, ratio: float) -> list[float]:
        """Set S, on a line whose impedance becomes `ratio` times what it was; return what they leave out [sqrt(W) ticks].

        C^2 / S never grows (theory 7.3): a longer filter keeps C, a shorter one sqrt(S'/S) of it. A wave w means the force
        sqrt(2b) w at rest, so C is made smaller where b grows; the displacement that it means asks for sqrt(ratio) C.
        """
        kept = min(1.0, 1.0 / sqrt(ratio)) * (min(1.0, sqrt(lag_ticks / self.lag_ticks)) if self.lag_ticks else 0.0)
        left = [(sqrt(ratio) - kept) * held for held in self._content]
        self._content = [kept * held for held in self._content]
        self.lag_ticks = lag_ticks
        return left
