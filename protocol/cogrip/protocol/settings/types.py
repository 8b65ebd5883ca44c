"""Types of settings with their bounds."""

from typing import Annotated, Literal

import msgspec

Decimator = Literal["boxcar", "lowpass", "none"]
Encoder = Literal["displacement", "velocity"]
Side = Literal["left", "right"]
ServerStep = Literal["passive", "paper"]
Prefer = Literal["light", "balanced", "stiff"]
Concealed = Literal["zero", "repaid", "tank", "elastic"]
Auto = Literal["auto"]
Orientation = Literal["", "driven", "free", "damped", "fixed"]

# Lower bounds are above 0: a settings file or a welcome with 1e-320 in it would bring infinities into every law.
Impedance = Annotated[float, msgspec.Meta(ge=1e-3, le=1e4)]
FilterHz = Annotated[float, msgspec.Meta(ge=0.0, le=1e3)]
RotationalImpedance = Annotated[float, msgspec.Meta(ge=1e-6, le=1e2)]
Stiffness = Annotated[float, msgspec.Meta(ge=0.0, le=1e7)]
MOST_RENDERED_NPM = 1e9
Rendered = Annotated[float, msgspec.Meta(ge=0.0, le=MOST_RENDERED_NPM)]
Damping = Annotated[float, msgspec.Meta(ge=0.0, le=1e4)]
Mass = Annotated[float, msgspec.Meta(ge=1e-6, le=1e3)]
NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9 ._-]*\Z"
Name = Annotated[str, msgspec.Meta(min_length=1, max_length=40, pattern=NAME_PATTERN)]
Watts = Annotated[float, msgspec.Meta(ge=0.0, le=1e9)]
RecordBound = Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]
Seed = Annotated[int, msgspec.Meta(ge=0, le=2**53)]
Seconds = Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]
SeatNumber = Annotated[int, msgspec.Meta(ge=0, le=255)]
HUMAN_POWER_W = 10.0  # mean power of a hand on a hand-sized device (docs/security.md)
PINCH = "pinch"  # tool of a hand with a gripper; "pinch:BODY" is a body of the scene
MOST_PARTNERS = 7  # most partners whose intentions one message has room for
MOST_WAVES = 78  # most waves of one datagram, over all axes
