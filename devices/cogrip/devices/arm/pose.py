"""How the pose of an arm is known: its counters only count from where they began, so someone must say where that was.

No force is given before. A calibration holds for one plugging-in (`Port.stamp`): with the power the counters are gone.
"""

from __future__ import annotations

from typing import Protocol

import msgspec

from cogrip.devices.arm.kinematics import Vector
from cogrip.devices.arm.model import Pose
from cogrip.devices.device import DeviceError


class Calibration(msgspec.Struct, frozen=True, kw_only=True):
    """What `cogrip devices calibrate` leaves: counter + offset_counts = calibrated count, while the stamp is the same.

    lost: why it does not hold any more, though the stamp is the same; "" where it does.
    """

    device: str
    model: str
    offset_counts: tuple[float, float, float]
    stamp: str
    made: str  # local time, for people
    lost: str = ""


class Store(Protocol):
    """Where calibrations are kept."""

    def find(self, device: str) -> Calibration | None: ...
    def keep(self, calibration: Calibration) -> object: ...


class KnownPose:
    """Offsets of one device's counters, and why they may be trusted."""

    def __init__(self, kind: Pose, device: str, model: str, home_counts: Vector, store: Store) -> None:
        self.kind = kind
        self._device = device
        self._model = model
        self._home_counts = home_counts
        self._store = store
        self._confirmed_for = ""  # the plugging-in that pose=home was said of
        self._lost = ""
        self._stored: Calibration | None = None

    def offset_counts(self, stamp: str) -> Vector:
        """To be added to the counters. Raises DeviceError where the pose is not known."""
        if self.kind == "none":
            return self._home_counts
        cure = (
            f"put the arm in its home pose and run `cogrip devices calibrate {self._device}`"
            if self.kind == "stored"
            else "put the arm in its home pose, power it up anew, and start again"
        )
        if self.kind == "home":
            self._confirmed_for = self._confirmed_for or stamp
            if self._lost:
                raise DeviceError(f"{self._device}: {self._lost}, so its pose is not known any more: {cure}")
            if stamp != self._confirmed_for:
                raise DeviceError(f"{self._device}: was plugged in again, so its pose is not known any more: {cure}")
            return self._home_counts
        stored = self._store.find(self._device)
        if stored is None:
            raise DeviceError(
                f"{self._device}: its pose is not known, so there would be no force: {cure}, or add the key pose=home if it was"
                " powered up in its home pose"
            )
        if stored.model != self._model:
            raise DeviceError(f"{self._device}: was calibrated as {stored.model}, but is {self._model} now: {cure}")
        if not stamp:
            raise DeviceError(
                f"{self._device}: this system cannot tell one plugging-in from another, so no calibration is kept: "
                "start with the arm in its home pose, and add the key pose=home"
            )
        if stored.stamp != stamp:
            raise DeviceError(f"{self._device}: was plugged in again since it was calibrated on {stored.made}: {cure}")
        lost = stored.lost or (self._lost if stored == self._stored else "")
        if lost:
            raise DeviceError(f"{self._device}: {lost}, so its pose is not known any more: {cure}")
        self._stored, self._lost = stored, ""
        return stored.offset_counts

    def lose(self, why: str) -> None:
        """The counters can not be trusted any more."""
        self._lost = why

    def settle(self) -> None:
        """Tell the store what was lost, so that the next program knows. It may write a file. Raises DeviceError."""
        stored = self._stored
        if self._lost and stored is not None and not stored.lost and self._store.find(self._device) == stored:
            self._stored = msgspec.structs.replace(stored, device=self._device, lost=self._lost)
            self._store.keep(self._stored)
