"""Simulated hand that waits until everybody holds on (`task.together`)."""

from collections.abc import Callable

from cogrip.devices.simulated.simulated_device import SimulatedDevice

MOST_WAIT_S = 30.0  # longest wait that a session's time does not count


class WaitingHand:
    """Begins the hand of a device that is open; None where nobody waits. ticks: that a session's time does not count."""

    def __init__(self, device: SimulatedDevice | None, rate_hz: int, say: Callable[[str], None]) -> None:
        self._device = device
        self._say = say
        self.ticks = 0
        if device is not None:
            device.wait()
            self.ticks = round(MOST_WAIT_S * rate_hz)
            say("the hand waits until everybody holds on")

    def poll(self, tick: int, everybody: bool) -> None:
        """Begin once everybody holds on."""
        if everybody and self._device is not None:
            self._device.begin()
            self._device = None
            self.ticks = min(self.ticks, tick)
            self._say("everybody holds on: the hand begins")
