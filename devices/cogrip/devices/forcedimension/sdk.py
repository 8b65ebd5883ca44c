"""The functions used of the Force Dimension SDK, by their names in the package `forcedimension_core`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from ctypes import c_double
from typing import NamedTuple, Protocol

TIME_GUARD = 1  # the device was not asked again so soon; the answer is the last one
SATURATED = 2  # a motor is at its limit; the force keeps its direction
SUCCESS = (0, TIME_GUARD, SATURATED)
BY_WATCHDOG = 3
OFF_CAUSES = {
    1: "the button on its base",
    2: "it moved too fast",
    BY_WATCHDOG: "no force came in time",
    4: "another program",
    5: "its USB cable",
    6: "nobody holds it",
}
"""Status.forceoffcause -> words; 0 where forces are on, or the device does not say."""


class Expert(Protocol):
    def enableExpertMode(self) -> int: ...
    def disableExpertMode(self) -> int: ...
    def setWatchdog(self, duration: int, ID: int) -> int:
        """Forces go off when none has been sent for `duration` x 125 us."""


class Dhd(Protocol):
    """`forcedimension_core.dhd`. An int is one of SUCCESS, or -1; positions and forces are three numbers [m], [N]."""

    @property
    def expert(self) -> Expert: ...
    def openID(self, index: int) -> int: ...
    def close(self, ID: int) -> int: ...
    def stop(self, ID: int) -> int: ...
    def enableForce(self, enable: bool, ID: int) -> int: ...
    def enableGripperForce(self, enable: bool, ID: int) -> int: ...
    def hasActiveWrist(self, ID: int) -> bool: ...
    def hasActiveGripper(self, ID: int) -> bool: ...
    def isLeftHanded(self, ID: int) -> bool: ...
    def setMaxForce(self, limit: float, ID: int) -> int:
        """A negative limit would be none."""

    def setMaxTorque(self, limit: float, ID: int) -> int: ...
    def setMaxGripperForce(self, limit: float, ID: int) -> int: ...
    def setForceAndTorque(self, f: Sequence[float], t: Sequence[float], ID: int) -> int:
        """Torque on the hand about the axes of positions [N m]."""

    def setForceAndGripperForce(self, f: Sequence[float], fg: float, ID: int) -> int:
        """Force that opens the gripper [N], of a left-handed one that closes it: so in the SDK's own example `sphere`."""

    def setForce(self, f: Sequence[float], ID: int) -> int: ...
    def getPosition(self, out: list[float], ID: int) -> int: ...
    def getLinearVelocity(self, out: list[float], ID: int) -> int: ...
    def getOrientationFrame(self, out: list[list[float]], ID: int) -> int:
        """Rows of the handle's rotation matrix, in the axes of positions."""

    def getGripperGap(self, out: c_double, ID: int) -> int:
        """Opening of the gripper [m]."""

    def getButtonMask(self, ID: int) -> int: ...
    def getStatus(self, out: Status, ID: int) -> int: ...
    def errorGetLastStr(self) -> str: ...


class Status(Protocol):
    """`forcedimension_core.containers.Status`: 1 or 0. reset: it waits to be calibrated; force, torque: these are on.

    error          0: none
    forceoffcause  why forces went off last (OFF_CAUSES)
    """

    power: int
    reset: int
    force: int
    torque: int
    error: int
    forceoffcause: int


class Sdk(NamedTuple):
    """system_type: number of a device's kind, by its ID; -1 where it does not say. The package's own knows some kinds only."""

    dhd: Dhd
    status: Callable[[], Status]
    system_type: Callable[[int], int]
