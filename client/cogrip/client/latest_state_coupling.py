"""Base of the couplings whose newest message wins: virtual coupling and power variables."""

from math import inf
from typing import TypeVar

from cogrip.client.coupling import Coupling
from cogrip.devices.device import Capability
from cogrip.protocol.accounts import LinkCount
from cogrip.protocol.latest_state import StateReceiver
from cogrip.protocol.messages import Power, State
from cogrip.protocol.settings import SeatSettings

M = TypeVar("M", State, Power)


class LatestStateCoupling(Coupling[M]):
    """A message that is missing leaves no gap: the last one stands. There is no jitter buffer."""

    def __init__(self, seat: SeatSettings) -> None:
        super().__init__(seat)
        self._receiver: StateReceiver[M] = StateReceiver()
        self._number = -1
        self._peak_n, self._lag_s = inf, 0.0  # of the device

    def fit(self, record: Capability, lag_s: float) -> None:
        self._peak_n, self._lag_s = record.peak_force_n, lag_s

    @property
    def newest(self) -> int:
        return self._receiver.newest

    def lost(self) -> int:
        return self._receiver.lost

    def count(self) -> LinkCount:
        return self._receiver.count()
