"""Haptikfabriken/WoodenHaptics HID firmware: lock-step reports, watchdog, counters that can be loaded, the calibration button.

Its main loop: fill an input report and send it, which lasts until the host polls; wait for an output report; act. So there is
one input report for each output report, and the very first was filled at power-up, whenever the host may come for it.
"""

from struct import Struct

from cogrip.devices.emulated.faults import Faults
from cogrip.devices.emulated.firmware import Firmware
from cogrip.devices.emulated.mechanics import Mechanics
from cogrip.machine.rows import Vector

WATCHDOG_NS = 500_000_000
IDLE_DUTY = 0.5
SWING = 0.4  # change of the duty at full current: the amplifier's full scale is 10 to 90 %
BYTES = {"mbed14": 14, "teensy64": 64, "mbed8": 8}
_REPORT = Struct("<7h")
_REPORT_2016 = Struct("<3hH")
_REST: Vector = (0.0, 0.0, 0.0)


class HidFirmware(Firmware):
    """full_scale_a: what firmware and amplifiers were built for, 3 or 6 A.

    enabled  amplifiers
    duty     of the motors' pulse widths, as the firmware computes it: nothing bounds it
    gimbal   counts d, e, f; button: of the stylus; info: 1 from `press` until the counters are loaded
    ignored  output reports of another length
    """

    def __init__(
        self, mechanics: Mechanics, faults: Faults, variant: str = "mbed14", full_scale_a: float = 3.0
    ) -> None:
        super().__init__(mechanics, faults)
        self.variant = variant
        self.full_scale_a = full_scale_a
        self.enabled = False
        self.duty = [IDLE_DUTY] * 3
        self.gimbal = [0, 0, 0]
        self.button = False
        self.info = 0
        self.ignored = 0
        self._fed_ns = 0
        self._number = 0
        self._send()

    def stop_motors(self) -> None:
        self.enabled = False
        self._drive(_REST)

    def tick(self) -> None:
        if self.enabled and self.now_ns - self._fed_ns > WATCHDOG_NS:
            self.stop_motors()

    def take(self, data: bytes) -> None:
        if len(data) != 1 + BYTES[self.variant] or data[0]:
            self.ignored += 1
            return
        self._fed_ns = self.now_ns
        self.enabled = True
        if self.variant == "mbed8":
            a, b, c, _ = _REPORT_2016.unpack_from(data, 1)
            self._drive((a, -b, -c))
        else:
            self._act(*_REPORT.unpack_from(data, 1))
        self._send()

    def _act(self, a: int, b: int, c: int, command: int, x: int, y: int, z: int) -> None:
        if command == 1:
            self.mechanics.load((x, y, z))
            self.gimbal = [a, b, c]
            self.info = 0
            a = b = c = 0
        self._drive((a, b, c))

    def _drive(self, currents_ma: Vector) -> None:
        full = 1000.0 * self.full_scale_a
        self.duty = [IDLE_DUTY + SWING * current / full for current in currents_ma]
        a, b, c = (max(-full, min(full, current)) for current in currents_ma)  # the amplifier gives no more
        self.mechanics.drive((a, b, c))

    def _send(self) -> None:
        report = self._report(self.variant)
        if self.faults.on("model", self.now_ns):  # no field says what it is: only the length tells
            report = self._report("mbed14" if self.variant == "mbed8" else "mbed8")
        self.faults.send(report, self.now_ns)

    def _report(self, variant: str) -> bytes:
        a, b, c = self.mechanics.counters
        if variant == "mbed8":
            self._number = (self._number + 1) % 65536
            return _REPORT_2016.pack(_int16(-a), _int16(-b), _int16(-c), self._number)
        d, e, f = self.gimbal
        fields = (a, b, c, d + 10000 * (self.button or bool(self.mechanics.body.buttons & 1)), e, f, self.info)
        return _REPORT.pack(*map(_int16, fields)).ljust(BYTES[variant], b"\0")

    def press(self) -> None:
        """The board's button only tells the host, which then loads the counters."""
        self.info = 1

    def mend(self) -> None:
        was_off = not self.plugged
        super().mend()
        if was_off:
            self.gimbal = [0, 0, 0]
            self.info = self._number = 0
            self._send()


def _int16(count: int) -> int:
    """The lower 16 bits of a counter, as a signed number."""
    return (count + 32768) % 65536 - 32768
