"""The hfab firmware 2 (Teensy, serial): bracket frames, error numbers, watchdog, the fault of pipelined requests.

Written from the firmware's own parsing rules, in their order. It reads byte by byte until `]`, at most 127 bytes (128). Without
a `[` among them that is 256; with another number of commas than two, wherever they stand, 512, and the rest stays unread. Only
after a frame with two commas does it look at what is already buffered, where only newline, return and NUL may stand: it reads
on through the first byte that is another (8). The numbers are read from the last `[` on, as C's sscanf reads "[%d,%d,%d]":
blanks and a sign may stand before a number, anything after the third (1024).
"""

import re

from cogrip.devices.emulated.faults import Faults
from cogrip.devices.emulated.firmware import Firmware
from cogrip.devices.emulated.mechanics import Mechanics

WATCHDOG_NS = 100_000_000
MOST_MA = 6000  # largest current of a motor; one that is asked for more gets none
LONGEST = 127
IDLE_PWM = 4095
_BLANKS = b"\n\r\0"
_PERCENT_D = rb"[ \t\n\v\f\r]*([+-]?\d+)"
_THREE = re.compile(rb"\[" + rb",".join([_PERCENT_D] * 3))


class HfabFirmware(Firmware):
    """number: which machine it says it is."""

    def __init__(self, number: int, mechanics: Mechanics, faults: Faults) -> None:
        super().__init__(mechanics, faults)
        self.number = number
        self.enabled = False  # amplifiers
        self.gimbal = (0, 0, 0)  # counts d, e, f
        self.pwm = [IDLE_PWM] * 3
        self._fed_ns = 0
        self._buffer = b""
        self._counters = (0, 0, 0)  # of the last good frame

    def stop_motors(self) -> None:
        self.enabled = False
        self.pwm = [IDLE_PWM] * 3
        self._buffer = b""
        self._counters = (0, 0, 0)
        self.mechanics.drive((0.0, 0.0, 0.0))

    def tick(self) -> None:
        if self.enabled and self.now_ns - self._fed_ns > WATCHDOG_NS:
            self.enabled = False
            self.pwm = [IDLE_PWM] * 3
            self.mechanics.drive((0.0, 0.0, 0.0))

    def take(self, data: bytes) -> None:
        self._buffer += data
        while (frame := self._frame()) is not None:
            error = self._act(frame) if isinstance(frame, bytes) else frame
            self._reply(error)

    def _frame(self) -> bytes | int | None:
        """The next frame from its last `[` on, an error number, or None while there is no whole one."""
        buffer = self._buffer
        end = buffer.find(b"]", 0, LONGEST)
        if end < 0:
            if len(buffer) < LONGEST:
                return None
            self._buffer = buffer[LONGEST:]
            return 128
        read, self._buffer = buffer[: end + 1], buffer[end + 1 :]
        begin = read.rfind(b"[")
        if begin < 0:
            return 256
        if read.count(b",") != 2:
            return 512
        remainder = self._buffer.lstrip(_BLANKS)
        self._buffer = remainder[1:]
        return 8 if remainder else read[begin:]

    def _act(self, frame: bytes) -> int:
        numbers = _THREE.match(frame)
        if numbers is None:
            return 1024
        a, b, c = (float(value) if abs(value) <= MOST_MA else 0.0 for value in map(int, numbers.groups()))
        self._fed_ns = self.now_ns
        self.enabled = True
        self.pwm = [int(8191 * (0.4 * current / MOST_MA + 0.5)) for current in (a, b, c)]
        self.mechanics.drive((a, b, c))
        self._counters = self.mechanics.counters
        return 0

    def _reply(self, error: int) -> None:
        number = self.number % 3 + 1 if self.faults.on("model", self.now_ns) else self.number
        self.faults.send(b"[%d,%d,%d,%d,%d,%d,%d,%d]\n" % (number, *self._counters, *self.gimbal, error), self.now_ns)
