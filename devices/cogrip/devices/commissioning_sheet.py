"""Sheet of a commissioned device: what was measured of it, when and by whom, signed so that a change of it is seen."""

import hashlib
import hmac

import msgspec

from cogrip.devices.device import Capability

FORMAT = 1
REST, PUSH, QUIET, LOST = "rest", "push", "quiet", "lost"


class Step(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One measurement. faults: what is not as the record says, each with what to look at.

    what        REST, PUSH, QUIET, or LOST: a device that was lost
    share       of the peak force
    gain        motion along the axis by that of the record's mass
    drag_n      friction and damping at the mean speed of the push
    late_ticks  by which samples are later than they say
    """

    what: str
    share: float
    force_n: float
    found: str
    faults: tuple[str, ...] = ()
    axis: str = ""
    gain: float | None = None
    late_ticks: int | None = None
    drag_n: float | None = None
    travel_m: float | None = None


class Sheet(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All steps of one device. unit: digest of record and calibration (`unit_of`); ended: why it ended early, "" at its end."""

    device: str
    unit: str
    by: str
    at: str  # date and time, ISO 8601, UTC
    software: str
    steps: tuple[Step, ...]
    ended: str = ""
    format: int = FORMAT
    signature: str = ""

    @property
    def faults(self) -> tuple[str, ...]:
        """Return all that was found wrong."""
        return tuple([fault for step in self.steps for fault in step.faults])

    @property
    def passed(self) -> bool:
        """Return whether all steps were taken, and nothing was wrong."""
        return not self.faults and not self.ended and bool(self.steps) and self.steps[-1].what == QUIET

    @property
    def tried_n(self) -> float:
        """Return the largest force that was pushed, and moved the device as it should [N]; 0 for none."""
        return max((step.force_n for step in self.steps if step.gain is not None and not step.faults), default=0.0)

    @property
    def text(self) -> str:
        """Return the outcome in one line."""
        when = f"on {self.at[:10]} by {self.by}"
        if self.faults:
            return f"commissioned {when}, and NOT fit: {'; '.join(dict.fromkeys(self.faults))}"
        if not self.passed:
            return f"commissioned {when} up to {self.tried_n:.3g} N only: {self.ended or 'it did not come to its end'}"
        return f"commissioned {when}, tried with up to {self.tried_n:.3g} N: as its record says"

    def signed(self, key: bytes) -> "Sheet":
        """Return the sheet with its signature."""
        return msgspec.structs.replace(self, signature=_mac(self, key))

    def is_genuine(self, key: bytes) -> bool:
        """Return whether nobody has changed it since it was signed with this key."""
        return hmac.compare_digest(self.signature, _mac(self, key))


def unit_of(record: Capability, calibration: bytes) -> str:
    """Return a digest of what a sheet is true of: a device's record, and the contents of its calibration's file."""
    said = msgspec.json.encode([record, hashlib.sha256(calibration).hexdigest()], order="deterministic")
    return hashlib.sha256(said).hexdigest()[:16]


def _mac(sheet: Sheet, key: bytes) -> str:
    unsigned = msgspec.structs.replace(sheet, signature="")
    return hmac.new(key, msgspec.json.encode(unsigned, order="deterministic"), hashlib.sha256).hexdigest()
