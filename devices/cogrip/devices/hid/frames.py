"""The reports of Haptikfabriken/WoodenHaptics HID firmware: int16, little-endian, no report id, no checksum.

in   a b c d e f info               counts of joints and gimbal; d > 5000: the button is down, and it is d - 10000;
                                    info 1: the calibration button was pressed
out  id=0 a b c command x y z       motor currents in mA; command 1: x y z become the counters a b c, and the three before the
                                    command the counters d e f, with no current
The firmware of 2016 (8 bytes) has a b c and a running number in, a b c and a debug word out. Its encoders count the other way
round; the signs of its motors are not known, so it is never asked for current.
"""

from collections.abc import Callable, Sequence
from struct import Struct, error

from cogrip.devices.arm.exchange import Codec, Reading
from cogrip.devices.device import DeviceError
from cogrip.devices.hid.enumeration import VARIANTS

APPLY, LOAD = 0, 1
MOST_TURNED, PRESSED = 5000, 10000  # largest count d of a gimbal, and what a button that is down adds to it
_IN = Struct("<7h")
_OUT = Struct("<x7h")
_IN_2016 = Struct("<3hH")
_NOTHING_2016 = bytes(9)


class ReportCodec:
    """See `Codec`. Commands are whole milliamperes. report_bytes: 14, or 64 of which the first 14 count."""

    def __init__(self, report_bytes: int = _IN.size) -> None:
        self.skipped = 0
        self._report_bytes = report_bytes
        self._padding = bytes(report_bytes - _IN.size)

    def encode(self, commands: Sequence[float]) -> bytes:
        a, b, c = commands
        return self._pack((a, b, c, APPLY, 0, 0, 0), "mA")

    def load(self, counts: Sequence[float]) -> bytes:
        a, b, c, d, e, f = counts
        return self._pack((d, e, f, LOAD, a, b, c), "counts")

    def _pack(self, fields: Sequence[float], unit: str) -> bytes:
        """Raises DeviceError for what no int16 holds: nothing wraps around into another force."""
        try:
            return _OUT.pack(*map(int, fields)) + self._padding
        except (error, ValueError, OverflowError):
            raise DeviceError(
                f"hid: {tuple(fields)} {unit}: a report holds -32768 to 32767; lower limit_ma, or correct home"
            ) from None

    def feed(self, data: bytes) -> list[Reading]:
        if len(data) != self._report_bytes:
            self.skipped += bool(data)
            return []
        a, b, c, d, e, f, _ = _IN.unpack_from(data)
        pressed = d > MOST_TURNED
        return [Reading((a, b, c), gimbal=(d - PRESSED * pressed, e, f), buttons=int(pressed))]

    def reset(self) -> None:
        """A report comes whole or not at all."""


class ReportCodec2016:
    """See `Codec`. Whatever is commanded, no current is asked for."""

    def __init__(self) -> None:
        self.skipped = 0

    def encode(self, commands: Sequence[float]) -> bytes:
        return _NOTHING_2016

    def load(self, counts: Sequence[float]) -> None:
        """There is no such request: the counters begin with the power."""

    def feed(self, data: bytes) -> list[Reading]:
        if len(data) != _IN_2016.size:
            self.skipped += bool(data)
            return []
        a, b, c, _ = _IN_2016.unpack(data)
        return [Reading((-a, -b, -c))]

    def reset(self) -> None:
        """A report comes whole or not at all."""


CODECS: dict[str, Callable[[], Codec]] = {
    "mbed14": ReportCodec,
    "teensy64": lambda: ReportCodec(VARIANTS["teensy64"].report_bytes),
    "mbed8": ReportCodec2016,
}
