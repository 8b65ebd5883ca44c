"""Haply's Inverse service with one Inverse3 and one wireless VerseGrip, written from Haply's pages, not from the driver.

Its inventory goes to whoever connects; then one state update answers each message. A force command is applied once, and the
device goes idle where none follows: after how long is not said, so IDLE_NS is ours. Sources: see `inverse.messages`.
"""

import json
from math import cos, isfinite, pi, sin
from typing import Any

from cogrip.devices.arm.kinematics import NO_TORQUE, Matrix
from cogrip.devices.arm.model import ArmModel
from cogrip.devices.arm.motors import CableDrive
from cogrip.devices.emulated.faults import Faults
from cogrip.devices.emulated.firmware import Firmware
from cogrip.devices.emulated.mechanics import Mechanics
from cogrip.devices.inverse.models import CENTRE_M, RECORD
from cogrip.machine.rows import Vector

IDLE_NS = 500_000_000
VELOCITY_NS = 5_000_000  # A velocity is the mean over this time.
GRIP_HZ = 0.5  # rate at which the handle turns to and fro
GRIP_RAD = 0.6
MOST_N = 10.0  # largest part of a force command along an axis


class _Axes:
    """Kinematics of a device that gives positions and takes forces: see `Kinematics`."""

    def forward(self, angles: Vector) -> Vector:
        return angles

    def inverse(self, position: Vector) -> Vector:
        return position

    def jacobian(self, angles: Vector) -> Matrix:
        return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)

    def gravity(self, angles: Vector) -> Vector:
        return NO_TORQUE


_ONE: Vector = (1.0, 1.0, 1.0)
_TURN = 2.0 * pi / RECORD.resolution_m  # counts in a turn of 2 pi, so that a count is the record's resolution
MODEL = ArmModel(
    _Axes(),
    CableDrive((_TURN, _TURN, _TURN), _ONE, _ONE, _ONE, _ONE, (2e4, 2e4, 2e4), 2e4),
    (0.0, 0.0, 0.0),
    RECORD,
    0.2,
)
"""Mechanics of the arm: a count is the record's resolution, and a milliampere a millinewton."""


class InverseService(Firmware):
    """Messages in, messages out. old: speaks format 3.1, else 3.5; button: of the grip, which `press` holds and lets go.

    status: of the Inverse3, as its messages have it; without power, or not ready, its motors are off
    refused: messages that were not understood
    """

    def __init__(self, mechanics: Mechanics, faults: Faults, *, old: bool = False) -> None:
        super().__init__(mechanics, faults)
        self.device_id, self.grip_id = "049D", "61548"
        self.old = old
        self.button = False
        self.status = {"calibrated": True, "in_use": True, "power_supply": True, "ready": True, "started": True}
        self.refused = 0
        self._fed_ns = 0
        self._was: tuple[int, Vector] | None = None
        self._speed: Vector = (0.0, 0.0, 0.0)

    def connect(self) -> None:
        """See `Firmware.connect`: the inventory."""
        self.faults.clear()
        session: dict[str, Any] = {} if self.old else {"session_id": 7}
        self._tell(session | self._listed(config=True))

    def tick(self) -> None:
        if self.now_ns - self._fed_ns > IDLE_NS:
            self.stop_motors()

    def stop_motors(self) -> None:
        if any(self.mechanics.currents_ma):
            self.mechanics.drive((0.0, 0.0, 0.0))

    def take(self, data: bytes) -> None:
        self._fed_ns = self.now_ns
        try:
            asked = json.loads(data)["inverse3"]
            (commands,) = (each["commands"] for each in asked if each["device_id"] == self.device_id)
            force = commands["set_cursor_force"]["values" if self.old else "vector"]
            right, forward, up = (float(force[axis]) for axis in "xyz")
        except (KeyError, TypeError, ValueError):
            self.refused += 1
        else:
            x, y, z = (
                max(-MOST_N, min(MOST_N, part)) * 1e3 if isfinite(part) else 0.0 for part in (-forward, right, up)
            )
            powered = self.status["power_supply"] and self.status["ready"]
            self.mechanics.drive((x, y, z) if powered else (0.0, 0.0, 0.0))
        self._tell(self._listed(config=False))

    def _tell(self, message: dict[str, Any]) -> None:
        self.faults.send(json.dumps(message).encode(), self.now_ns)

    def _listed(self, *, config: bool) -> dict[str, Any]:
        x, y, z = (
            count * RECORD.resolution_m + middle
            for count, middle in zip(self.mechanics.counters, CENTRE_M, strict=True)
        )
        force_x, force_y, force_z = self.mechanics.force_n
        speed_x, speed_y, speed_z = self._velocity()
        half = 0.5 * GRIP_RAD * sin(2.0 * pi * GRIP_HZ * 1e-9 * self.now_ns)
        arm: dict[str, Any] = {
            "device_id": self.device_id,
            "state": {
                "cursor_position": _named(y, -x, z),
                "cursor_velocity": _named(speed_y, -speed_x, speed_z),
                "angular_position": {"a0": -69.3, "a1": 137.6, "a2": 19.8},
                "body_orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
                "current_cursor_force": _named(force_y, -force_x, force_z),
                "control_domain": "cartesian",
                "control_mode": "force",
            },
            "status": dict(self.status),
        }
        grip: dict[str, Any] = {
            "device_id": self.grip_id,
            "state": {
                "buttons": {"a": self.button, "b": False, "c": False},
                "hall": 0,
                "orientation": {"w": cos(half), "x": 0.0, "y": sin(half), "z": 0.0},
                "battery_level": 0.9,
            },
            "status": {"connected": True, "ready": True},
        }
        if config:
            arm["config"] = {"type": "inverse3", "handedness": "right", "torque_scaling": {"enabled": True}}
            if not self.old:
                mount = {"position": _named(0.0, 0.0, 0.0), "scale": _named(1.0, 1.0, 1.0)}
                arm["config"] |= {"basis": {"permutation": "XYZ"}, "mount": mount, "preset": "defaults"}
            grip["config"] = {"type": "wireless_verse_grip"}
        if self.faults.on("model", self.now_ns):  # another device is there instead
            arm["device_id"] = "FFFF"
        return {"inverse3": [arm], "wireless_verse_grip": [grip]}

    def _velocity(self) -> Vector:
        """Return the tip's own velocity, whatever its encoders say, over VELOCITY_NS at least."""
        at = self.mechanics.body.position_m
        if self._was is None or self.now_ns - self._was[0] >= VELOCITY_NS:
            if self._was is not None:
                per_s = 1e9 / (self.now_ns - self._was[0])
                x, y, z = [per_s * (now - then) for now, then in zip(at, self._was[1], strict=True)]
                self._speed = (x, y, z)
            self._was = self.now_ns, at
        return self._speed

    def press(self) -> None:
        """Hold the grip's button a, or let it go."""
        self.button = not self.button


def _named(x: float, y: float, z: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}
