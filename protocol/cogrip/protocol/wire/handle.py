"""Handle of a device on the wire: buttons, orientation, gripper (`SPEC.md` section 3.6)."""

from collections.abc import Sequence
from typing import Annotated

import msgspec

from cogrip.machine.addition import add_floats

MOST_BUTTONS = 32  # most buttons of one handle
MOST_EDGES = 16  # most edges that a client has sent and not seen acknowledged
MOST_AT_ONCE = 2
"""Most messages of edges between two frames: with the frames' own, 3/4 of what a server lets a peer send."""
MOST_AGE = 65535  # largest age of an edge [ticks]: an older one is told with this age
Buttons = Annotated[int, msgspec.Meta(ge=0, le=2**MOST_BUTTONS - 1)]
EdgeCount = Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)]
Edge = Annotated[int, msgspec.Meta(ge=-MOST_BUTTONS, le=MOST_BUTTONS)]  # button from 1; above 0 down, below 0 up
Age = Annotated[int, msgspec.Meta(ge=0, le=MOST_AGE)]
Opening = Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)]  # opening of a gripper [m]
UNIT = 1e-3  # most by which the sum of a unit quaternion's squares may be off 1
Quaternion = Annotated[tuple[float, ...], msgspec.Meta(min_length=4, max_length=4)]  # quaternion w, x, y, z


class Handle(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """State of a device beside its axes: edges of buttons that are not acknowledged yet, and newest values.

    Edge n of the seat session, from 0, is `edges[n - first]`, `ages[n - first]` device ticks before this was sent.
    """

    first: EdgeCount
    edges: Annotated[tuple[Edge, ...], msgspec.Meta(max_length=MOST_EDGES)]
    ages: Annotated[tuple[Age, ...], msgspec.Meta(max_length=MOST_EDGES)]
    orientation: Quaternion | None = None
    grip_m: Opening | None = None

    def __post_init__(self) -> None:
        if len(self.ages) != len(self.edges) or not all(self.edges):
            raise ValueError("edges of no button, or without their ages")
        if self.orientation is not None and not is_unit(self.orientation):
            raise ValueError("the orientation is no unit quaternion")


def is_unit(quaternion: Sequence[float]) -> bool:
    """Return whether this is a unit quaternion."""
    return len(quaternion) == 4 and abs(add_floats([each * each for each in quaternion]) - 1.0) <= UNIT
