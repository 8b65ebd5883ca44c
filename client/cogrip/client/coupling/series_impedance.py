"""A spring and a damper in series between hand and wave port, for a device that carries less than the impedance of the port.

Symbols, per axis: b impedance of the port [N s/m], r b what is rendered, 0 < r <= 1, y velocity of the hand and y_p of the port
[m/s], v returning wave [sqrt(W)], w (RELAX_RAD_S) ratio of spring and damper, z their deflection [m].

    F = r (b (xdot + w z) - sqrt(2b) v)      y_p = r (y + w z) + (1 - r) sqrt(2/b) v - F_cut / b      z' = y - y_p

It is r b for fast motion, b for slow, and does not creep. F_cut is what limits took from the law's force: the line does not see
it, and the deflection that it makes decays with w. r = 1, z = 0 is the plain port. See docs/device_port.md.
"""

from collections.abc import Sequence

RELAX_RAD_S = 100.0  # w, ratio of spring and damper
LEAST_DEFLECTION_M, MOST_DEFLECTION_M = 1e-9, 0.05
"""Bounds of a deflection: one below the first is dropped, and what slips beyond the second is not recovered."""


class SeriesImpedance:
    """Deflections of all axes; `deflected` says whether any is not 0."""

    __slots__ = ("_tick_s", "deflected", "deflection_m")

    def __init__(self, axes: int, tick_s: float) -> None:
        self._tick_s = tick_s
        self.deflected = False
        self.deflection_m = [0.0] * axes

    def reset(self) -> None:
        """Drop the deflection."""
        self.deflection_m, self.deflected = [0.0] * len(self.deflection_m), False

    def with_spring(self, velocity_mps: Sequence[float]) -> list[float]:
        """Return xdot + w z [m/s]."""
        return [v + RELAX_RAD_S * z for v, z in zip(velocity_mps, self.deflection_m, strict=True)]

    def port_velocity(
        self, velocity_mps: Sequence[float], wave: Sequence[float], impedance: float, per_wave: float, ratio: float,
        cut_n: Sequence[float] | None,
    ) -> list[float]:  # fmt: skip
        """Return y_p of a tick, and move the deflection by the rest of the hand's velocity. per_wave: (1 - r) sqrt(2/b)."""
        deflection, tick_s = self.deflection_m, self._tick_s
        behind, most = [], 0.0
        for axis, speed in enumerate(velocity_mps):
            port = ratio * (speed + RELAX_RAD_S * deflection[axis]) + per_wave * wave[axis]
            if cut_n is not None:
                port -= cut_n[axis] / impedance
            z = deflection[axis] + (speed - port) * tick_s
            deflection[axis] = z = min(max(z, -MOST_DEFLECTION_M), MOST_DEFLECTION_M)
            most = max(most, abs(z))
            behind.append(port)
        self.deflected = most > LEAST_DEFLECTION_M
        if not self.deflected:
            self.reset()
        return behind
