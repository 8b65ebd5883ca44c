"""Rates of the two loops and their absolute deadlines, in integer nanoseconds."""

import msgspec

NS_PER_S = 1_000_000_000


class RatesError(ValueError):
    """The two rates do not fit together."""


class Rates(msgspec.Struct, frozen=True, array_like=True):
    """Device loop and network/object loop (P section III; theory section 2)."""

    device_hz: int
    network_hz: int

    @property
    def ticks_per_frame(self) -> int:
        """M: device ticks in one network frame. Raises RatesError unless it is a whole number of at least 1."""
        ratio, rest = divmod(self.device_hz, self.network_hz)
        if rest or ratio < 1:
            near = max(1, round(self.device_hz / self.network_hz)) * self.network_hz
            raise RatesError(
                f"rates.device_hz = {self.device_hz} is not a whole multiple of rates.network_hz = {self.network_hz}; "
                f"use for instance device_hz = {near}"
            )
        return ratio

    @property
    def tick_s(self) -> float:
        """T_c: period of the device loop [s]."""
        return 1.0 / self.device_hz

    @property
    def frame_s(self) -> float:
        """T_n: period of the network and object loop [s]."""
        return 1.0 / self.network_hz


def due_ns(t0_ns: int, index: int, rate_hz: int) -> int:
    """When tick `index` is due: exact at any rate, never accumulated."""
    return t0_ns + index * NS_PER_S // rate_hz
