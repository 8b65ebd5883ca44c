"""Administration of a running server from Python: what `cogrip set`, `who`, `mark` and `kick` do, and its events."""

import asyncio
import time
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from cogrip.api.errors import ApiError, as_api_error
from cogrip.cli.admin.room_new import links_of
from cogrip.cli.admin.state_folder import server_at
from cogrip.cli.admin.token_new import place_of_link
from cogrip.protocol.wire.join_link import DEFAULT_PORT, JoinLink
from cogrip.protocol.wire.messages import Role
from cogrip.server.administration.operations import AskedOrder, EventFilter, SetBody
from cogrip.server.administration.orders import (
    CloseRoomOrder,
    KickOrder,
    MarkOrder,
    NewRoomOrder,
    OrderReply,
    RoomEntry,
    StatusOrder,
    WhoOrder,
)
from cogrip.server.admission.roster import RosterEntry
from cogrip.server.events import ServerEvent
from cogrip.server.io.control import ask, events_of
from cogrip.server.io.state_folder import ServerRecord, StateFolder, find_folder, state_path
from cogrip.server.io.token_file import TokenFile, draw_token


class NewRoom(NamedTuple):
    """Room on demand that was opened. links: by role, "player" and "observer"; secrets."""

    name: str
    links: Mapping[str, str]


class Administration:
    """A running server, as its administrator has it.

    Parameters
    ----------
    state
        The server's state folder (`cogrip serve --state`); else that of `port`.
    port
        The server's port on this machine.

    Each method raises ApiError where the server does not run, or refuses; the text says why.
    """

    def __init__(self, state: str | Path | None = None, port: int = DEFAULT_PORT) -> None:
        path = state_path(None if state is None else Path(state), port)
        if path is None:
            raise ApiError("a server on port 0 has no folder of its own; name its --state")
        with as_api_error():
            self.folder: StateFolder = find_folder(path)
        self._seen = -1  # number of the event that `wait_for` went by last

    def set(self, name: str = "", /, *, room: str = "", **values: Any) -> str:
        """Change settings of a person (`name`), or of a room, while people hold the object; return what holds then.

        Keys are those of `cogrip set`; those of a room with two underscores for the dot: `object__mass_kg=0.5`.
        """
        given = {key.replace("__", "."): value for key, value in values.items()}
        return self._ask(SetBody(given, name, room)).text

    def mark(self, text: str, room: str = "") -> None:
        """Set a marker in every recording of the session."""
        self._ask(MarkOrder(text, room))

    def kick(self, name: str, reason: str = "", *, room: str = "", revoke: bool = False) -> None:
        """End somebody's session. revoke: void their token too."""
        self._ask(KickOrder(name, room, reason, revoke))

    def who(self, room: str = "") -> Sequence[RosterEntry]:
        """Return everybody who is seated or observes, with round trip and delays each way [ms]."""
        return self._ask(WhoOrder(room)).people

    def rooms(self) -> Sequence[RoomEntry]:
        """Return each room, with place [m] and speed [m/s] of its object."""
        return self._ask(StatusOrder()).rooms

    def new_room(self, template: str, name: str = "", labels: Mapping[str, str] | None = None) -> NewRoom:
        """Open a room on demand; one is named by the server where `name` is "". An unencrypted server gives no links."""
        reply = self._ask(NewRoomOrder(template, name, dict(labels or {})))
        (room,) = reply.rooms
        server = self._server()
        with as_api_error():
            return NewRoom(room.name, links_of(self.folder, server, room.name, "") if server.fingerprint else {})

    def close_room(self, name: str) -> None:
        """Close a room on demand: whoever is in it is sent out, and its links are void."""
        self._ask(CloseRoomOrder(name))

    def new_token(
        self, *, role: Role = "player", room: str = "", seat: str = "", device: str = "", once: bool = False,
        seconds: float | None = None, note: str = "",
    ) -> str:  # fmt: skip
        """Make a token of these terms, good for `seconds` or for ever; return its join link, which is a secret."""
        server, secret, now_s = self._server(), draw_token(), time.time()
        if not server.fingerprint:
            raise ApiError("the server is unencrypted, and asks nobody for a token; serve it with --encrypted")
        expires = None if seconds is None else int(now_s + seconds)
        terms: dict[str, Any] = {
            "role": role, "room": room, "user": seat, "device": device, "once": once, "expires": expires, "note": note
        }  # fmt: skip
        with as_api_error():
            link = JoinLink(*place_of_link("", server), room, server.fingerprint, secret).text
            TokenFile(self.folder).change(lambda book: book.new(secret, now_s, **terms))
        return link

    def _server(self) -> ServerRecord:
        with as_api_error():
            server = server_at(self.folder)
        if server is None:
            raise ApiError(f"{self.folder.path}: no server has been started here; start `cogrip serve` first")
        return server

    def events(self, event: str = "", *, room: str = "", seconds: float | None = None) -> Iterator[ServerEvent]:
        """Give the server's events as they come, of one kind where `event` is given, until it ends or `seconds` are over."""
        for _, each in self._events(EventFilter(room, event), seconds):
            yield each

    def _events(self, takes: EventFilter, seconds: float | None) -> Iterator[tuple[int, ServerEvent]]:
        until_s = None if seconds is None else time.monotonic() + seconds
        try:
            with as_api_error():
                yield from events_of(self.folder, takes, until_s)
        except TimeoutError:
            return

    def wait_for(
        self, event: str, *, user: str = "", text: str = "", room: str = "", seconds: float | None = None
    ) -> ServerEvent:
        """Return the next event of a kind, of this person and with this text in it. Raises ApiError after `seconds`.

        The first call waits for what is to come, each further one goes on where the one before ended, so that nothing between
        the two is missed: the server keeps the last 256 events.
        """
        for number, each in self._events(EventFilter(room, event, self._seen), seconds):
            if user in ("", each.user) and text in each.text:
                self._seen = number
                return each
        late = "the server ended" if seconds is None else f"it did not come within {seconds:g} s"
        raise ApiError(f"no {event!r} of {user or 'anybody'}: {late}")

    def _ask(self, order: AskedOrder) -> OrderReply:
        with as_api_error():
            reply = ask(self.folder, order)
        if not reply.ok:
            raise ApiError(reply.text)
        return reply


