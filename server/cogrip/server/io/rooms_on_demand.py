"""Rooms on demand: spare rooms of a template are opened under a name, and closed when nobody has been there for a while.

Spare rooms are made as the server starts, as many as it is to have at most: no scene is compiled while people hold objects,
and what a server may use is known before anybody asks. A spare room is stepped never, and keeps its memory.
"""

import re
import secrets
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

from cogrip.protocol.settings.types import NAME_PATTERN
from cogrip.server import inputs
from cogrip.server.administration.orders import NewRoomOrder, OrderReply, RoomEntry
from cogrip.server.core import ServerCore
from cogrip.server.room import Room

EMPTY_S = 300.0  # time for which a room on demand may be empty, if nothing else is asked for
MOST_NAME = 40  # most characters of a name, as of any room
DRAWN = "abcdefghjkmnpqrstuvwxyz23456789"  # letters of a name that is drawn: none is taken for another


def drawn_name(template: str) -> str:
    """Return a name for a room of a template that nobody has named."""
    return f"{template[: MOST_NAME - 5]}-{''.join(secrets.choice(DRAWN) for _ in range(4))}"


def unfit_name(name: str) -> str:
    """Return why no room can have this name, "" where one can."""
    cure = "write letters, digits, blanks and . _ -, a letter or digit first, at most 40"
    fits = len(name) <= MOST_NAME and re.match(NAME_PATTERN, name)
    return "" if fits else f"{name!r} is no name of a room; {cure}"


def unknown_template(template: str, there: Iterable[str]) -> str:
    """Return that there is no such template, "" where there is."""
    known = [*there]
    words = ", ".join(known) or "none; start the server with --template FILE:COUNT"
    return "" if template in known else f"there is no template {template!r}; there is: {words}"


def all_open(template: str) -> str:
    """Return that no room of a template is left."""
    return f"all rooms of template {template!r} are open; close one, or wait until one has been empty for a while"


def none_opened(called: str, there: Iterable[str]) -> str:
    """Return that no room of this name was opened."""
    return f"no room {called!r} was opened on demand; there is: {', '.join(there) or 'none'}"


class RoomsOnDemand:
    """Those of one core. changed: is called with a room that was opened, or is about to be closed."""

    def __init__(
        self,
        core: ServerCore,
        entry: Callable[[Room], RoomEntry],
        changed: Callable[[Room, bool], None],
        empty_s: float,
    ) -> None:
        self._core, self._entry, self._changed, self._empty_ns = core, entry, changed, round(1e9 * empty_s)
        self._since_ns: dict[Room, int] = {}  # of open rooms: when somebody was there last

    def spare(self) -> Counter[str]:
        """Return how many rooms are left of each template."""
        templates = Counter({room.template: 0 for room in self._core.rooms if room.template})
        templates.update(room.template for room in self._core.rooms if room.template and not room.is_open)
        return templates

    def open(self, order: NewRoomOrder) -> OrderReply:
        """Open a room, or say why not."""
        if why := unknown_template(order.template, self.spare()):
            return OrderReply(False, why)
        room = next((room for room in self._core.rooms if room.template == order.template and not room.is_open), None)
        if room is None:
            return OrderReply(False, all_open(order.template))
        name = order.name or drawn_name(order.template)
        if why := unfit_name(name):
            return OrderReply(False, why)
        try:
            self._core.handle(inputs.OpenRoom(room.name, name, dict(order.labels)), time.monotonic_ns())
        except ValueError as error:
            return OrderReply(False, str(error))
        self._since_ns[room] = time.monotonic_ns()
        self._changed(room, True)
        return OrderReply(True, f"{name}: open, of template {order.template}", rooms=(self._entry(room),))

    def close(self, called: str, reason: str) -> tuple[str, bool]:
        """Close a room."""
        room = next(
            (room for room in self._core.rooms if room.is_open and room.template and room.called == called), None
        )
        if room is None:
            return none_opened(
                called, [each.called for each in self._core.rooms if each.is_open and each.template]
            ), False
        self._changed(room, False)
        self._since_ns.pop(room, None)
        ended = self._core.handle(inputs.CloseRoom(room.name, reason), time.monotonic_ns())
        return f"{called}: closed; sessions ended: {ended}", True

    def close_empty(self, now_ns: int) -> Sequence[str]:
        """Close the rooms that have been empty for too long. Return what was said of each."""
        said = []
        for room in self._core.rooms:
            if not (room.template and room.is_open):
                continue
            if not room.deserted:
                self._since_ns[room] = now_ns
            elif now_ns - self._since_ns.setdefault(room, now_ns) > self._empty_ns:
                said.append(self.close(room.called, f"empty for {1e-9 * self._empty_ns:g} s")[0])
        return said
