"""A Haply board's line, which makes sure that the board is set up when the driver opens it.

The setup starts the counters at zero, so it stands for the pose: as long as the board answers to the id it was set up with,
the counters go on. A board that lost its power, or that another program set up, knows another id or none, and answers with one
byte. Ids of calibrations and of pose=home differ, so that neither is taken for the other; all are below 0x30, so that where a
frame was cut off and another follows, no id that lands in a torque makes it one worth mentioning.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from cogrip.devices.arm.exchange import ByteLine
from cogrip.devices.device import DeviceError
from cogrip.devices.haply.frames import HaplyCodec, reset_frame

IDS = 20  # number of ids of each kind
CALIBRATED_ID = 6  # first of the ids of calibrations; Haply's own examples use 3 and 5
SESSION_ID = 27
LAST_RESORT_ID = 47
TRIES = 3
PATIENCE_S = 0.05
_MARK = " id "


@dataclass(frozen=True, slots=True)
class SessionStart:
    """The first exchange on an open line: the board is set up anew, its counters at zero, or must know this id."""

    device_id: int
    set_up: bool


class HaplyLine:
    """See `ByteLine`. plan: asked at every `open`. known_id: of the last setup that was answered, 0 for none."""

    def __init__(self, line: ByteLine, codec: HaplyCodec, plan: Callable[[], SessionStart]) -> None:
        self.name = line.name
        self.known_id = 0
        self._line = line
        self._codec = codec
        self._plan = plan

    @property
    def counts(self) -> Mapping[str, int]:
        return self._line.counts

    def open(self) -> None:
        """Raises DeviceError where the board does not answer, or not to an id it should know: its motors are off then."""
        start = self._plan()
        self._codec.device_id = start.device_id
        self._line.open()
        try:
            self._begin(start)
        except DeviceError:
            self._line.close()
            raise

    def _begin(self, start: SessionStart) -> None:
        if start.set_up:
            self._set_up()
            if not self._answers():
                raise DeviceError(
                    f"{self.name}: no reply after its setup; is this the right port, and is the board powered?"
                )
            self.known_id = start.device_id
        elif not self._answers():
            self._codec.device_id = LAST_RESORT_ID
            self._set_up()
            raise DeviceError(
                f"{self.name}: does not answer to its setup, so its counters are lost: it was without power, or another"
                " program has used it; put the arm in its home pose and calibrate, or start anew with pose=home"
            )

    def _set_up(self) -> None:
        """Counters at zero, motors off: neither a reset nor a setup alone takes the torque away."""
        codec = self._codec
        codec.reset()
        for frame in (reset_frame(codec.device_id), codec.wiring.setup(codec.device_id), codec.encode((0.0, 0.0))):
            self._line.write(frame)

    def _answers(self) -> bool:
        codec = self._codec
        codec.reset()
        for _ in range(TRIES):
            self._line.write(codec.encode((0.0, 0.0)))
            if codec.feed(self._line.read(PATIENCE_S)):
                return True
        codec.reset()
        return False

    def write(self, frame: bytes) -> None:
        self._line.write(frame)

    def read(self, wait_s: float = 0.0) -> bytes:
        return self._line.read(wait_s)

    def close(self) -> None:
        self._line.close()

    def stamp(self) -> str:
        """Stamp of the power-up and of the setup."""
        plugged = self._line.stamp()
        return f"{plugged}{_MARK}{self._codec.device_id}" if plugged else ""


def id_of(stamp: str) -> int | None:
    """The id of the setup that a stamp is of; None where it names none that a calibration can have."""
    number = stamp.rpartition(_MARK)[2]
    if not number.isdecimal() or not CALIBRATED_ID <= int(number) < CALIBRATED_ID + IDS:
        return None
    return int(number)
