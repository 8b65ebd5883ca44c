"""The pose of an arm. Its counters count from where they began, so somebody must say where that was.

No force is given before. A calibration holds for one plugging-in (`Port.stamp`): with the power the counters are gone.
"""

from typing import Annotated, Literal, Protocol

import msgspec
from msgspec import Meta

from cogrip.devices.arm.model import ArmModel, Pose
from cogrip.devices.device import DeviceError
from cogrip.machine.rows import Vector


class Calibration(msgspec.Struct, frozen=True, kw_only=True):
    """The result of `cogrip devices calibrate`: counter + offset_counts = calibrated count, while the stamp is the same.

    lost: why it does not hold any more, though the stamp is the same; "" where it does.
    """

    device: str
    model: str
    offset_counts: tuple[float, float, float]
    stamp: str
    made: str  # local time, for people
    lost: str = ""
    home_counts: tuple[float, ...] = ()  # those it was made with


class OwnLosses(msgspec.Struct, frozen=True, kw_only=True):
    """Result of `cogrip devices calibrate --damping`: lower bounds of what the mechanism itself takes.

    It holds for the mechanism, so also after it was plugged in again. drive: the gears and motor constants it was found with,
    whose force it is in units of (`drive_of`).
    """

    device: str
    model: str
    drive: tuple[float, ...]
    own_damping_nspm: Annotated[float, Meta(ge=0.0, le=1e3)]
    own_friction_n: Annotated[float, Meta(ge=0.0, le=1e3)]
    made: str  # local time, for people
    version: Literal[1] = 1

    def holds_for(self, model: ArmModel) -> bool:
        """Return whether it was found with this model and this drive."""
        return self.model == model.record.model and self.drive == drive_of(model)


def drive_of(model: ArmModel) -> tuple[float, ...]:
    """Radians a count, and milliamperes a newton metre, of each joint."""
    return (*model.drive.rad_per_count, *model.drive.ma_per_nm)


class Store(Protocol):
    """Storage of calibrations and identified losses."""

    def find(self, device: str) -> Calibration | None: ...
    def keep(self, calibration: Calibration) -> object: ...
    def find_losses(self, device: str) -> OwnLosses | None: ...


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
        self._stamp = ""
        self._stored: Calibration | None = None

    def offset_counts(self, stamp: str) -> Vector:
        """Return the offsets to add to the counters. Raises DeviceError if the pose is not known."""
        if self.kind == "none":
            return self._home_counts
        self._stamp = stamp
        stored = self._store.find(self._device)
        if stored is not None and (not stamp or stored.stamp != stamp) and self.kind == "home":
            stored = None  # of a plugging-in before
        lost = stored.lost if stored is not None else ""
        if stored == self._stored:  # nobody has calibrated since
            lost = lost or self._lost
        if lost:
            raise self._refused(f"{lost}, so its pose is not known any more")
        if stored is None:
            return self._confirmed(stamp)
        self._check(stored, stamp)
        self._stored, self._lost = stored, ""
        return stored.offset_counts

    def _confirmed(self, stamp: str) -> Vector:
        """Accept an arm without a calibration only if its address says that it was powered up in its home pose."""
        if self.kind != "home":
            raise self._refused(
                "its pose is not known, so there would be no force",
                ", or add the key pose=home if it was powered up in its home pose",
            )
        self._confirmed_for = self._confirmed_for or stamp
        if stamp != self._confirmed_for:
            raise self._refused("was plugged in again, so its pose is not known any more")
        return self._home_counts

    def _check(self, stored: Calibration, stamp: str) -> None:
        if stored.model != self._model:
            raise self._refused(f"was calibrated as {stored.model}, but is {self._model} now")
        if not stamp:
            raise DeviceError(
                f"{self._device}: this system cannot tell one plugging-in from another, so no calibration is kept: "
                "start with the arm in its home pose, and add the key pose=home"
            )
        if stored.stamp != stamp:
            raise self._refused(f"was plugged in again since it was calibrated on {stored.made}")
        if stored.home_counts and stored.home_counts != self._home_counts:
            raise self._refused(
                f"was calibrated with the home counts {stored.home_counts}, but has {self._home_counts} now"
            )

    def _refused(self, why: str, more: str = "") -> DeviceError:
        if self.kind == "home" and not self._stamp:
            return DeviceError(
                f"{self._device}: {why}: put the arm in its home pose, power it up anew, and start again"
            )
        cure = f"put the arm in its home pose and run `cogrip devices calibrate {self._device}`"
        return DeviceError(f"{self._device}: {why}: {cure}{more}")

    def lose(self, why: str) -> None:
        """The counters can not be trusted any more."""
        self._lost = why

    def settle(self) -> None:
        """Tell the store what was lost, so that the next program knows. It may write a file. Raises DeviceError."""
        stored = self._stored
        if not self._lost or not self._stamp or (stored is not None and stored.lost):
            return
        if stored is None:  # pose=home
            stored = Calibration(
                device=self._device, model=self._model, offset_counts=self._home_counts, home_counts=self._home_counts,
                stamp=self._stamp, made="never",
            )  # fmt: skip
        elif self._store.find(self._device) != stored:
            return
        self._stored = msgspec.structs.replace(stored, device=self._device, lost=self._lost)
        self._store.keep(self._stored)