class AsyncAdministration:
    """The same for programs with an event loop: each method is `Administration`'s, to be awaited."""

    def __init__(self, state: str | Path | None = None, port: int = DEFAULT_PORT) -> None:
        self._plain = Administration(state, port)

    async def set(self, name: str = "", /, *, room: str = "", **values: Any) -> str:
        return await asyncio.to_thread(self._plain.set, name, room=room, **values)

    async def mark(self, text: str, room: str = "") -> None:
        await asyncio.to_thread(self._plain.mark, text, room)

    async def kick(self, name: str, reason: str = "", *, room: str = "", revoke: bool = False) -> None:
        await asyncio.to_thread(self._plain.kick, name, reason, room=room, revoke=revoke)

    async def who(self, room: str = "") -> Sequence[RosterEntry]:
        return await asyncio.to_thread(self._plain.who, room)

    async def rooms(self) -> Sequence[RoomEntry]:
        return await asyncio.to_thread(self._plain.rooms)

    async def new_room(self, template: str, name: str = "", labels: Mapping[str, str] | None = None) -> NewRoom:
        return await asyncio.to_thread(self._plain.new_room, template, name, labels)

    async def close_room(self, name: str) -> None:
        await asyncio.to_thread(self._plain.close_room, name)

    async def new_token(
        self, *, role: Role = "player", room: str = "", seat: str = "", device: str = "", once: bool = False,
        seconds: float | None = None, note: str = "",
    ) -> str:  # fmt: skip
        make = self._plain.new_token
        return await asyncio.to_thread(
            make, role=role, room=room, seat=seat, device=device, once=once, seconds=seconds, note=note
        )

    async def events(
        self, event: str = "", *, room: str = "", seconds: float | None = None
    ) -> AsyncIterator[ServerEvent]:
        found = self._plain.events(event, room=room, seconds=seconds)
        while (each := await asyncio.to_thread(next, found, None)) is not None:
            yield each

    async def wait_for(
        self, event: str, *, user: str = "", text: str = "", room: str = "", seconds: float | None = None
    ) -> ServerEvent:
        return await asyncio.to_thread(self._plain.wait_for, event, user=user, text=text, room=room, seconds=seconds)
