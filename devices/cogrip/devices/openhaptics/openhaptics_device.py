"""The loop's side of a device that the HD library's servo thread drives."""

from collections.abc import Callable, Sequence
from math import hypot, isfinite
from typing import Protocol

from cogrip.devices.device import Capability, DeviceError, Sample
from cogrip.devices.driver import Driver
from cogrip.devices.openhaptics.mailbox import ZERO, Mailbox
from cogrip.devices.openhaptics.models import ALL_BUTTONS, Facts, lowered

OK, NEEDS_UPDATE, NEEDS_MANUAL_INPUT = 0x5000, 0x5001, 0x5002
ENCODER_RESET, AUTO, INKWELL = 1, 2, 4
TRIES = 200  # most looks at the calibration; each takes a frame, a millisecond

BY_HAND = {
    AUTO: "move the arm slowly through its workspace",
    INKWELL: "put the stylus into the inkwell and leave it there",
    ENCODER_RESET: "bring all links to right angles and reset its encoders with the vendor's program",
}


class HdDevice(Protocol):
    """A device that the library has given us. Verbs raise DeviceError."""

    where: str

    def calibration(self) -> int: ...
    def calibration_styles(self) -> int: ...
    def update_calibration(self, style: int) -> None: ...
    def facts(self) -> Facts: ...
    def start(self) -> None:
        """Frames with forces from now on."""

    def close(self) -> None:
        """Zero force, then let go. Twice does nothing."""


def calibrate(link: HdDevice) -> None:
    """Have the library calibrate the arm as far as it can on its own. Raises DeviceError where a hand is needed.

    needs update --auto or inkwell--> update, ask again        needs manual input --> the user's turn        ok --> go on

    An encoder reset is never done here: it declares whatever pose the arm is in to be the home pose.
    """
    styles = link.calibration_styles()
    style = next((each for each in (AUTO, INKWELL) if styles & each), 0)
    state = link.calibration()
    for _ in range(TRIES):
        if state == OK:
            return
        if state != NEEDS_UPDATE or not style:
            break
        link.update_calibration(style)
        state = link.calibration()
    what = {NEEDS_UPDATE: "needs to be calibrated", NEEDS_MANUAL_INPUT: "needs to be calibrated by hand"}.get(
        state, f"is in an unknown state of calibration (0x{state:x})"
    )
    raise DeviceError(f"{link.where}: {what}: {BY_HAND[style or ENCODER_RESET]}, then open it again")


class OpenHapticsDevice(Driver):
    """See `Device`. `connect` gives the link of a mailbox; `record` holds until the device is open and may lower it."""

    def __init__(self, where: str, record: Capability, stated: str, connect: Callable[[Mailbox], HdDevice]) -> None:
        super().__init__(where, record.axes)
        self.capability = record
        self._record = record
        self._stated = stated
        self._connect = connect
        self._rest = ZERO[record.axes :]
        self._mailbox = Mailbox(self._counts)

    def open(self, rate_hz: int) -> None:
        """Raises DeviceError also for a device of another model, and before it is calibrated."""
        self._check_open(rate_hz, self._record)
        self._mailbox = Mailbox(self._counts)
        link = self._connect(self._mailbox)
        try:
            self.capability = lowered(self._record, link.facts(), self._stated, self._where)
            calibrate(link)
            link.start()
        except BaseException:
            link.close()
            raise
        self._open, self._link, self._tick, self._seen = True, link, 0, 0

    def read(self, tick: int) -> Sample | None:
        """None until the servo has had another frame."""
        self._check_read(tick)
        if self._mailbox.lost:
            raise DeviceError(self._mailbox.lost)
        news = self._mailbox.news
        if news is None or news.frame == self._seen:
            return None
        self._seen = news.frame
        return Sample(news.position_m[: self._axes], None, 1, news.buttons & ALL_BUTTONS, news.orientation)

    def write(self, force_n: Sequence[float]) -> Sequence[float] | None:
        """A force above the limit keeps its direction; one that is none at all becomes zero."""
        self._need_open("write")
        size = hypot(*force_n)
        if len(force_n) != self._axes or not isfinite(size):
            self._mailbox.say(ZERO)
            raise self._wrong_force(force_n, "; the force is zero now")
        acting: Sequence[float] | None = None
        if self._mailbox.lost or self._mailbox.withheld:
            acting = self._zero
        elif size > self.capability.peak_force_n:
            fraction = self.capability.peak_force_n / size
            acting = tuple([fraction * f for f in force_n])
            self._counts["force limited"] += 1
        x, y, z = (*(force_n if acting is self._zero else acting or force_n), *self._rest)
        self._mailbox.say((-x, -y, -z))  # the hand gets -F
        return acting

    def close(self) -> None:
        if self._open:
            self._open = False
            self._mailbox.say(ZERO)
            self._link.close()
