"""Which world a room's settings ask for."""

from collections.abc import Sequence

from cogrip.protocol.settings import SeatSettings
from cogrip.server.worlds.grip import GripWorld
from cogrip.server.worlds.lagged import CoupledWorld, PaperWorld
from cogrip.server.worlds.power import PowerWorld
from cogrip.server.worlds.push import PushWorld
from cogrip.server.worlds.small_room import MOST, SmallGripWorld
from cogrip.server.worlds.world import World

_PASSIVE: dict[str, type[World]] = {"cube": GripWorld, "faces": PushWorld, "wall": PushWorld}


def make_world(seats: Sequence[SeatSettings]) -> World:
    """The world for these seats, all of one room, shape n = len(seats)."""
    first = seats[0]
    if first.coupling.kind == "coupling":
        return CoupledWorld(seats)
    if first.coupling.kind == "tdpa":
        return PowerWorld(seats)
    if first.coupling.server_step == "paper":
        return PaperWorld(seats)
    if first.object.kind == "cube" and len(seats) * first.object.axes <= MOST:
        return SmallGripWorld(seats)
    return _PASSIVE[first.object.kind](seats)
