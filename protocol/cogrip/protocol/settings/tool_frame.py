"""How a hand's motion becomes its tool's: scales, rotation and clutch button of one seat (theory 1.1).

g position scale, s force scale, R rotation from the device's frame to the world's:

    v_w = g R v_h        F_h = (s / g) R^T F_w
"""

from collections.abc import Sequence
from math import fsum, isfinite, pi, sqrt
from typing import Annotated

import msgspec

from cogrip.protocol.axes import PLACES
from cogrip.protocol.laws.rotations import UNTURNED, Quaternion, exp, of_matrix, turned

LEAST_SCALE, MOST_SCALE = 0.1, 10.0
AXES = "xyz"
ROTATION = (
    "rotation = {!r} is none; write three angles [rad], as [0.0, 0.0, 1.571], or which axes of the device are x, y, z of the "
    'world: "y -x z"'
)

Scale = Annotated[float, msgspec.Meta(ge=LEAST_SCALE, le=MOST_SCALE)]
Part = Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)]
Button = Annotated[int, msgspec.Meta(ge=0, le=32)]
Angle = Annotated[float, msgspec.Meta(ge=-2.0 * pi, le=2.0 * pi)]
RotationText = Annotated[str, msgspec.Meta(max_length=16)]
# A tuple of fixed length beside a text crashes msgspec 0.22 in its garbage collection.
Rotation = Annotated[tuple[Angle, ...], msgspec.Meta(min_length=PLACES, max_length=PLACES)] | RotationText


class ToolFrame(msgspec.Struct, frozen=True, array_like=True):
    """rotation: R, a unit quaternion (w, x, y, z); clutch_button: from 1, 0 for none."""

    position_scale: Scale = 1.0
    force_scale: Scale = 1.0
    rotation: tuple[Part, Part, Part, Part] = UNTURNED
    clutch_button: Button = 0

    def __post_init__(self) -> None:
        size = sqrt(fsum(part * part for part in self.rotation))
        if not (isfinite(size) and abs(size - 1.0) <= 1e-6):
            raise ValueError(f"rotation of length {size:g} is no unit quaternion; divide it by its length")

    def stiffest(self, axes: int) -> float:
        """Return impedance, or stiffness, at the hand by that of the tool: s, and behind the places s / g^2; the larger one."""
        turning = self.force_scale / self.position_scale**2 if axes > PLACES else 0.0
        return max(self.force_scale, turning)

    def keeps(self, axes: int) -> bool:
        """Return whether the first `axes` axes of the device stay those of the world."""
        if axes >= PLACES:
            return True
        rows = [turned(self.rotation, [float(row == column) for row in range(PLACES)]) for column in range(PLACES)]
        return all(abs(rows[here][there]) < 1e-9 for here in range(axes) for there in range(axes, PLACES))


def rotation_of(written: Sequence[float] | str) -> Quaternion:
    """Return R of a setting: a rotation vector [rad], or device axes by world axis, "y -x z". Raises ValueError."""
    if not isinstance(written, str):
        return exp(written)
    if not written:
        return UNTURNED
    names = written.replace(",", " ").split()
    if (
        len(names) != PLACES
        or sorted(name.lstrip("+-") for name in names) != list(AXES)
        or any(len(name) > 2 for name in names)
    ):
        raise ValueError(ROTATION.format(written))
    rows = [[float(name[-1] == axis) * (-1.0 if name[0] == "-" else 1.0) for axis in AXES] for name in names]
    (a, b, c), (d, e, f), (g, h, i) = rows
    if a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) < 0.0:
        raise ValueError(f"rotation = {written!r} is a reflection, no rotation; turn the sign of one axis")
    found = of_matrix(rows)
    assert found is not None
    return found
