"""Rates of the two loops and their absolute deadlines, in integer nanoseconds."""

from typing import Annotated

import msgspec

NS_PER_S = 1_000_000_000

LEAST_DEVICE_HZ = 250  # lowest rate of a loop that gives force to a hand: a force is held for at most 4 ms

Hz = Annotated[int, msgspec.Meta(ge=1, le=20_000)]
DeviceHz = Annotated[int, msgspec.Meta(ge=LEAST_DEVICE_HZ, le=20_000)]


class RatesError(ValueError):
    """The two rates do not fit together."""


def misfit(device_hz: int, network_hz: int, key: str = "rates.device_hz") -> str:
    """Return why a frame has no whole number of device ticks, "" if it has. key: the setting of `device_hz`."""
    ratio, rest = divmod(device_hz, network_hz)
    if ratio >= 1 and not rest:
        return ""
    near = max(-(-LEAST_DEVICE_HZ // network_hz), round(device_hz / network_hz)) * network_hz
    why = f"{key} = {device_hz} is not a whole multiple of rates.network_hz = {network_hz}"
    return f"{why}; use for instance device_hz = {near}"


class Rates(msgspec.Struct, frozen=True, array_like=True):
    """One person's device loop and the room's network/object loop (P section III; theory section 2).

    Raises RatesError for two that do not fit.
    """

    device_hz: Hz
    network_hz: Hz

    def __post_init__(self) -> None:
        self.ticks_per_frame  # noqa: B018 (raises)

    @property
    def ticks_per_frame(self) -> int:
        """M: device ticks in one network frame. Raises RatesError unless it is a whole number of at least 1."""
        if why := misfit(self.device_hz, self.network_hz):
            raise RatesError(why)
        return self.device_hz // self.network_hz

    @property
    def tick_s(self) -> float:
        """T_c: period of the device loop [s]."""
        return 1.0 / self.device_hz

    @property
    def frame_s(self) -> float:
        """T_n: period of the network and object loop [s]."""
        return 1.0 / self.network_hz


def due_ns(t0_ns: int, index: int, rate_hz: int) -> int:
    """Return the due time of tick `index`: exact at any rate, never accumulated."""
    return t0_ns + index * NS_PER_S // rate_hz
