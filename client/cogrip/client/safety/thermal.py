"""Thermal limit of the force: it falls as the winding of a motor warms (I^2 t).

Symbols: F force given [N], F_c continuous force of the record [N], F_p peak [N], T tick [s], tau TIME_CONSTANT_S,
t_f FADE_S [s], r = (F / F_c)^2 heating, h the winding's rise over that of F_c held for ever (0 cold, 1 as warm as it may be).

To first order tau h' = r - h: h <= 1 says that the mean square of F, weighted by exp(-t / tau) / tau, is at most F_c^2. The
limit keeps that by letting the margin 1 - h shrink no faster than with the time constant t_f:

    h' <= (1 - h) / t_f    <=>    F^2 <= F_c^2 (1 + (1 - h) g),    g = tau / t_f - 1

In ticks, with the force held, h += a (r - h), a = 1 - exp(-T / tau), is exact; h stays <= 1 as a (1 + g) <= 1, that is
T <= t_f about. docs/security.md says what that comes to.
"""

from math import exp, inf, sqrt

TIME_CONSTANT_S = 60.0
"""tau. No maker of these arms states one. Windings of motors of this size warm within 10 to 40 s, their housings within ten
minutes, and a continuous force is rated for both together; 60 s lets 6 times F_c pass for 1.7 s, 3 times for 7 s."""
FADE_S = 0.5
WARN_SHARE = 0.5  # The motors are warm from this fraction on of the rise at which the limit begins to act.
LEAST_SHARE = 0.4
"""Least rise that WARN_SHARE is taken of: the true one is lower where the peak is more than 8.5 times F_c."""
CALM_SHARE = 0.9  # The motors are no longer warm below this fraction of the rise at which they get warm.


class ThermalLimit:
    """`limit_n` is what may be given now; `enter` once a tick what was given. `warm`: the limit is near, or acts."""

    def __init__(self, tick_s: float, peak_n: float, continuous_n: float) -> None:
        self._share = 1.0 - exp(-tick_s / TIME_CONSTANT_S)
        self._slope = TIME_CONSTANT_S / FADE_S - 1.0
        self.rise = 0.0  # h
        self.warm = False
        self.set_limits(peak_n, continuous_n)

    def set_limits(self, peak_n: float, continuous_n: float) -> None:
        """Set peak and continuous force of the device record; the rise of the winding stays."""
        self._peak_n, self._square = peak_n, continuous_n * continuous_n
        excess = peak_n * peak_n / self._square - 1.0
        self._acts_from = 1.0 - excess / self._slope if excess > 0.0 else inf  # of h
        self._warm_from = WARN_SHARE * max(LEAST_SHARE, self._acts_from)
        self.limit_n = self._limit()

    def enter(self, square: float) -> None:
        """Heat the winding for a tick by a force of this square [N^2]."""
        self.rise = rise = self.rise + self._share * (square / self._square - self.rise)
        self.limit_n = self._peak_n if rise <= self._acts_from else self._limit()
        self.warm = rise > (CALM_SHARE * self._warm_from if self.warm else self._warm_from)

    def correct(self, entered: float, square: float) -> None:
        """Replace the square that was entered last by the one of the force that acted [N^2]."""
        self.rise += self._share * (square - entered) / self._square
        self.limit_n = self._limit()

    def _limit(self) -> float:
        if self.rise <= self._acts_from:
            return self._peak_n
        return sqrt(self._square * (1.0 + max(0.0, 1.0 - self.rise) * self._slope))
