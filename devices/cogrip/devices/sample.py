"""One reading of a device."""

from __future__ import annotations

from typing import Any

FIELDS = "position_m", "velocity_mps", "age_ticks", "buttons", "orientation", "grip_m"


class Sample:
    """One reading: position [m] and, where the device knows it, velocity [m/s], each of shape (axes,).

    A value: a driver makes a new one for each reading (compiled, none can be changed).

    Of six axes the last three are a rotation vector [rad] and an angular velocity [rad/s], in the device's own frame; of four
    the last is the opening of a gripper with force [m] and its rate.

    It was taken `age_ticks` ticks before the tick it is read at: a device that answers a request is asked at one tick, with
    the force that begins then, and read at the next.

    buttons             bit k is 1 while button k + 1 is held down
    orientation         unit quaternion (w, x, y, z) of the handle in the device's own frame, where the device knows it
    grip_m              opening of the gripper [m], where there is one
    """

    __slots__ = FIELDS

    def __init__(
        self,
        position_m: tuple[float, ...],
        velocity_mps: tuple[float, ...] | None,
        age_ticks: int = 0,
        buttons: int = 0,
        orientation: tuple[float, float, float, float] | None = None,
        grip_m: float | None = None,
    ) -> None:
        self.position_m = position_m
        self.velocity_mps = velocity_mps
        self.age_ticks = age_ticks
        self.buttons = buttons
        self.orientation = orientation
        self.grip_m = grip_m

    def replaced(self, **changes: Any) -> Sample:
        """Return this sample with other values of some fields."""
        return Sample(**{name: getattr(self, name) for name in FIELDS} | changes)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sample):
            return NotImplemented
        return all(getattr(self, name) == getattr(other, name) for name in FIELDS)

    def __hash__(self) -> int:
        return hash(tuple(getattr(self, name) for name in FIELDS))

    def __repr__(self) -> str:
        return f"Sample({', '.join(f'{name}={getattr(self, name)!r}' for name in FIELDS)})"
