"""A driver and the firmware it drives, in virtual time: what a session in the laboratory holds as `emulated:vintage`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cogrip.devices.arm.pose import Calibration, OwnLosses
from cogrip.devices.device import Capability, Device, Sample
from cogrip.devices.emulated.firmware import Firmware
from cogrip.protocol.settings.rates import due_ns


@dataclass(frozen=True, slots=True)
class Planned:
    """A fault that comes by itself: `verb@begin_s+seconds`."""

    verb: str
    begin_s: float
    seconds: float


class EmulatedDevice:
    """See `Device`. The firmware's time is that of the ticks; `firmware` takes a person's verbs."""

    def __init__(
        self, driver: Device, firmware: Firmware, planned: Sequence[Planned] = (), store: Notebook | None = None
    ) -> None:
        self.driver = driver
        self.store = store
        self.firmware = firmware
        self._planned = sorted(planned, key=lambda fault: fault.begin_s)
        self._rate_hz = 0

    @property
    def capability(self) -> Capability:
        return self.driver.capability

    @property
    def counts(self) -> Mapping[str, int]:
        return self.driver.counts

    @property
    def force_n(self) -> tuple[float, ...]:
        """Return what the motors load the hand with [N], without what they hold of the arm's own weight."""
        mechanics = self.firmware.mechanics
        fraction = getattr(self.driver, "weight_fraction", 0.0)
        load = [
            -motors - fraction * weight for motors, weight in zip(mechanics.force_n, mechanics.weight_n, strict=True)
        ]
        return tuple(load)[: self.capability.axes]

    @property
    def position_m(self) -> tuple[float, ...]:
        """True position of the tip [m]."""
        return self.firmware.mechanics.body.position_m[: self.capability.axes]

    def open(self, rate_hz: int) -> None:
        self.driver.open(rate_hz)
        self._rate_hz = rate_hz

    def read(self, tick: int) -> Sample | None:
        if self._rate_hz:
            now_ns = due_ns(0, tick, self._rate_hz)
            self._let_fail(now_ns)
            self.firmware.advance(now_ns)
        return self.driver.read(tick)

    def _let_fail(self, now_ns: int) -> None:
        while self._planned and self._planned[0].begin_s * 1e9 <= now_ns:
            fault = self._planned.pop(0)
            self.firmware.advance(round(fault.begin_s * 1e9))
            self.firmware.fault(fault.verb, fault.seconds)

    def write(self, force_n: Sequence[float]) -> Sequence[float] | None:
        return self.driver.write(force_n)

    def close(self) -> None:
        self.driver.close()


class Notebook:
    """Calibrations in memory. See `Store`."""

    def __init__(self) -> None:
        self._kept: dict[str, Calibration] = {}
        self._losses: dict[str, OwnLosses] = {}

    def find(self, device: str) -> Calibration | None:
        return self._kept.get(device)

    def keep(self, calibration: Calibration) -> None:
        self._kept[calibration.device] = calibration

    def find_losses(self, device: str) -> OwnLosses | None:
        return self._losses.get(device)

    def keep_losses(self, losses: OwnLosses) -> None:
        self._losses[losses.device] = losses
