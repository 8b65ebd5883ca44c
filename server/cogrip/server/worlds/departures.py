"""Departures: bodies that left the workspace, each the first time, for the summary and as a marker for everybody.

Bodies may leave: a thing that is shoved glides on, a ball rolls off its board. That is no instability; numbers that are not
finite, or that grow beyond what hands bring about, are.
"""

from collections.abc import Sequence
from math import hypot, isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES

if TYPE_CHECKING:
    from cogrip.server.worlds.world import World

MOST_SPEED_MPS = 10.0
"""Speed above which an object that leaves is unstable: no plausible hand brings it about (docs/verdict.md)."""


class Departure(NamedTuple):
    """A body that left the workspace: its name, when that was, and where it was then, from its start."""

    what: str
    at_s: float
    position_m: Row

    @property
    def table(self) -> dict[str, Any]:
        """Return it as `summary.json` has it."""
        return {"what": self.what, "at_s": self.at_s, "position_m": list(self.position_m)}


def left_text(what: str) -> str:
    """Return the marker that tells of a body that left the workspace."""
    return f"{what} left the workspace"


def put_back_text(what: str) -> str:
    """Return the marker that tells of a body that nobody could reach any more, or of a world that could not go on."""
    return f"{what} was put back where it started"


def growth(place_m: Sequence[float], velocity_mps: Sequence[float]) -> str:
    """Return why an object outside of the workspace is unstable, "" where it has merely left."""
    speed_mps = hypot(*velocity_mps)
    if not (isfinite(speed_mps) and all(map(isfinite, place_m))):
        return f"place and velocity of the object are not finite: {tuple(place_m)} m, {tuple(velocity_mps)} m/s"
    if speed_mps > MOST_SPEED_MPS:
        return f"the object left the workspace at {speed_mps:.3g} m/s; no hand brings about more than {MOST_SPEED_MPS:g} m/s"
    return ""


def watch_object(world: "World", motion: Row, left: Sequence[Departure], unstable: str) -> str:
    """Let an object that is outside of the workspace depart, once; return why it is unstable, if it was not before.

    motion: of the object, its place and then its velocity; left: what has left so far; unstable: why the world was, so far
    """
    place, rates = motion[: world.places], motion[world.axes :][:PLACES]
    why = growth(place, rates)
    if not why and all(departure.what != world.object_name for departure in left):
        world.departed.append((world.object_name, place))
    return unstable or why


def let_leave(world: "World", left: list[Departure], now_s: float) -> None:
    """Note what has departed in this step, and tell everybody."""
    for what, place in world.departed:
        left.append(Departure(what, now_s, place))
        world.events.append(left_text(what))
    world.departed.clear()
