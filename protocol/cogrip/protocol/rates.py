"""Rates of the two loops and their absolute deadlines, in integer nanoseconds."""

from typing import Annotated

import msgspec

NS_PER_S = 1_000_000_000

Hz = Annotated[int, msgspec.Meta(ge=1, le=20_000)]


class RatesError(ValueError):
    """The two rates do not fit together."""


class Rates(msgspec.Struct, frozen=True, array_like=True):
    """Device loop and network/object loop (P section III; theory section 2). Raises RatesError for two that do not fit."""

    device_hz: Hz
    network_hz: Hz

    def __post_init__(self) -> None:
        self.ticks_per_frame  # noqa: B018 (raises)

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
