"""A hand that comes to rest where it began, so that every session ends in the same state.

symbols, per axis: x_h home [m]; s displacement from home that the hand intends [m]; f = drive - K_h x_h, its drive beyond
holding at home [N]; w weight of its motion: 1 before, then 1 - (10 z^3 - 15 z^4 + 6 z^5) over z in FADE_S, then 0

    intended  x_h + w s,  velocity  w ds/dt + dw/dt s        drive  K_h x_h + w f + B_h dw/dt s
"""

from __future__ import annotations

from collections.abc import Sequence

from cogrip.devices.simulated.hands import Hand
from cogrip.devices.simulated.simulated_device import SimulatedDevice
from cogrip.machine.rows import Row

FADE_S = 0.5


class RestingHand:
    """A `Hand`, already open, that moves until `rest_s` and holds at home [m] from rest_s + FADE_S on."""

    def __init__(self, hand: Hand, home_m: Sequence[float], rate_hz: int, rest_s: float) -> None:
        self.stiffness_npm = hand.stiffness_npm
        self.damping_nspm = hand.damping_nspm
        self._hand = hand
        self._home: Row = tuple(home_m)
        self._base = tuple(self.stiffness_npm * place for place in home_m)
        self._still: Row = (0.0,) * len(self._home)
        self._first = round(rest_s * rate_hz)
        self._fade = max(1, round(FADE_S * rate_hz))
        self._rate_hz = rate_hz

    def open(self, rate_hz: int, home_m: Row | None) -> Row:
        """See `Hand.open`. It is open: asked again it begins where it did."""
        return self._home

    def intended(self, tick: int) -> tuple[Row, Row]:
        """See `Hand.intended`."""
        if tick < self._first:
            return self._hand.intended(tick)
        w, slope = self._weight(tick)
        if w == 0.0:
            return self._home, self._still
        position, velocity = self._hand.intended(tick)
        away = [x - home for x, home in zip(position, self._home, strict=True)]
        return (
            tuple([home + w * s for home, s in zip(self._home, away, strict=True)]),
            tuple([w * speed + slope * s for speed, s in zip(velocity, away, strict=True)]),
        )

    def drive(self, tick: int) -> Sequence[float]:
        """See `Hand.drive`."""
        if tick < self._first:
            return self._hand.drive(tick)
        w, slope = self._weight(tick)
        if w == 0.0:
            return self._base
        position, _ = self._hand.intended(tick)
        damping = self.damping_nspm * slope
        parts = zip(self._hand.drive(tick), self._base, position, self._home, strict=True)
        return [base + w * (drive - base) + damping * (x - home) for drive, base, x, home in parts]

    def _weight(self, tick: int) -> tuple[float, float]:
        """Return w, and its slope [1/s]."""
        z = (tick - self._first) / self._fade
        if z >= 1.0:
            return 0.0, 0.0
        zz = z * z
        return 1.0 - zz * z * (10.0 + z * (6.0 * z - 15.0)), -30.0 * zz * (1.0 - z) ** 2 * self._rate_hz / self._fade


def let_rest(device: object, rate_hz: int, rest_s: float) -> Row:
    """Make the hand of an opened simulated device rest from `rest_s` on, and return its home [m].

    Raises TypeError for any other device.
    """
    if not isinstance(device, SimulatedDevice):
        raise TypeError(f"{device!r} is no simulated device: its hand cannot be made to rest")
    home = tuple(device.plant.position_m)
    device.hand = RestingHand(device.hand, home, rate_hz, rest_s)
    return home
