"""Haply's hAPI firmware (M3 1.5): setup, torque, reply; clamp, no watchdog, directions stored by running index.

Written from what the firmware does: commands are single bytes, what is none is skipped; a frame that is not all there is
waited for a second, and what is missing then is whatever stood in memory (zeros here). Only a torque frame is answered, with
the id it came with, whether any motor has that id or not. Neither reset nor setup takes a torque away (of the setup that is not
certain: this is the bad case). With the power everything goes.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from math import isfinite

from cogrip.devices.emulated.faults import Faults
from cogrip.devices.emulated.firmware import Firmware
from cogrip.devices.emulated.mechanics import Mechanics
from cogrip.machine.addition import add_integers

MOST_NM = 0.123
FULL_DUTY = 4095
WAIT_NS = 1_000_000_000
PORTS = 4
ANALOG_PINS = 12
_RESET, _SETUP, _TORQUE = 0, 1, 2


@dataclass(frozen=True, slots=True)
class Joint:
    """The port that a joint's motor and encoder are wired to, and the direction byte with which they count and push its way."""

    port: int
    ccw: bool


class _Socket:
    """A socket of the board, which its maker calls a port, as the firmware knows it. id 0: unassigned."""

    def __init__(self) -> None:
        self.motor_id = 0
        self.encoder_id = 0
        self.motor_ccw = False
        self.encoder_ccw = False
        self.resolution = 1.0
        self.counter = 0  # that the encoder was set to ...
        self.pulses_then = 0  # ... when its wheel stood here
        self.duty = 0  # signed, of the direction pin


