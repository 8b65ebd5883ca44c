"""The device that an Inverse3 behind its service is: one message with a force a tick, and one state update in return."""

from collections.abc import Mapping, Sequence
from math import hypot, isfinite

from cogrip.devices.arm.exchange import RETRY_S, ByteLine, RequestExchange
from cogrip.devices.device import Capability, DeviceError, Sample
from cogrip.devices.driver import Driver
from cogrip.devices.frozen_position import FrozenPosition
from cogrip.devices.inverse.messages import InverseCodec
from cogrip.machine.rows import Vector

INVENTORY_S = 2.0  # longest wait for the service's first message
SILENT_S = 0.04  # time after the last state update beyond which no force is asked for
GONE_UPDATES = 3
"""Updates in a row without the device, or with one that has no power or is not ready, after which it is lost."""
PAUSE_S = 0.025  # time without a command after which the device may have gone idle: no page says how soon it does
REST_S = 0.02  # time without force after a pause of PAUSE_S: the client takes the device for let go, and ramps
GOODBYES = 2  # messages without force that are sent when the device is closed
ZERO: Vector = (0.0, 0.0, 0.0)


class InverseDevice(Driver):
    """See `Device`. centre_m: of the workspace, in our axes from the base's origin."""

    def __init__(
        self,
        where: str,
        record: Capability,
        line: ByteLine,
        codec: InverseCodec,
        centre_m: Vector,
        *,
        uncalibrated: bool,
    ) -> None:
        super().__init__(where, record.axes)
        self.capability = record
        self.exchange = RequestExchange(line, codec)
        self._codec = codec
        self._centre_m = centre_m
        self._uncalibrated = uncalibrated
        self._broken = ""

    @property
    def counts(self) -> Mapping[str, int]:
        exchange = {name: count for name, count in self.exchange.counts.items() if name != "bytes skipped"}
        return {**self.exchange.line.counts, **exchange, **self._codec.refused, **self._counts}

    def open(self, rate_hz: int) -> None:
        """Raises DeviceError also where the service is not there, or has no Inverse3 that may give force."""
        self._check_open(rate_hz, self.capability)
        line = self.exchange.line
        line.open()
        try:
            inventory = line.read(INVENTORY_S)
            if not inventory:
                raise self._error(f"no inventory within {INVENTORY_S:g} s; is this the Inverse service? Restart it")
            self._codec.choose(inventory, self._where, uncalibrated=self._uncalibrated)
        except BaseException:
            line.close()
            raise
        self.exchange.start(rate_hz)
        self._silent_ticks = max(1, int((SILENT_S - RETRY_S) * rate_hz))
        self._pause_ticks, self._rest_ticks = max(1, int(PAUSE_S * rate_hz)), round(REST_S * rate_hz)
        self._tick = self._received_at = self._gone = self._flows_at = 0
        self._written = -1
        self._frozen = FrozenPosition(self.capability.resolution_m, rate_hz)
        self._acting: Sequence[float] = self._zero
        self._broken = ""
        self._open = True

    def read(self, tick: int) -> Sample | None:
        self._check_read(tick)
        if self._broken:
            raise DeviceError(self._broken)
        try:
            answer = self.exchange.reply(tick)
        except DeviceError as error:
            self._broken = str(error)
            raise
        if answer is None:
            return None
        reading, age = answer
        if reading.rejected:
            self._counts[reading.error] += 1
            self._gone += 1
            if self._gone >= GONE_UPDATES:
                self._broken = f"{self._where}: lost: {reading.error}; see to its cable and power, then re-arm"
                raise DeviceError(self._broken)
            return None
        self._gone, self._received_at = 0, tick
        x, y, z, speed, qw, qx, qy, qz, buttons = reading.raw
        if self._frozen.still((x, y, z), tick - age) and (wrong := self._frozen.judge((speed,))):
            self._broken = f"{self._where}: lost: {wrong}; see to its cable and power, then re-arm"
            raise DeviceError(self._broken)
        cx, cy, cz = self._centre_m
        place = (x - cx, y - cy, z - cz)[: self._axes]
        orientation = (qw, qx, qy, qz) if qw or qx or qy or qz else None
        return Sample(place, None, age, int(buttons), orientation)

    def write(self, force_n: Sequence[float]) -> Sequence[float] | None:
        """A force above the limit keeps its direction. None is asked for after a pause, or a silence."""
        self._need_open("write")
        size = hypot(*force_n)
        wrong = len(force_n) != self._axes or not isfinite(size)
        silent = self._tick - self._received_at > self._silent_ticks
        if 0 <= self._written <= self._tick - self._pause_ticks:
            self._counts["paused: may have gone idle"] += 1
            self._flows_at = self._tick + self._rest_ticks
        self._written = self._tick
        held_back = silent or self._gone or self._tick < self._flows_at
        share = 0.0 if wrong or held_back or self._broken else 1.0
        if share and size > self.capability.peak_force_n:
            share = self.capability.peak_force_n / size
            self._counts["force limited"] += 1
        acting = [share * force for force in force_n] if share != 1.0 else force_n
        x, y, z = (*acting, 0.0, 0.0)[:3] if share else ZERO
        told = False
        try:
            told = self.exchange.ask((-x, -y, -z), self._tick)  # the hand gets -F
        except DeviceError as error:
            self._broken = self._broken or str(error)
        if wrong:
            raise self._wrong_force(force_n, "; the force is zero now")
        if self._broken:
            raise DeviceError(self._broken)
        if told:
            self._acting = tuple(acting)
        return None if told and share == 1.0 else self._acting

    def close(self) -> None:
        """Zero force is told more than once: a reply may still be under way."""
        line, was_open, self._open = self.exchange.line, self._open, False
        for _ in range(GOODBYES if was_open else 0):
            try:
                line.read(0.02)
                line.write(self._codec.encode(ZERO))
            except DeviceError:
                self._counts["not reached when closed"] += 1
                break
        line.close()
