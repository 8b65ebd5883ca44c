"""Step of a world as its room calls it, in every frame: typed where it is compiled, whatever the world is.

`WorldStep` asks the world. A world that is stepped in plain floats returns one of its own (`World.as_step`), which a room then
calls without an object for each number.
"""

from collections.abc import Sequence
from typing import Any

from cogrip.machine.rows import Row
from cogrip.protocol.settings.effects import Effect
from cogrip.server.worlds.accounts import Contact

WORKSPACE_M = 0.5  # distance beyond which the object has left the room
REACH_M = 2.0  # distance beyond which no hand reaches the object: it is put back


class WorldStep:
    """Step of any world. Each method is the world's method or property of the same name, `contact_of` that of its accounts."""

    def __init__(self, world: Any) -> None:
        self._world = world

    def advance(self, rows: Sequence[Row]) -> Sequence[Sequence[float]]:
        answers: Sequence[Sequence[float]] = self._world.advance(rows)
        return answers

    def motion(self) -> Row:
        state: Row = self._world.motion()
        return state

    def proxy_of(self, user: int) -> Row:
        place: Row = self._world.proxy_of(user)
        return place

    def force_of(self, user: int) -> Row:
        force: Row = self._world.force_of(user)
        return force

    def contact_of(self, user: int) -> Contact:
        contact: Contact = self._world.accounts.contact(user)
        return contact

    def port_work_j(self) -> Sequence[float]:
        work_j: Sequence[float] = self._world.port_work_j()
        return work_j

    def engaged_at(self, user: int) -> Row:
        place: Row = self._world.engaged_at(user)
        return place

    def effects_of(self, user: int) -> Sequence[Effect]:
        effects: Sequence[Effect] = self._world.effects_of(user)
        return effects

    def take_events(self) -> Sequence[str]:
        events: Sequence[str] = self._world.take_events()
        return events

    def left_workspace(self) -> bool:
        return bool(self._world.left_workspace)

    def out_of_reach(self) -> bool:
        return bool(self._world.out_of_reach)
