"""Buttons, orientation and gripper of a device, as its samples give them, on their way to the server."""

from collections import Counter
from math import inf

from cogrip.devices.device import Capability, Sample
from cogrip.protocol.wire.button_edges import EdgeSender
from cogrip.protocol.wire.handle import MOST_AT_ONCE, Handle, is_unit

BEYOND = 0.1  # distance by which a reading may lie outside a gripper's range, as a fraction of the range
MOST_M = 1.0  # largest opening that a message can say (SPEC 3.6)


class HandleReader:
    """Newest values and unacknowledged edges of one handle.

    A reading that cannot be, no unit quaternion or an opening far beyond the record's, is counted, and the last one stands.

    edges     of its buttons
    dropped   counts by reason, of the session
    """

    def __init__(self, dropped: Counter[str]) -> None:
        self.edges = EdgeSender(dropped)
        self.dropped = dropped
        self._mask = 0
        self._turns = False
        self._least_m, self._most_m = inf, -inf
        self._orientation: tuple[float, ...] | None = None
        self._grip_m: float | None = None
        self._edged = False  # by an edge that was in no message yet
        self._at_once = MOST_AT_ONCE  # messages that may be sent before the next frame's

    def fit(self, record: Capability) -> None:
        """Go by this record: what it does not have is not read."""
        self._mask = (1 << record.buttons) - 1
        self._turns = record.gives_orientation
        if record.grip_m is not None:
            closed, opened = record.grip_m
            beyond = BEYOND * (opened - closed)
            self._least_m, self._most_m = max(-MOST_M, closed - beyond), min(MOST_M, opened + beyond)

    def read(self, sample: Sample, tick: int) -> None:
        """Take in a sample, read at a tick."""
        if self.edges.update(sample.buttons & self._mask, tick):
            self._edged = True
        turned, grip_m = sample.orientation, sample.grip_m
        if turned is not None and self._turns:
            if is_unit(turned):
                self._orientation = turned
            else:
                self.dropped["implausible handle"] += 1
        if grip_m is not None:
            if self._least_m <= grip_m <= self._most_m:
                self._grip_m = grip_m
            elif self._least_m < inf:
                self.dropped["implausible handle"] += 1

    def message(self, tick: int) -> Handle | None:
        """Return what is sent with a frame, at a tick; None where there is nothing to say."""
        self._edged, self._at_once = False, MOST_AT_ONCE
        return self.edges.message(tick, self._orientation, self._grip_m)

    def message_at_once(self, tick: int) -> Handle | None:
        """Return what is sent at a tick within a frame: None where no button has an edge to tell at once."""
        if not self._edged or not self._at_once:
            return None
        self._edged = False
        self._at_once -= 1
        return self.edges.message(tick, self._orientation, self._grip_m)


def has_handle(record: Capability) -> bool:
    """Return whether a device has buttons, an orientation or a gripper."""
    return bool(record.buttons or record.gives_orientation or record.grip_m)