class HaplyFirmware(Firmware):
    """joints: those of the arm's joints a and b.

    homed: somebody holds the arm in its home pose for the moment of each setup, wherever it is before and after.
    """

    def __init__(
        self, joints: tuple[Joint, Joint], mechanics: Mechanics, faults: Faults, *, homed: bool = False
    ) -> None:
        super().__init__(mechanics, faults)
        self._joints = joints
        self._homed = homed
        self._ports = [_Socket() for _ in range(PORTS)]
        self._analog_ids = [0] * ANALOG_PINS
        self._pwm_ids: dict[int, int] = {}
        self._buffer = b""
        self._since_ns = 0

    @property
    def torque_nm(self) -> tuple[float, float]:
        """Present torques of the motors of the joints a, b [Nm]."""
        a, b = (self._joint_torque(joint) for joint in self._joints)
        return a, b

    def _joint_torque(self, joint: Joint) -> float:
        port = self._ports[joint.port - 1]
        sense = 1.0 if port.motor_ccw == joint.ccw else -1.0
        return sense * port.duty / FULL_DUTY * MOST_NM

    def stop_motors(self) -> None:
        self._ports = [_Socket() for _ in range(PORTS)]
        self._forget()
        self._buffer = b""
        self._drive()

    def _forget(self) -> None:
        for port in self._ports:
            port.motor_id = port.encoder_id = 0
        self._analog_ids = [0] * ANALOG_PINS
        self._pwm_ids.clear()

    def tick(self) -> None:
        if self._buffer and self.now_ns - self._since_ns > WAIT_NS:
            missing = 0
            while self._buffer:
                missing += 1
                if self._command(self._buffer + bytes(missing)):
                    self._buffer = b""

    def take(self, data: bytes) -> None:
        if not self._buffer:
            self._since_ns = self.now_ns
        self._buffer += data
        while self._buffer and (used := self._command(self._buffer)):
            self._buffer = self._buffer[used:]
            self._since_ns = self.now_ns

    def _command(self, data: bytes) -> int:
        """Execute the first command and return its length in bytes, 0 while it is incomplete."""
        command = data[0]
        if command > _TORQUE:
            return 1
        if len(data) < 2:
            return 0
        if command == _RESET:
            self._forget()
            return 2
        return self._setup(data) if command == _SETUP else self._torque(data)

    def _setup(self, data: bytes) -> int:
        fields = _Fields(data)
        try:
            device_id = fields.skip(1).byte()
            motors = fields.mask()
            motor_senses = fields.bytes(len(motors))
            encoders = fields.mask()
            encoder_senses = fields.bytes(len(encoders))
            analog = fields.bytes(fields.byte())
            pwm = fields.bytes(fields.byte())
            parameters = [(fields.float(), fields.float()) for _ in encoders]
        except IndexError:
            return 0
        self._forget()
        for index, sense in enumerate(motor_senses):  # by running index, whatever the ports are
            self._ports[index].motor_ccw = sense > 0
        for index, sense in enumerate(encoder_senses):
            self._ports[index].encoder_ccw = sense > 0
        for pin in analog:
            if 54 <= pin <= 65:
                self._analog_ids[pin - 54] = device_id
        self._pwm_ids.update({pin: device_id for pin in pwm if pin <= 13})
        for number, (offset_deg, resolution) in zip(encoders, parameters, strict=True):
            port = self._ports[number]
            port.encoder_id, port.resolution = device_id, resolution
            port.counter = int(offset_deg * resolution / 360.0)
            port.pulses_then = 0 if self._homed else self._pulses(number)  # they are counted from the home pose
        for number in motors:
            self._ports[number].motor_id = device_id
        self._drive()
        return fields.at

    def _pulses(self, number: int) -> int:
        """Return the pulses of the wheel at a port, in the joint's own sense."""
        counters = self.mechanics.counters
        return next((counters[k] for k, joint in enumerate(self._joints) if joint.port == number + 1), 0)

    def _torque(self, data: bytes) -> int:
        fields = _Fields(data)
        try:
            device_id = fields.skip(1).byte()
            fields.bytes(add_integers(owner == device_id for owner in self._pwm_ids.values()))
            motors = [port for port in self._ports if port.motor_id == device_id]
            torques = [fields.float() for _ in motors]
        except IndexError:
            return 0
        for port, torque in zip(motors, torques, strict=True):
            size = min(abs(torque), MOST_NM) if isfinite(torque) or torque != torque else MOST_NM
            duty = int(FULL_DUTY * size / MOST_NM) if size == size else 0
            port.duty = duty if torque > 0.0 else -duty
        self._drive()
        self._reply(device_id)
        return fields.at

    def _drive(self) -> None:
        a, b = self.torque_nm
        drive = self.mechanics.model.drive
        # the torques are the motors': Mechanics wants the drive's own unit for them
        unit_a, unit_b, _ = drive.motor_nm_per_a
        self.mechanics.drive((1000.0 * a / abs(unit_a), 1000.0 * b / abs(unit_b), 0.0))

    def _reply(self, device_id: int) -> None:
        said = device_id % 255 + 1 if self.faults.on("model", self.now_ns) else device_id
        values = [0.0 for owner in self._analog_ids if owner == device_id]
        for number, port in enumerate(self._ports):
            if port.encoder_id == device_id:
                values.append(360.0 * self._counter(number) / port.resolution)
        self.faults.send(bytes((said,)) + struct.pack(f"<{len(values)}f", *values), self.now_ns)

    def _counter(self, number: int) -> int:
        port = self._ports[number]
        ccw = next((joint.ccw for joint in self._joints if joint.port == number + 1), True)
        sense = 1 if port.encoder_ccw == ccw else -1
        return port.counter + sense * (self._pulses(number) - port.pulses_then)

    def press(self) -> None:
        """There is no calibrate button on the board."""


class _Fields:
    """Reads a frame from its begin; IndexError at its end."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.at = 0

    def bytes(self, count: int) -> bytes:
        if self.at + count > len(self._data):
            raise IndexError
        self.at += count
        return self._data[self.at - count : self.at]

    def skip(self, count: int) -> _Fields:
        self.bytes(count)
        return self

    def byte(self) -> int:
        return self.bytes(1)[0]

    def mask(self) -> list[int]:
        """Numbers of the ports from 0."""
        bits = self.byte()
        return [number for number in range(PORTS) if bits >> number & 1]

    def float(self) -> float:
        value: float = struct.unpack("<f", self.bytes(4))[0]
        return value
