"""The library's axes and ours.

OpenHaptics has x right, y up, z toward the user, in mm; the common frame x toward the user, y right, z up, in m.
"""

from collections.abc import Sequence

from cogrip.devices.arm.kinematics import Vector


def to_common(position_mm: Sequence[float]) -> Vector:
    """A position of the library [mm] in our axes [m]."""
    right, up, near = position_mm
    return 0.001 * near, 0.001 * right, 0.001 * up


def to_library(force: Vector) -> Vector:
    """A force in our axes in those of the library [N]."""
    near, right, up = force
    return right, up, near
