"""`sim:phantom`: like a Phantom Premium 1.0 (data sheet values): friction, encoders, motors that saturate, end stops.

One tick, each part conserving or losing energy (x, v position and velocity at its start, x+, v+ at its end; r, p, q, g, h as in
`zero_order_hold`; c Coulomb friction [N]):

1. motors: each axis gives at most the peak force.
2. step without friction, to the velocity v_f = q v + h r.
3. Coulomb friction, implicit: v+ = v_f brought towards 0 by at most h c; that is the friction force f = (v_f - v+) /
   h, |f| <= c, held over the tick. With v = 0 and |r| <= c nothing moves: it sticks, to the bit. Where the motion
   turns within the tick, the held f could push along the displacement and so do work; then the displacement is the
   free one and only the velocity is reduced. Either way the friction's work is <= 0: it is -f dx with f dx >= 0, or a
   loss of kinetic energy alone.
4. end stops, inelastic: past the stop the position is the stop and the velocity 0.

The encoder reads whole counts of resolution_m; it has no velocity.
"""

from collections.abc import Sequence

import msgspec

from cogrip.devices.device import GRAVITY_MPS2, SLEW_NPS, SPEED_MPS, Capability, DeviceError, Sample
from cogrip.devices.settings import Finite, NotNegative, Positive
from cogrip.devices.simulated.ideal import ADVISED_AT_HZ
from cogrip.devices.simulated.zero_order_hold import discretise

WORKSPACE_M = ((-0.127, 0.127), (-0.089, 0.089), (-0.0635, 0.0635))
"""254 x 178 x 127 mm, centred."""


class PhantomSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Query keys. x0_m: start of device and hand per axis, default 0 (or where a recording with origin=keep begins).

    handle_mass_kg is held up by nobody: its weight pulls the third axis down.
    slew_nps and speed_mps only state a limit in the capability record: the data sheet names none, so they are ours.
    """

    mass_kg: Positive = 0.075
    damping_nspm: NotNegative = 0.0
    friction_n: NotNegative = 0.04
    resolution_m: NotNegative = 3e-5
    peak_force_n: Positive = 8.5
    slew_nps: Positive = SLEW_NPS
    speed_mps: Positive = SPEED_MPS
    handle_mass_kg: NotNegative = 0.0
    x0_m: tuple[Finite, ...] = ()


def capability(settings: PhantomSettings, axes: int) -> Capability:
    """The record: 1.4 N continuous; 1000 N/m advised, as CHAI3D does for the Desktop and the Premium 3.0."""
    return Capability(
        family="sim", model="phantom", axes=axes, workspace_m=WORKSPACE_M[:axes], peak_force_n=settings.peak_force_n,
        continuous_force_n=min(1.4, settings.peak_force_n), stiffness_npm=1000.0,
        damping_nspm=0.5 * settings.mass_kg * ADVISED_AT_HZ, slew_nps=settings.slew_nps, speed_mps=settings.speed_mps,
        resolution_m=settings.resolution_m, apparent_mass_kg=settings.mass_kg, rate_hz=8192, gives_velocity=False,
        own_damping_nspm=settings.damping_nspm, own_friction_n=settings.friction_n, handle_mass_kg=settings.handle_mass_kg,
    )  # fmt: skip


class PhantomPlant:
    """The machine per axis, axes alike but for their stops. `saturated` counts axis-ticks of clipped force."""

    def __init__(
        self, settings: PhantomSettings, axes: int, stops_m: Sequence[tuple[float, float]] = WORKSPACE_M
    ) -> None:
        self._settings = settings
        self._stops = stops_m[:axes]
        self.position_m = [0.0] * axes
        self.velocity_mps = [0.0] * axes
        self.saturated = 0

    def open(self, rate_hz: int, stiffness_npm: float, damping_nspm: float, start_m: Sequence[float]) -> None:
        """See `Plant.open`. Raises DeviceError where a tick is too long for the mass on the hand's spring."""
        s = self._settings
        self._rate_hz = rate_hz
        if self._hold(stiffness_npm, damping_nspm) <= 0.0:
            raise DeviceError(
                f"sim:phantom: rate_hz={rate_hz} is below two ticks a swing of mass_kg={s.mass_kg} on"
                f" hand_stiffness_npm={stiffness_npm}; raise the rate or the mass"
            )
        self._friction, self._peak = s.friction_n, s.peak_force_n
        self._weight = [0.0, 0.0, s.handle_mass_kg * GRAVITY_MPS2][: len(self._stops)]
        self.position_m = list(start_m)
        self.velocity_mps = [0.0] * len(start_m)
        self.saturated = 0

    def _hold(self, stiffness_npm: float, damping_nspm: float) -> float:
        """Set the step of a tick with a hand of this impedance. Return h."""
        own = self._settings
        step = discretise(own.mass_kg, own.damping_nspm + damping_nspm, stiffness_npm, self._rate_hz)
        self._p, self._q, self._g, self._h, self._k = step.p, step.q, step.g, step.h, step.stiffness_npm
        return step.h

    def release(self) -> None:
        """See `Plant.release`."""
        self._hold(0.0, 0.0)

    def step(self, drive_n: Sequence[float], force_n: Sequence[float]) -> None:
        """One tick, parts 1 to 4 above."""
        xs, vs, k, peak, c = self.position_m, self.velocity_mps, self._k, self._peak, self._friction
        p, q, g, h, weight = self._p, self._q, self._g, self._h, self._weight
        for i, (low, high) in enumerate(self._stops):
            x, v, force, drive, load = xs[i], vs[i], force_n[i], drive_n[i], weight[i]
            if force > peak or force < -peak:
                force = peak if force > 0.0 else -peak
                self.saturated += 1
            r = drive - force - k * x - load
            if v != 0.0 or r > c or r < -c:
                v_free = q * v + h * r
                f = v_free / h
                f = c if f > c else -c if f < -c else f
                dx = p * v + g * (r - f)
                if dx * f < 0.0:
                    dx = p * v + g * r
                x += dx
                v = 0.0 if -c < f < c else v_free - h * f
                if x > high:
                    x, v = high, 0.0
                elif x < low:
                    x, v = low, 0.0
                xs[i], vs[i] = x, v

    def sense(self) -> Sample:
        """The encoders' counts in metres; no velocity."""
        d = self._settings.resolution_m
        if d == 0.0:
            return Sample(tuple(self.position_m), None)
        return Sample(tuple([(x / d + 0.5) // 1.0 * d for x in self.position_m]), None)
