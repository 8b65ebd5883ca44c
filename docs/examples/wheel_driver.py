"""Example of a driver: a force-feedback wheel with one axis on a serial line, and its emulated stand-in.

The wire: `F<millinewtons>\\n` to the wheel, `P<count>\\n` back, one reply a request. Name `family` as an entry point of your
package (group `cogrip.devices`, docs/devices.md), then `cogrip join SERVER --device wheel:/dev/ttyACM0` finds it, and
`cogrip devices conform wheel:emulated` tries every promise.
"""

import re
from collections.abc import Mapping, Sequence
from math import isfinite

from cogrip.devices.arm.exchange import ByteLine, Reading, RequestExchange, meet
from cogrip.devices.device import Capability, Device, DeviceError, Sample, check_rate
from cogrip.devices.registry import Family
from cogrip.devices.settings import Address, Setting

METRES_PER_COUNT = 2e-5
TICK_S, DAMPING_NSPM = 1.0 / 1024.0, 0.5  # of the stand-in
RECORD = Capability(
    family="wheel", model="wheel", axes=1, workspace_m=((-0.1, 0.1),), peak_force_n=3.0, continuous_force_n=1.0,
    stiffness_npm=1000.0, damping_nspm=5.0, slew_nps=1e4, speed_mps=2.0, resolution_m=METRES_PER_COUNT,
    apparent_mass_kg=0.1, rate_hz=1024, gives_velocity=False, latency_ticks=1,
)  # fmt: skip


class WheelCodec:
    """Frames of the wire, without I/O: see `cogrip.devices.arm.exchange.Codec`."""

    def __init__(self) -> None:
        self.skipped, self._rest = 0, b""

    def encode(self, commands: Sequence[float]) -> bytes:
        return b"F%d\n" % commands[0]

    def load(self, counts: Sequence[float]) -> None:
        """Do nothing: the wire has no request that sets the counter."""

    def feed(self, data: bytes) -> list[Reading]:
        *lines, self._rest = (self._rest + data).split(b"\n")
        found = [re.fullmatch(rb"P(-?\d{1,7})", line) for line in lines]
        self.skipped += sum(len(line) + 1 for line, match in zip(lines, found, strict=True) if match is None)
        return [Reading((int(match[1]),)) for match in found if match is not None]

    def reset(self) -> None:
        self.skipped, self._rest = self.skipped + len(self._rest), b""


class Wheel:
    """A `Device`: making it opens nothing, and every error leaves zero force."""

    def __init__(self, line: ByteLine) -> None:
        self.capability = RECORD
        self._exchange = RequestExchange(line, WheelCodec())
        self._open = False
        self._tick = 0

    @property
    def counts(self) -> Mapping[str, int]:
        return self._exchange.counts

    def open(self, rate_hz: int) -> None:
        if self._open:
            raise DeviceError("wheel: is open already; close it first")
        check_rate(rate_hz, RECORD, "wheel")
        self._exchange.line.open()
        meet(self._exchange, (0,))
        self._exchange.start(rate_hz)
        self._open, self._tick = True, 0

    def read(self, tick: int) -> Sample | None:
        self._need("read")
        if tick < self._tick:
            raise DeviceError(f"wheel: read(tick={tick}) after tick {self._tick}; ticks must not fall")
        self._tick = tick
        answer = self._exchange.reply(tick)
        return None if answer is None else Sample((answer[0].raw[0] * METRES_PER_COUNT,), None, answer[1])

    def write(self, force_n: Sequence[float]) -> Sequence[float] | None:
        self._need("write")
        if len(force_n) != 1:
            raise DeviceError(f"wheel: write of {len(force_n)} forces to 1 axes")
        if not isfinite(force_n[0]):
            self._exchange.ask((0,), self._tick)
            raise DeviceError(f"wheel: write of {force_n[0]} N: not finite; zero is sent instead")
        acting = max(-RECORD.peak_force_n, min(RECORD.peak_force_n, force_n[0]))
        self._exchange.ask((-1000 * acting,), self._tick)  # F loads the hand: the wheel pushes with -F
        return None if acting == force_n[0] else (acting,)

    def close(self) -> None:
        if self._open:
            self._exchange.line.read(0.02)  # a reply may be due
            self._exchange.line.write(self._exchange.codec.encode((0,)))
        self._open = False
        self._exchange.line.close()

    def _need(self, verb: str) -> None:
        if not self._open:
            raise DeviceError(f"wheel: {verb} while it is closed; call open(rate_hz) first")


class EmulatedWheel:
    """A `ByteLine` with the firmware of a wheel that turns freely: mass and a little friction, a step a request."""

    def __init__(self) -> None:
        self.name, self.counts = "wheel:emulated", dict[str, int]()
        self.pushes_n, self._replies = 0.0, b""
        self._place_m, self._speed_mps = 250 * METRES_PER_COUNT, 0.0

    def open(self) -> None: ...

    def write(self, frame: bytes) -> None:
        self._place_m += TICK_S * self._speed_mps
        self._replies += b"P%d\n" % round(self._place_m / METRES_PER_COUNT)
        self.pushes_n = int(frame[1:]) / 1000.0
        self._speed_mps += TICK_S * (self.pushes_n - DAMPING_NSPM * self._speed_mps) / RECORD.apparent_mass_kg

    def read(self, wait_s: float = 0.0) -> bytes:
        data, self._replies = self._replies, b""
        return data

    def close(self) -> None: ...

    def stamp(self) -> str:
        return "always plugged in"


def make(address: Address, axes: int, defaults: Mapping[str, Setting]) -> Device:
    if address.name == "emulated":
        return Wheel(EmulatedWheel())
    from cogrip.devices.io.serial_line import SerialLine

    return Wheel(SerialLine(address.name, "wheel"))


def family() -> Family:
    """Return the family: the entry point."""
    stand_ins = ("wheel:emulated",)
    return Family("a wheel", make, ("wheel:/dev/ttyACM0",), axes=lambda _: 1, stand_ins=stand_ins, real=True)
