"""A device as a loop holds it: opened, then read and written at each tick."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import pytest

from cogrip.devices.device import DeviceError
from cogrip.devices.registry import make

RATE_HZ = 1024


def opened(address: str, axes: int = 1, rate_hz: int = RATE_HZ, **defaults: Any) -> Any:
    """Return the device at this address, open."""
    device = make(address, axes=axes, **defaults)
    device.open(rate_hz)
    return device


def hold(
    device: Any, ticks: int | range, force_n: Sequence[float] | Callable[[int], Sequence[float]] = ()
) -> list[Any]:
    """Return the samples of these ticks, at each of which this force is written: none, one, or a function of the tick."""
    force_n = force_n or (0.0,) * device.capability.axes
    samples = []
    for tick in range(ticks) if isinstance(ticks, int) else ticks:
        samples.append(device.read(tick))
        device.write(force_n(tick) if callable(force_n) else force_n)
    return samples


@contextmanager
def refused(*words: str) -> Iterator[None]:
    """Expect a DeviceError that has all of these words."""
    with pytest.raises(DeviceError) as caught:
        yield
    assert [each for each in words if each not in str(caught.value)] == [], caught.value
