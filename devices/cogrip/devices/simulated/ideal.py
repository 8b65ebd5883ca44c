"""`sim:ideal`: mass and viscous damping, nothing else; exact position and velocity.

Per axis  m x'' + (b_d + B_h) x' + K_h x = (K_h x_int + B_h v_int + F_push) - F,  the right side held over each tick,
the hand's part at the tick's start (paper eq. 9 with the hand's impedance on the left; exact for held inputs, see
zero_order_hold).
"""

from collections.abc import Sequence

import msgspec

from cogrip.devices.device import IDEAL_SPEED_MPS, IDEAL_STIFFNESS_NPM, SLEW_NPS, Capability, Sample
from cogrip.devices.settings import Finite, NotNegative, Positive
from cogrip.devices.simulated.zero_order_hold import discretise
from cogrip.protocol.axes import PLACES

ADVISED_AT_HZ = 1024
"""The loop rate at which the advised damping holds: half of b T_c / m = 1, theory.md section 3.6."""


class IdealSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Query keys. x0_m: start of device and hand per axis, default 0 (or where a recording with origin=keep begins)."""

    mass_kg: Positive = 0.1
    damping_nspm: NotNegative = 0.0
    x0_m: tuple[Finite, ...] = ()


def capability(settings: IdealSettings, axes: int) -> Capability:
    """The record. The workspace is advice only: nothing stops an ideal device."""
    return Capability(
        family="sim", model="ideal", axes=axes, workspace_m=((-0.5, 0.5),) * axes, peak_force_n=100.0, continuous_force_n=100.0,
        stiffness_npm=IDEAL_STIFFNESS_NPM, damping_nspm=0.5 * settings.mass_kg * ADVISED_AT_HZ, slew_nps=SLEW_NPS,
        speed_mps=IDEAL_SPEED_MPS, resolution_m=0.0, apparent_mass_kg=settings.mass_kg, rate_hz=65_536, gives_velocity=True,
        own_damping_nspm=settings.damping_nspm,
    )  # fmt: skip


class IdealPlant:
    """Mass and damper per axis, axes alike and independent."""

    def __init__(self, settings: IdealSettings, axes: int) -> None:
        self._settings = settings
        self.position_m = [0.0] * axes
        self.velocity_mps = [0.0] * axes

    def open(self, rate_hz: int, stiffness_npm: float, damping_nspm: float, start_m: Sequence[float]) -> None:
        self._rate_hz = rate_hz
        self._hold(stiffness_npm, damping_nspm)
        self.position_m = list(start_m)
        self.velocity_mps = [0.0] * len(start_m)

    def _hold(self, stiffness_npm: float, damping_nspm: float) -> None:
        own = self._settings
        step = discretise(own.mass_kg, own.damping_nspm + damping_nspm, stiffness_npm, self._rate_hz)
        self._p, self._q, self._g, self._h, self._k = step.p, step.q, step.g, step.h, step.stiffness_npm

    def release(self) -> None:
        """See `Plant.release`."""
        self._hold(0.0, 0.0)

    def step(self, drive_n: Sequence[float], force_n: Sequence[float]) -> None:
        """One exact tick."""
        xs, vs, k = self.position_m, self.velocity_mps, self._k
        p, q, g, h = self._p, self._q, self._g, self._h
        if len(drive_n) == PLACES:  # as below, without a loop
            (ux, uy, uz), (fx, fy, fz), (x, y, z), (vx, vy, vz) = drive_n, force_n, xs, vs
            rx, ry, rz = ux - fx - k * x, uy - fy - k * y, uz - fz - k * z
            self.position_m = [x + p * vx + g * rx, y + p * vy + g * ry, z + p * vz + g * rz]
            self.velocity_mps = [q * vx + h * rx, q * vy + h * ry, q * vz + h * rz]
            return
        for i, u in enumerate(drive_n):
            x, v = xs[i], vs[i]
            r = u - force_n[i] - k * x
            xs[i] = x + p * v + g * r
            vs[i] = q * v + h * r

    def sense(self) -> Sample:
        """Exact position and velocity."""
        return Sample(tuple(self.position_m), tuple(self.velocity_mps))
