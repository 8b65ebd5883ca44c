"""What the couplings have in common whose newest message wins: virtual coupling and power variables."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from math import inf
from typing import Generic, TypeVar

from cogrip.devices.device import Capability
from cogrip.protocol.accounts import LinkCount, PlayoutAccount
from cogrip.protocol.latest_state import StateReceiver
from cogrip.protocol.messages import Power, State

M = TypeVar("M", State, Power)


class LatestStateCoupling(ABC, Generic[M]):
    """Same calls as WaveCoupling. `forward`, `returning` and `sent` stay zero: there are no waves.

    A message that is missing leaves no gap: the last one stands.
    """

    gap = played = implausible = False

    def __init__(self, axes: int) -> None:
        self.carried_nspm = inf  # damping that the device renders at most
        self.local_n: Sequence[float] = (0.0,) * axes  # the part of the law that follows the hand's own motion
        self.reduced = False  # whether less than the settings ask for is rendered now
        self.gain = 1.0  # of the ramp that the force goes through
        self._peak_n = inf  # the largest force of the device
        self._lag_s = 0.0  # by which its damper is late
        self.cut_n: Sequence[float] | None = None  # what limits took from the force that is held now
        self._receiver: StateReceiver[M] = StateReceiver()
        self._number = -1
        self.forward = self.returning = self.sent = (0.0,) * axes
        self.object_state: tuple[float, ...] = (0.0,) * (2 * axes)

    def fit(self, record: Capability, lag_s: float) -> None:
        """Go by this device, whose damper acts late by `lag_s`."""
        self._peak_n, self._lag_s = record.peak_force_n, lag_s

    @property
    @abstractmethod
    def given_j(self) -> float:
        """Energy that the other end gave this one, less what it took."""

    @property
    def stored_j(self) -> float:
        """Energy kept here of all that the other end gave."""
        return 0.0

    @property
    def given_border_j(self) -> float:
        return self.given_j

    @property
    def newest(self) -> int:
        """Number of the newest frame heard of; -1 before the first."""
        return self._receiver.newest

    def lost(self) -> int:
        """Frames from the server that were lost so far."""
        return self._receiver.lost

    @property
    def playout_frames(self) -> None:
        """There is no playout."""

    def playout_account(self) -> PlayoutAccount | None:
        """There is no playout."""
        return None

    def count(self) -> LinkCount:
        return self._receiver.count()

    def loop_frames(self) -> float | None:
        """The loop that was measured last: frames from a message to the frame in which its answer is applied."""
        return None
