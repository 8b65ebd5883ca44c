"""Position and velocity of the hand, from the samples of a device.

A sample that no held device gives is not used, and a device without velocities has them observed. Where no sample comes, or
an older one than usual, the hand is taken to go on as it did (dead reckoning): the next sample corrects that. To stand still
and catch up in one tick would be a jump that never was, and a damper's energy goes with its square.
"""

from collections.abc import Sequence

from cogrip.client.hand.velocity import observer_for
from cogrip.client.safety.limiter import Safety
from cogrip.devices.device import Capability
from cogrip.devices.plausibility import JUMP, Plausibility
from cogrip.devices.sample import Sample
from cogrip.protocol.axes import PLACES
from cogrip.protocol.settings.rates import Rates

Position = tuple[float, ...] | None
RECKON_S = 12.0 / 1024.0  # time without a sample for which dead reckoning goes on


class HandMotion:
    """The hand as the ledger sees it: `latency_ticks` before the newest tick.

    position_m, velocity_mps  now, shape (axes,)
    start_m, start_mps        as they were before the last `update`
    begun                     whether there has been a sample that could be used
    """

    def __init__(self, capability: Capability, rates: Rates, safety: Safety, masses_kg: Sequence[float]) -> None:
        self._rate_hz, self._tick_s = float(rates.device_hz), rates.tick_s
        self._safety = safety
        self._reckon_ticks = round(RECKON_S * rates.device_hz)
        self._offset_m: tuple[float, ...] | None = None  # by which jumps have displaced the device's positions
        self._sampled = 0  # tick at which the newest sample was taken
        self.begun = False
        self.start_m = self.position_m = (0.0,) * capability.axes
        self.start_mps: Sequence[float] = self.position_m
        self.velocity_mps: Sequence[float] = self.position_m
        self.fit(capability, masses_kg)

    def fit(self, capability: Capability, masses_kg: Sequence[float]) -> None:
        """Set observer and age of samples by the device record. masses_kg: of each axis."""
        self._observer = observer_for(capability, self._tick_s, masses_kg)
        self.plausibility = Plausibility(capability, self._tick_s)
        self.latency_ticks = capability.latency_ticks

    def update(self, tick: int, elapsed: int, sample: Sample | None, force_n: Sequence[float]) -> Position:
        """Use the sample of `tick`, `elapsed` ticks after the one before. Return the position, None where it is not known.

        force_n: that the motors held in those ticks [N], shape (axes,)
        """
        position: Position = None
        velocity, taken, age, observer = self.velocity_mps, self._sampled, 0, self._observer
        if observer is not None:
            observer.hold(force_n, elapsed)
        if sample is not None and (wrong := self.plausibility.judge(tick, sample)):
            sample = self._refused(wrong, tick, sample)
        if sample is None:
            self._safety.absent(elapsed)
        else:
            position, reported, age = sample.position_m, sample.velocity_mps, sample.age_ticks
            here, taken = position, tick - age
            if self._offset_m is not None:
                position = tuple([at - offset for at, offset in zip(position, self._offset_m, strict=True)])
            if reported is not None:
                velocity = reported
            else:
                assert observer is not None
                velocity = observer.update(position, max(1, taken - self._sampled))
            if not self._safety.check(elapsed, here, velocity):
                if observer is not None:
                    observer.reset()
                position = None
        before = self.velocity_mps
        known = position
        if self.begun and (sample is None or position is None or age != self.latency_ticks):
            known = self._reckoned(tick, elapsed, sample, position, velocity)
        self.start_m, self.start_mps = self.position_m, before
        if known is not None:
            self.position_m = known
        if position is not None:
            self.velocity_mps, self._sampled = velocity, taken
            if not self.begun:
                self.begun, self.start_m = True, position
        return known

    def _refused(self, wrong: str, tick: int, sample: Sample) -> Sample | None:
        """Return None for an implausible sample; in a fault a jump sets a new reference, as no hand has moved so."""
        plausibility, safety = self.plausibility, self._safety
        safety.note(wrong)
        if plausibility.fault:
            safety.fail(plausibility.fault)
        if wrong != JUMP or safety.state != "fault":
            return None
        self._offset_m = tuple([at - here for at, here in zip(sample.position_m, self.position_m, strict=True)])
        plausibility.restart()
        plausibility.judge(tick, sample)
        return sample

    def _reckoned(
        self, tick: int, elapsed: int, sample: Sample | None, position_m: Position, velocity_mps: Sequence[float]
    ) -> Position:
        """Return where the hand was `latency_ticks` ago if it went on as it did; None after RECKON_S without a sample."""
        if self._safety.state == "fault":
            return position_m
        if sample is not None and position_m is not None:
            ticks = sample.age_ticks - self.latency_ticks
        elif tick - self._sampled > self.latency_ticks + self._reckon_ticks:
            return None
        else:
            position_m, velocity_mps, ticks = self.position_m, self.velocity_mps, elapsed
        step_s = ticks / self._rate_hz
        return tuple([place + step_s * speed for place, speed in zip(position_m, velocity_mps, strict=True)])


def work_and_velocity(
    force_n: Sequence[float], start_m: Sequence[float], end_m: Sequence[float], rate_hz: float
) -> tuple[float, list[float]]:
    """Return a hand's work against a force that was held from start to end [J], and its mean velocity [m/s], shape (axes,)."""
    if len(end_m) == PLACES:  # as below, without a loop
        (fx, fy, fz), (at_x, at_y, at_z), (x, y, z) = force_n, start_m, end_m
        dx, dy, dz = x - at_x, y - at_y, z - at_z
        return fx * dx + fy * dy + fz * dz, [dx * rate_hz, dy * rate_hz, dz * rate_hz]
    work, velocity = 0.0, []
    for axis, place in enumerate(end_m):
        step = place - start_m[axis]
        work += force_n[axis] * step
        velocity.append(step * rate_hz)
    return work, velocity
