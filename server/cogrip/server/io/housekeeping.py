"""Housekeeping of a live server between its ticks, waiting for nothing: orders, tokens, checkpoints, metrics."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from math import hypot
from pathlib import Path
from types import MappingProxyType
from typing import Protocol

from cogrip.machine.addition import add_integers
from cogrip.protocol.settings.tool_frame import ToolFrame
from cogrip.server import inputs
from cogrip.server.administration.orders import (
    NO_CLUSTER,
    CloseRoomOrder,
    DrainOrder,
    KickOrder,
    MarkOrder,
    NewRoomOrder,
    OrderReply,
    Orders,
    ReloadOrder,
    Request,
    RoomEntry,
    SetHandOrder,
    SetRoomOrder,
    WhoOrder,
)
from cogrip.server.admission.roster import MOST_LISTED, RosterEntry, roster_of
from cogrip.server.checkpoint import CheckpointError, decode, encode
from cogrip.server.events import ServerEvent
from cogrip.server.io.authenticator import READING
from cogrip.server.io.checkpoint_file import CheckpointWriter, WriterThread
from cogrip.server.io.control import Control
from cogrip.server.io.hand_orders import AwaitedOrders
from cogrip.server.io.loop import LiveServer
from cogrip.server.io.published_state import PublishedState
from cogrip.server.io.rooms_on_demand import EMPTY_S, RoomsOnDemand
from cogrip.server.io.service_notify import ServiceNotifier
from cogrip.server.io.state_folder import StateError, StateFolder
from cogrip.server.io.trigger import Trigger
from cogrip.server.room import Room
from cogrip.server.snapshot import Snapshot, SnapshotMaker

EVERY_NS = 500_000_000  # time between two writings of checkpoints and metrics
POLL_EVERY_NS = 50_000_000  # time between two looks for orders
TURNS = EVERY_NS // POLL_EVERY_NS

Say = Callable[[ServerEvent], None]


class Tokens(Protocol):
    """Tokens that are void by now; `TokenAuthenticator` says what each function does."""

    @property
    def not_written(self) -> str: ...

    def revoke(self, ident: str) -> None: ...

    def revoke_room(self, room: str) -> None: ...

    def revoked(self) -> set[str]: ...

    def expired(self) -> set[str]: ...

    def reload(self) -> bool | None: ...

    def read_on(self) -> None: ...

    def close(self) -> None: ...


class Checkpoints(Protocol):
    """Checkpoints of one room; `CheckpointWriter` says what each function does."""

    path: Path

    @property
    def failures(self) -> int: ...

    @property
    def trouble(self) -> str: ...

    def put(self, data: bytes) -> None: ...

    def read(self) -> bytes | None: ...

    def remove(self) -> None: ...

    def close(self) -> None: ...


class Measures(Protocol):
    """Reader of snapshots, such as `MetricsFeed`. address: of their page; "" where they have none of their own."""

    not_taken: int

    @property
    def address(self) -> str: ...

    def put(self, snapshot: Snapshot) -> None: ...

    def close(self) -> None: ...


class Housekeeping:
    """Chores of one live server that listens: `begin` before it runs, `end` after. Each part may be missing.

    published      what the server has published, written again and again
    more_degraded  says what else cannot be written now, and why (`Snapshot.degraded`)
    """

    def __init__(
        self,
        server: LiveServer,
        say: Say,
        *,
        folder: StateFolder | None = None,
        authenticator: Tokens | None = None,
        metrics: Measures | None = None,
        trigger: Trigger | None = None,
        software: str = "",
        fresh: bool = False,
        orders: Orders | None = None,
        checkpoints: Callable[[str, Callable[[str], None]], Checkpoints] | None = None,
        templates: Mapping[str, Sequence[str]] = MappingProxyType({}),
        room_changed: Callable[[Room, bool], object] = lambda room, opened: None,
        empty_s: float = EMPTY_S,
    ) -> None:
        """fresh: begin with every object at its start, whatever checkpoints there are. Raises ControlError.

        orders: source of orders; that of the folder if not given
        checkpoints: makes those of a room, given what reports a failure; files of the folder if not given
        templates: names of the spare rooms of each template; empty_s: how long one that was opened may be empty
        room_changed: is called with a room that was opened, or is about to be closed
        """
        self.published: PublishedState | None = None
        self.more_degraded: Callable[[], Mapping[str, str]] = dict
        self._fresh = fresh
        self._server = server
        self._say = say
        self._authenticator = authenticator
        self._metrics = metrics
        self._trigger = trigger
        server.marked = trigger.fire if trigger else None
        self._notifier = ServiceNotifier()
        self._control = orders or (Control(folder) if folder else None)
        if isinstance(self._control, Control):
            self._say = server.say = self._control.publishing(say)
            self._control.metrics_at = metrics.address if metrics is not None else ""
        self._tell_room = room_changed
        self._on_demand = RoomsOnDemand(server.core, entry_of, self._room_changed, empty_s)
        for template, spare in templates.items():
            server.core.handle(inputs.SpareRooms(template, tuple(spare)), time.monotonic_ns())
        self._hand_orders = AwaitedOrders(server.core, lambda request, text, ok: self._answer(request, text, ok))
        self._writers: dict[str, Checkpoints] = {}
        self._thread: WriterThread | None = None  # of all writers
        rooms = [room.name for room in server.core.rooms]
        if checkpoints:
            self._writers = {room: checkpoints(room, self._report_trouble) for room in rooms}
        elif folder:
            self._thread = WriterThread()
            self._writers = {
                room: CheckpointWriter(folder.checkpoint(room), self._report_trouble, self._thread) for room in rooms
            }
        self._kept: list[tuple[int, str, ToolFrame]] = []  # sessions, ticket hashes and tools' frames of all seats
        self._reported_limits: set[tuple[int, str]] = set()
        self._numbers = {room: number for number, room in enumerate(server.core.rooms)}
        self._used: dict[Room, None] = {}  # rooms where somebody is, or was after their last checkpoint
        self._maker = SnapshotMaker(server.core.rooms, server.pacers, software)
        self._poll_ns = self._next_ns = self._watchdog_ns = 0
        self._turn = 0
        self._told_trouble = False  # of the trigger

    def _report_trouble(self, text: str) -> None:
        self._say(ServerEvent("trouble", text))

    def begin(self) -> None:
        """Go on from the checkpoints of a server that did not end in order; notify that all is ready."""
        core = self._server.core
        if self._thread is not None:
            self._thread.begin()
        if self.published is not None:
            self.published.begin()
        for room, writer in self._writers.items():
            try:
                data = writer.read()
                if data is not None and self._fresh:
                    text = f"{room}: begins at its start (--fresh): a checkpoint is left aside"
                    self._say(ServerEvent("notice", text, room))
                    writer.remove()
                elif data is not None:
                    core.handle(inputs.Restore(decode(data)), time.monotonic_ns())
            except (CheckpointError, StateError, OSError) as error:
                self._report_trouble(f"{writer.path}: room {room} begins anew: {error}")
        self._end_revoked()  # before anybody resumes a restored seat
        while core.events:
            self._say(core.events.popleft())
        self._server.chores.append(self.chore)
        self._notifier.ready(f"rooms: {', '.join(room.name for room in core.rooms)}")

    def chore(self, now_ns: int) -> None:
        """Do what is due. Called between two ticks."""
        if now_ns < self._poll_ns:
            return
        self._poll_ns = now_ns + POLL_EVERY_NS
        self._look_for_people()
        self._turn = (self._turn + 1) % TURNS  # each room once in EVERY_NS: no tick has to wait for many at once
        self._write_checkpoints([room for room in self._used if self._numbers[room] % TURNS == self._turn])
        self._read_tokens(now_ns)
        if self._control is not None:
            for request in self._control.poll(now_ns):
                self._obey(request)
            self._hand_orders.poll(now_ns)
        seats = [seat for room in self._used for seat in room.seats]
        kept = [(seat.session, seat.ticket_hash, seat.hand.wanted) for seat in seats]
        if kept != self._kept:  # the next server must know a new session too, and what a hand was set to
            self._kept = kept
            self.write_checkpoints()
        self._take_triggers()
        if now_ns >= self._next_ns:
            self._next_ns = now_ns + EVERY_NS
            self._end_revoked()
            self._report_limits()
            self._on_demand.close_empty(now_ns)
            if self.published is not None:
                self.published.chore(now_ns)
            for room in self._server.core.rooms if self._writers else ():
                if self._writers[room.name].trouble:  # written again, also where nobody is any more
                    self._used[room] = None
            degraded = self.degraded()  # said by its parts, whoever reads the metrics
            if self._metrics is not None:
                self._metrics.put(self._snapshot(degraded))
        every_ns = self._notifier.watchdog_every_ns
        if every_ns is not None and now_ns >= self._watchdog_ns:
            self._watchdog_ns = now_ns + every_ns
            self._notifier.watchdog()

    def degraded(self) -> dict[str, str]:
        """Return what cannot be written now, and why."""
        troubles = {name: writer.trouble for name, writer in self._writers.items() if writer.trouble}
        some = next(iter(troubles), "")
        more = f", and of {len(troubles) - 1} rooms more" if len(troubles) > 1 else ""
        parts = {
            "checkpoints": f"of room {some}{more}: {troubles[some]}" if troubles else "",
            "tokens": self._authenticator.not_written if self._authenticator is not None else "",
            "orders": self._control.trouble if isinstance(self._control, Control) else "",
            "recording": self._server.not_recorded,
        }
        if self.published is not None:
            parts[self.published.name] = self.published.trouble
        return {name: why for name, why in {**parts, **self.more_degraded()}.items() if why}

    def counts(self) -> dict[str, int]:
        """Return the counts of what failed, by name."""
        counts = {
            "metrics not taken": self._metrics.not_taken if self._metrics else 0,
            "checkpoint not written": add_integers(writer.failures for writer in self._writers.values()),
            "service manager not told": self._notifier.failed,
        }
        counts |= self._trigger.counts if self._trigger else {}
        return {name: count for name, count in counts.items() if count}

    def _take_triggers(self) -> None:
        """Record when markers were written to the trigger line; report once where one could not be."""
        if self._trigger is None:
            return
        for written in self._trigger.take():
            now_ns = time.monotonic_ns()
            given = inputs.TriggerWritten(written.text, written.code, written.after_ns, now_ns - written.at_ns)
            self._server.core.handle(given, now_ns)
        if self._trigger.trouble and not self._told_trouble:
            self._told_trouble = True
            self._report_trouble(self._trigger.trouble)

    def _snapshot(self, degraded: Mapping[str, str]) -> Snapshot:
        server = self._server
        server.count_deserted(time.monotonic_ns(), steps=False)
        failed = {**server.losses(), **self.counts()}
        return self._maker.make(
            server.elapsed_s, server.drops(), datagrams=server.datagrams, failed=failed, degraded=degraded
        )

    def end(self, *, said_goodbye: bool) -> None:
        """End with the server. said_goodbye: nobody resumes these sessions, so that no checkpoint is left."""
        said_goodbye = said_goodbye and not self._server.hands_over
        if self._server.hands_over:
            self.write_checkpoints()
        self._notifier.stopping()
        if self._trigger is not None:
            self._trigger.close()
        if self._control is not None:
            self._control.close()
        for writer in self._writers.values():
            writer.close()
            if said_goodbye:
                with suppress(OSError):
                    writer.remove()
        if self.published is not None:
            self.published.close()
        if self._authenticator is not None:
            self._authenticator.close()
        if self._metrics is not None:
            self._metrics.close()
        self._notifier.close()

    def write_checkpoints(self) -> None:
        """Write checkpoints of all rooms that have changed since; `end` waits for them."""
        self._look_for_people()
        self._write_checkpoints(list(self._used))

    def _room_changed(self, room: Room, opened: bool) -> None:
        """Write the checkpoint of a room on demand; revoke the tokens of one that is about to be closed."""
        self._used[room] = None
        self._tell_room(room, opened)
        if not opened and self._authenticator is not None:
            self._authenticator.revoke_room(room.called)

    def _look_for_people(self) -> None:
        self._used.update((room, None) for room in self._server.awake if not room.deserted)

    def last_checkpoint(self) -> bytes:
        """Write what waits, and no more. Return the checkpoint of the first room as it is now."""
        for writer in self._writers.values():
            writer.close()
        self._server.count_deserted(time.monotonic_ns())
        return encode(self._server.core.rooms[0].checkpoint())

    def _write_checkpoints(self, rooms: Sequence[Room]) -> None:
        for room in rooms:
            if room.deserted:
                del self._used[room]
            if self._writers:
                self._writers[room.name].put(encode(room.checkpoint()))

    def _report_limits(self) -> None:
        """Report once for each session of a seat and each reason."""
        now, events = set(), self._server.events
        for room in self._server.awake:
            for number, seat in enumerate(() if room.deserted else room.seats):
                for reason in room.limited(number):
                    now.add(what := (seat.session, reason))
                    if what not in self._reported_limits:
                        words = f"{room.called}: {seat.name} brings in more than the seat may: {reason}"
                        events.append(ServerEvent("limited", words, room.called, seat.name, token=seat.token))
        self._reported_limits = now

    def _read_tokens(self, now_ns: int) -> None:
        """Read tokens again where that was asked for (SIGHUP), and on where a reading has not ended."""
        if self._authenticator is not None:
            self._authenticator.read_on()
        if self._server.stop.take_reload():
            self._notifier.reloading(now_ns)
            self._reload()
            self._notifier.ready()

    def _reload(self) -> tuple[str, bool]:
        if self._authenticator is None:
            text = "nothing to read again: this server takes no tokens"
            self._say(ServerEvent("reloaded", text))
            return text, True
        good = self._authenticator.reload()
        ended = self._end_revoked()
        if good is None:
            return READING, True
        words = f"tokens were read again, sessions ended: {ended}" if good else "tokens could not be read; see the log"
        return words, good

    def _end_revoked(self) -> int:
        """End sessions of revoked tokens, and the right to resume those of expired ones. Returns how many were ended."""
        if self._authenticator is None:
            return 0
        core, now_ns = self._server.core, time.monotonic_ns()
        if expired := self._authenticator.expired():
            core.handle(inputs.Expire(tuple(sorted(expired))), now_ns)
        revoked = self._authenticator.revoked()
        return core.handle(inputs.Revoke(tuple(sorted(revoked))), now_ns) if revoked else 0

    def _obey(self, request: Request) -> None:
        entries: list[RosterEntry] = []
        match request.order:
            case KickOrder() as order:
                text, ok = self._kick(order)
            case MarkOrder() as order:
                text, ok = self._mark(order)
            case SetHandOrder() as order:
                self._hand_orders.obey(request, order, time.monotonic_ns())
                return
            case SetRoomOrder() as order:
                text, ok = self._set_room(order)
            case NewRoomOrder() as order:
                self._reply(request, self._on_demand.open(order))
                return
            case CloseRoomOrder() as order:
                text, ok = self._on_demand.close(order.room, "by the administrator")
            case ReloadOrder():
                text, ok = self._reload()
            case DrainOrder():
                text, ok = NO_CLUSTER, False
            case WhoOrder() as order:
                text, ok, entries = self._who(order)
            case _:
                self._reply(request, self._status())
                return
        self._answer(request, text, ok, entries)

    def _answer(self, request: Request, text: str, ok: bool, people: Sequence[RosterEntry] = ()) -> None:
        self._reply(request, OrderReply(ok, text, tuple(people)))

    def _reply(self, request: Request, reply: OrderReply) -> None:
        assert self._control is not None
        self._control.answer(request, reply)

    def _kick(self, order: KickOrder) -> tuple[str, bool]:
        core = self._server.core
        named = [
            who
            for room, who in core.roster()
            if who.name == order.user and room.is_open and order.room in ("", room.called)
        ]
        tokens = {who.token for who in named} - {""}
        if not core.handle(inputs.Kick(order.user, order.room, order.reason), time.monotonic_ns()):
            here = ", ".join(who.name for _, who in core.roster())
            return f"nobody here is {order.user!r}; there is: {here or 'nobody'}", False
        if not order.revoke:
            return f"{order.user} was kicked", True
        if self._authenticator is not None:
            for token in tokens:
                self._authenticator.revoke(token)
        revoked = f"revoked: {', '.join(sorted(tokens))}" if tokens else "there was no token to revoke"
        return f"{order.user} was kicked; {revoked}", True

    def _mark(self, order: MarkOrder) -> tuple[str, bool]:
        now_ns = time.monotonic_ns()
        self._server.count_deserted(now_ns, order.room)  # the marker has a step
        rooms = self._server.core.handle(inputs.Mark(order.text, order.room), now_ns)
        return (
            (f"marked in {rooms} room{'s' if rooms != 1 else ''}: {order.text}", True)
            if rooms
            else ("no such room", False)
        )

    def _set_room(self, order: SetRoomOrder) -> tuple[str, bool]:
        core = self._server.core
        rooms = [room for room in core.rooms if room.is_open and order.room in ("", room.called)]
        if len(rooms) != 1:
            names = ", ".join(room.called for room in core.rooms if room.is_open)
            return (
                f"there are several rooms; name one by --room: {names}" if rooms else f"there is no room {order.room!r}"
            ), False
        (room,) = rooms
        if why := room.unfit_change(order.change):
            return f"{room.called}: {why}", False
        now_ns = time.monotonic_ns()
        self._server.count_deserted(now_ns, room.called)  # the change has a step
        core.handle(inputs.SetRoom(order.change, room.called), now_ns)
        return f"{room.called}: {order.change.text}{', within some seconds' if order.change.is_ramped else ''}", True

    def _who(self, order: WhoOrder) -> tuple[str, bool, list[RosterEntry]]:
        rooms = [room for room in self._server.core.rooms if room.is_open and order.room in ("", room.called)]
        if not rooms and order.room:
            return f"there is no room {order.room!r} here", False, []
        entries = roster_of(rooms, time.monotonic_ns())
        more = len(entries) - MOST_LISTED
        words = f"{len(entries)} in {len(rooms)} room{'s' if len(rooms) != 1 else ''}" if entries else "nobody is here"
        return f"{words}; {more} are not listed" if more > 0 else words, True, entries[:MOST_LISTED]

    def _status(self) -> OrderReply:
        server = self._server
        server.count_deserted(time.monotonic_ns())
        rooms = [room for room in server.core.rooms if room.is_open][:MOST_LISTED]
        names = [
            f"{room.called}: {', '.join(seat.name for seat in room.seats if seat.state == 'seated') or 'nobody'}"
            for room in rooms
        ]
        spare = [f"{count} spare of {name}" for name, count in self._on_demand.spare().items()]
        text = "; ".join([f"up for {server.elapsed_s:.0f} s", *names, *spare])
        return OrderReply(True, text, rooms=tuple(map(entry_of, rooms)), degraded=self.degraded())


def entry_of(room: Room) -> RoomEntry:
    motion, axes, places = room.world_step.motion(), room.world.axes, room.world.places
    seated = add_integers(seat.state == "seated" for seat in room.seats)
    return RoomEntry(
        room.called, len(room.seats), seated, len(room.observer_slots.observers), room.steps, motion[:places],
        hypot(*motion[axes : axes + places]), room.changes.text, room.template, dict(room.labels),
    )  # fmt: skip
