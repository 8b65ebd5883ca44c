"""Impedance that a device carries now: that of its record, and less after fast turns of the local force.

A passive force can still oscillate at a real hand, so a coupling renders at most this. docs/device_port.md has measurements.
"""

from collections.abc import Sequence
from math import exp

from cogrip.client.hand.velocity import largest_impedance
from cogrip.client.safety.oscillation import OscillationDetector
from cogrip.devices.device import Capability

BACKOFF_FACTOR = 0.5  # factor on the impedance at each turn of a train of fast turns (`OscillationDetector`)
RETRY_FRACTION = 0.8
"""Bound of the impedance after a train of fast turns, as a fraction of what it was when the train began."""
RECOVERY_S = 2.0  # time in which the impedance rises by a factor of e
RETRY_RECOVERY_S = 60.0  # time in which the bound of RETRY_FRACTION rises by a factor of e
LEAST_FRACTION = 0.02  # least impedance, as a fraction of that of the record
TRAIN_PAUSE_S = 0.5  # time without a fast turn after which the next one begins a train


class CarriedImpedance:
    """Impedance that may be rendered on a device of this record.

    nspm         now [N s/m]
    record_nspm  by the record alone (`largest_impedance`)
    detector     what found the turns
    """

    __slots__ = (
        "_growth",
        "_last_turn",
        "_pause_ticks",
        "_retry_growth",
        "_retry_nspm",
        "detector",
        "nspm",
        "record_nspm",
    )

    def __init__(self, axes: int, tick_s: float, frame_ticks: int) -> None:
        self._growth, self._retry_growth = exp(tick_s / RECOVERY_S), exp(tick_s / RETRY_RECOVERY_S)
        self._pause_ticks = round(TRAIN_PAUSE_S / tick_s)
        self._last_turn = -self._pause_ticks - 1  # tick of the last turn of a train
        self.detector = OscillationDetector(axes, tick_s, frame_ticks)
        self.nspm = self.record_nspm = self._retry_nspm = 0.0

    def set_record(self, record: Capability, tick_s: float) -> None:
        """Begin anew with this record."""
        self.nspm = self._retry_nspm = self.record_nspm = largest_impedance(record, tick_s).impedance_nspm

    def adapt(
        self, tick: int, force_n: Sequence[float], clipped: bool, local_n: Sequence[float], absorbs: bool
    ) -> None:
        """Add the force of a tick, as `DevicePort.watch` has it."""
        carried, record, detector = self.nspm, self.record_nspm, self.detector
        if carried < record:  # as it would be at the record's impedance: less impedance must not hide an oscillation
            local_n = [record / carried * local for local in local_n]
        turns = detector.add(force_n, clipped, local_n)
        if turns or (absorbs and detector.reverses):
            if tick - self._last_turn > self._pause_ticks:  # the first of its train
                self._retry_nspm = max(LEAST_FRACTION * record, RETRY_FRACTION * carried)
            self._last_turn = tick
            self.nspm = max(LEAST_FRACTION * record, BACKOFF_FACTOR * carried)
        elif carried < record:
            self._retry_nspm = min(record, self._retry_growth * self._retry_nspm)
            self.nspm = min(self._retry_nspm, self._growth * carried)

    def come_back_with_less(self) -> None:
        """Let a force that was released for its oscillation return lower."""
        self.nspm = self._retry_nspm = max(LEAST_FRACTION * self.record_nspm, BACKOFF_FACTOR * self.nspm)
