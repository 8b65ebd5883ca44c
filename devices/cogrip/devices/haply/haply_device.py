"""A Haply arm: an `ArmDevice` whose counters begin with a setup, which must not be repeated while its pose is to stay known."""

from math import degrees

from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.arm.exchange import ByteLine, RequestExchange
from cogrip.devices.arm.model import Pose
from cogrip.devices.arm.pose import Calibration, Store
from cogrip.devices.haply.frames import HaplyCodec
from cogrip.devices.haply.line import CALIBRATED_ID, IDS, SESSION_ID, HaplyLine, SessionStart, id_of
from cogrip.devices.haply.models import HaplyModel


class HaplyDevice(ArmDevice):
    """See `Device`. number: any, another one in another process; ids are drawn from it."""

    has_watchdog = False

    def __init__(
        self, name: str, axes: int, line: ByteLine, codec: HaplyCodec, model: HaplyModel, pose: Pose, store: Store, number: int
    ) -> None:  # fmt: skip
        self._line = HaplyLine(line, codec, self._plan)
        super().__init__(name, axes, RequestExchange(self._line, codec), lambda _: model, pose, model, store)
        self._number = number
        self._calibrating = False

    def home_words(self) -> str:
        """Return the home pose in words. These arms have no usual one: theirs is a setting."""
        a, b, _ = (degrees(angle) for angle in self.model.drive.angles(self.model.home_counts))
        return f"first link at {a:.0f}, second at {b:.0f} degrees, as the key home_deg says"

    def _plan(self) -> SessionStart:
        if self._calibrating:
            return SessionStart(self._draw(CALIBRATED_ID), set_up=True)
        if self._pose_kind == "stored":
            kept = self._store.find(self._where)
            known_id = id_of(kept.stamp) if kept is not None else None
        else:  # pose=home was confirmed once, and the arm may be anywhere now
            known_id = self._line.known_id if self._pose_kind == "home" else 0
        if known_id:
            return SessionStart(known_id, set_up=False)
        return SessionStart(self._draw(SESSION_ID), set_up=True)

    def _draw(self, first: int) -> int:
        self._number += 1
        return first + self._number % IDS

    def calibrate(self, made: str) -> Calibration:
        """See `ArmDevice.calibrate`. The board is set up anew: earlier calibrations hold no longer."""
        self._calibrating = True
        try:
            return super().calibrate(made)
        finally:
            self._calibrating = False
