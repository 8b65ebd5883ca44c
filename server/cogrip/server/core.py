"""The server without I/O: messages in, messages out; many rooms, no socket, no clock."""

from collections.abc import Callable, Sequence
from typing import Any

from msgspec.structs import replace

from cogrip.protocol.line.received_waves import ReceivedWaves
from cogrip.protocol.secure.channel import Address
from cogrip.protocol.settings.rates import NS_PER_S
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.texts import clipped, shown
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.accounts import SeatAccount
from cogrip.protocol.wire.messages import (
    FRAMES,
    Edges,
    Effects,
    Farewell,
    Frame,
    Heartbeat,
    Hello,
    Leave,
    Mark,
    Restart,
    SetHand,
)
from cogrip.protocol.wire.session import LOST_NS, QUIET_NS, foreign_version, nonce_of, version_mismatch
from cogrip.server import inputs
from cogrip.server.admission.admission import AdmissionServices, Denied
from cogrip.server.admission.joining import Joining
from cogrip.server.admission.seat_assignment import Place, SeatTable
from cogrip.server.checkpoint import RoomCheckpoint
from cogrip.server.events import ServerEvent
from cogrip.server.outputs import Outputs
from cogrip.server.room import Room
from cogrip.server.seats.participants import Observer, Seat

MOST_BYTES = messages.MAX_MESSAGE_BYTES
FAREWELL_EVERY_NS = 50_000_000  # time between two farewells to a client that has not received one

_FRAMES = tuple(FRAMES.values())
FROM_CLIENTS = (*_FRAMES, Edges, Heartbeat, Leave, Mark, SetHand, Effects)


class ServerCore:
    """Routes datagrams, inputs and steps to rooms and participants. `outbox`, `events` and `dropped` are those of `outputs`."""

    def __init__(
        self, rooms: Sequence[Settings], software: str, services: AdmissionServices, outputs: Outputs | None = None
    ) -> None:
        self.rooms = [Room(settings) for settings in rooms]
        self._table = table = SeatTable(self.rooms)
        self._places = table.places
        self._waves = ReceivedWaves()  # of the datagram that is being received
        self._out = out = outputs or Outputs()
        self.outbox, self.events, self.dropped = out.outbox, out.events, out.dropped
        self._drop = out.drop
        self._joining = Joining(table, out, software, services)
        self._back_ns = -LOST_NS - 1  # the loop was late until then and read no datagrams: nobody counts as silent
        self._handlers: dict[type[inputs.ServerInput], Callable[[Any, int], int | None]] = {
            inputs.Stop: self._stop,
            inputs.Restart: self._restart,
            inputs.SocketFailed: lambda given, _: out.drop(f"socket: {given.reason}"),
            inputs.Kick: self._kick,
            inputs.Revoke: self._revoke,
            inputs.Expire: self._expire,
            inputs.UnbindAddress: lambda given, _: table.release(given.address),
            inputs.Restore: self._restore,
            inputs.Idle: self._idle,
            inputs.Mark: self._mark,
            inputs.SetHand: self._set_hand,
            inputs.SetRoom: self._set_room,
            inputs.SpareRooms: self._keep_spare,
            inputs.OpenRoom: self._open_room,
            inputs.CloseRoom: self._close_room,
            inputs.TriggerWritten: self._trigger,
            inputs.CloseLedger: lambda given, _: None,
        }

    @property
    def addresses(self) -> list[Address]:
        """Addresses of everybody in a session, and of seats that were left."""
        return self._table.addresses

    def knows(self, address: Address) -> bool:
        """Return whether somebody in a session is at this address."""
        place = self._places.get(address)
        return place is not None and (isinstance(place[1], Observer) or place[1].state == "seated")

    def listens_to(self, address: Address) -> bool:
        """Return whether this address is bound: to a session, or to a seat whose farewell may have to be repeated."""
        return address in self._places

    def roster(self) -> list[Place]:
        """Return everybody in a session, as (room, seat or observer)."""
        return self._table.roster()

    @property
    def woken(self) -> set[Room]:
        """Rooms that somebody has joined since the loop last emptied this set."""
        return self._table.woken

    def idle(self, room: Room, steps: int) -> None:
        """Count steps of a room where nobody holds the object at once."""
        room.idle(steps)

    @property
    def awaits_accounts(self) -> bool:
        """Return whether a client whose seat was ended by `Stop` has not sent its account yet."""
        return any(seat.last is not None and seat.account is None for room in self.rooms for seat in room.seats)

    def checkpoint(self) -> list[RoomCheckpoint]:
        """Return the states from which a restarted server continues."""
        return [room.checkpoint() for room in self.rooms]

    def handle(self, given: inputs.ServerInput, now_ns: int) -> int:
        """Handle an input. Returns how many sessions it ended, for `Kick` and `Revoke`.

        Raises CheckpointError for a `Restore` that does not fit, ValueError for an `Idle` that cannot be.
        """
        return self._handlers[type(given)](given, now_ns) or 0

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> None:
        """Handle one datagram. One that is unexpected is dropped and counted by name."""
        place = self._places.get(address)
        if place is not None and self._receive_waves(place, datagram, now_ns):
            return
        try:
            message = messages.decode(datagram)
        except messages.MalformedError:
            self._receive_malformed(datagram, address)
            return
        if type(message) is Hello:  # `isinstance` is slow for message types, and this is once a datagram
            self._joining.answer(message, len(datagram), address, now_ns)
        elif place is None:
            self._drop("not seated")
        elif type(seat := place[1]) is Seat:
            self._receive_from_seat(place[0], seat, message, now_ns)
        elif isinstance(place[1], Observer):
            self._receive_from_observer(place[0], place[1], message, now_ns)

    def _receive_waves(self, place: Place, datagram: bytes, now_ns: int) -> bool:
        """Take in waves, which nearly all messages are; False for any other datagram, and for waves that do not belong here."""
        if type(place[1]) is not Seat:
            return False
        room, seat, waves = place[0], place[1], self._waves
        if not room.takes_waves or seat.state != "seated":
            return False
        if len(datagram) > MOST_BYTES or not waves.decode(datagram) or waves.session != seat.session:
            return False
        if not seat.read_times(waves.sent_ns, waves.echo_ns, waves.held_ns, now_ns):
            self._drop("implausible stamp")
        if seat.take_in(waves, now_ns):
            seat.last_received_ns = now_ns
        else:
            self._drop("unfit")  # does not refresh the time-out of the seat
        return True

    def _receive_malformed(self, datagram: bytes, address: Address) -> None:
        version = foreign_version(datagram)
        if version is None:
            self._drop("malformed")
        elif len(datagram) < messages.HELLO_BYTES:
            self._drop("short hello")
        else:
            self._joining.refuse(nonce_of(datagram), address, Denied(*version_mismatch(version)))

    def _receive_from_seat(self, room: Room, seat: Seat, message: messages.AnyMessage, now_ns: int) -> None:
        if type(message) is room.frame and message.session == seat.session and seat.state == "seated":
            self._receive_frame(seat, message, now_ns)  # a short cut of the branches below
        elif not isinstance(message, FROM_CLIENTS):
            self._drop("unexpected")
        elif message.session != seat.session:
            self._drop("other session")
        elif isinstance(message, Leave):
            self._leave(room, seat, message, now_ns)
        elif seat.state != "seated":  # the farewell to it was lost
            self._repeat_farewell(seat, now_ns)
        elif isinstance(message, Mark):
            self._receive_mark(room, seat, message)
        elif isinstance(message, SetHand):
            self._receive_report(room, seat, message)
        elif isinstance(message, Effects):
            if seat.effects is None or not seat.effects.receive(message):
                self._drop("unfit")
        else:
            self._receive_other(seat, message, now_ns)

    def _receive_frame(self, seat: Seat, message: Frame, now_ns: int) -> None:
        """Take in a frame of the room's scheme."""
        if not seat.read_stamp(message.stamp, now_ns):
            self._drop("implausible stamp")
        if seat.receive(message, True, now_ns):
            seat.last_received_ns = now_ns
        else:
            self._drop("unfit")  # does not refresh the time-out of the seat

    def _receive_other(self, seat: Seat, message: Frame | Edges | Heartbeat, now_ns: int) -> None:
        """Take in edges of buttons or a heartbeat; a frame of another scheme is unfit."""
        if not seat.read_stamp(message.stamp, now_ns):
            self._drop("implausible stamp")
        if isinstance(message, Heartbeat) or seat.receive(message, False, now_ns):
            seat.last_received_ns = now_ns
        else:
            self._drop("unfit")

    def _receive_from_observer(self, room: Room, observer: Observer, message: messages.AnyMessage, now_ns: int) -> None:
        """Handle a heartbeat or a leave. An observer that sends waves is kicked."""
        if isinstance(message, FROM_CLIENTS) and message.session != observer.session:
            self._drop("other session")
        elif isinstance(message, Heartbeat):
            observer.last_received_ns = now_ns
            observer.clock.read(message.stamp, now_ns)
        elif isinstance(message, Leave):
            self._end_observer(room, observer, "goodbye", "left", f"left: {shown(message.reason)}")
        elif isinstance(message, _FRAMES):
            self._drop("observer's waves")
            reason = "an observer may not send waves: they were not applied; join with a player's link"
            self._end_observer(room, observer, reason, "kicked", f"was kicked: {reason}")
        else:
            self._drop("unexpected")

    def tick(self, room: Room, now_ns: int, frames: int = 1) -> None:
        """Step one room; its messages go to the outbox. frames: 1, and 1 more for each step that the loop missed."""
        if frames > 1 and frames * NS_PER_S >= QUIET_NS * room.settings.rates.network_hz:
            self._back_ns = now_ns
        if now_ns - self._back_ns > LOST_NS:
            self._let_silent_go(room, now_ns)
        self.outbox.extend(room.tick(now_ns, frames))
        for text in room.world_step.take_events():
            self._report_mark(room, room.markers.add(text, room.steps))
        if room.refused_effects:
            self._drop("effect refused", len(room.refused_effects))
            text = f"{room.called}: an effect is refused: {shown(room.refused_effects[0])[:200]}"
            self.events.append(ServerEvent("trouble", text, room.called))
            room.refused_effects.clear()
        if room.world.failed:
            self._end_room(room)
        for seat in room.seats:
            adapter = seat.adapter
            if adapter is None:
                continue
            if adapter.reported:
                self._out.report("stiffness", room, seat, f"is told: {adapter.reported}")
                adapter.reported = ""
            if adapter.withheld:
                self._drop("stiffness word", adapter.withheld)
                adapter.withheld = 0

    def _let_silent_go(self, room: Room, now_ns: int) -> None:
        """End the sessions of those who have been silent for too long."""
        for seat in room.silent(now_ns):
            self._table.unbind(seat)
            room.leave_seat(seat.number, "silence")
            self._drop("seat timed out")
            self._out.report("lost", room, seat, "has been silent for too long and lost the seat")
        for observer in room.observer_slots.silent(now_ns):
            self._table.unbind(observer)
            room.observer_slots.leave(observer.number)
            self._out.report("lost", room, observer, "has been silent for too long")

    def _end_room(self, room: Room) -> None:
        """End all seat sessions of a room whose world has failed, so that every force ramps out."""
        reason = f"the world has ended: {room.world.failed}"
        for seat in room.seats:
            if seat.state == "seated":
                self._out.report("lost", room, seat, f"lost the seat: {reason}")
                self._end_seat(room, seat, "stop", reason)

    def _idle(self, given: inputs.Idle, now_ns: int) -> None:
        room = next((room for room in self.rooms if room.name == given.room), None)
        if room is None or room.anybody_holds():
            raise ValueError(f"{given.steps} idle steps of room {given.room!r}, where somebody holds the object")
        room.idle(given.steps)

    def _mark(self, given: inputs.Mark, now_ns: int) -> int:
        rooms = [room for room in self.rooms if given.room in ("", room.called)]
        for room in rooms:
            self._report_mark(room, room.markers.add(given.text, room.steps))
        return len(rooms)

    def _trigger(self, given: inputs.TriggerWritten, now_ns: int) -> None:
        after_ms, ago_ms = 1e-6 * given.after_ns, 1e-6 * given.ago_ns
        text = f"trigger {given.code} written {ago_ms:.3f} ms ago, {after_ms:.3f} ms after {given.marker}"
        self.events.append(ServerEvent("trigger", text))

    def _receive_mark(self, room: Room, seat: Seat, mark: Mark) -> None:
        """Add a person's marker. The client repeats it until it receives it back; a repeat is answered, not added."""
        if known := room.markers.taken(seat.number, mark.number):
            # all copies that were sent to this client may have been lost
            self._out.send(replace(known, session=seat.session), seat.address)
            return
        found = room.markers.add(mark.text, room.steps, seat.number, mark.number)
        if found is None:
            self._drop("too many markers")
        else:
            self._report_mark(room, found, seat)

    def _set_hand(self, given: inputs.SetHand, now_ns: int) -> int:
        """Send a change of hand settings to each seat of the user's name that can apply it. Return their number."""
        count = 0
        for room in self.rooms:
            for seat in room.seats if given.room in ("", room.called) else ():
                if seat.name != given.user or seat.state != "seated" or seat.hand.full:
                    continue
                if seat.settings.unfit_change(given.change):
                    continue
                count += 1
                room.set_hand(seat.number, given.change)
                self._report_mark(room, room.markers.add(f"set {seat.name} {given.change.text}", room.steps))
                for told in seat.hand.untold(seat.session):
                    self._out.send(told, seat.address)
        return count

    def _set_room(self, given: inputs.SetRoom, now_ns: int) -> int:
        """Change each room that can have the change. Return their number."""
        rooms = [room for room in self.rooms if given.room in ("", room.called) and not room.unfit_change(given.change)]
        for room in rooms:
            room.change(given.change)
            self._report_mark(room, room.markers.add(f"set {given.change.text}", room.steps))
        return len(rooms)

    def _keep_spare(self, given: inputs.SpareRooms, now_ns: int) -> None:
        for room in self.rooms:
            if room.name in given.rooms:
                room.make_spare(given.template)

    def _open_room(self, given: inputs.OpenRoom, now_ns: int) -> None:
        """Open a spare room. Raises ValueError for one that is none, or a name that is taken."""
        if any(given.called in (room.called, room.name) for room in self.rooms):
            raise ValueError(f"there is a room {given.called!r} already; give another name")
        room = next(
            (room for room in self.rooms if room.name == given.room and room.template and not room.is_open), None
        )
        if room is None:
            raise ValueError(f"{given.room!r} is no spare room")
        for seat in room.seats:
            self._table.unbind(seat)
        room.open(given.called, given.labels)
        self.events.append(ServerEvent("opened", f"{room.called}: opened, of template {room.template}", room.called))

    def _close_room(self, given: inputs.CloseRoom, now_ns: int) -> int:
        """Close an open room. Return how many sessions ended."""
        room = next(room for room in self.rooms if room.name == given.room)
        count = self._end(lambda each, _: each is room, f"sent out: {given.reason}")
        text = f"{room.called}: closed: {given.reason}; sessions ended: {count}"
        self.events.append(ServerEvent("closed", text, room.called))
        room.close()
        return count

    def _receive_report(self, room: Room, seat: Seat, message: SetHand) -> None:
        """Handle a client's report of its hand settings, which it repeats until it is acknowledged."""
        if seat.hand.receive(message):
            if seat.hand.worth_a_line(room.steps):
                self._out.report("hand", room, seat, f"holds: {seat.hand.holds.text}")
            else:
                self._drop("too many reports")
        self._out.send(seat.hand.answer(seat.session), seat.address)

    def _report_mark(self, room: Room, mark: Mark | None, who: Seat | None = None) -> None:
        if mark is None:
            return
        words = f"marker: {mark.text}"
        if who is None:
            self.events.append(ServerEvent("marker", f"{room.called}: {words}", room.called))
        else:
            self._out.report("marker", room, who, words)

    def _restore(self, given: inputs.Restore, now_ns: int) -> None:
        checkpoint = given.checkpoint
        room = next((room for room in self.rooms if room.name == checkpoint.room), self.rooms[0])
        room.restore(checkpoint, now_ns)
        reserved = [seat.name for seat in room.seats if seat.ticket_hash]
        place = ", ".join(f"{value * 1e3:z.1f}" for value in checkpoint.position_m)
        text = f"{room.called}: restored: the object is at ({place}) mm, seats are kept for {', '.join(reserved) or 'nobody'}"
        self.events.append(ServerEvent("restored", text, room.called))

    def _stop(self, given: inputs.Stop, now_ns: int) -> None:
        for room in self.rooms:
            for seat in room.seats:
                self._end_seat(room, seat, "stop", given.reason)
            for observer in list(room.observer_slots.observers.values()):
                self._end_observer(room, observer, given.reason, "left", "left: the server stops")

    def _restart(self, given: inputs.Restart, now_ns: int) -> None:
        """Tell everybody. No seat ends: the next server has it from the checkpoint."""
        for room in self.rooms:
            for who in [
                *filter(lambda seat: seat.state == "seated", room.seats),
                *room.observer_slots.observers.values(),
            ]:
                self._out.send(Restart(who.session, given.wait_ms), who.address)

    def _kick(self, given: inputs.Kick, now_ns: int) -> int:
        reason = f"kicked by the administrator{': ' if given.reason else ''}{given.reason}"
        return self._end(lambda room, who: who.name == given.user and given.room in ("", room.called), reason)

    def _revoke(self, given: inputs.Revoke, now_ns: int) -> int:
        return self._end(lambda _, who: bool(who.token) and who.token in given.tokens, "kicked: the token was revoked")

    def _expire(self, given: inputs.Expire, now_ns: int) -> None:
        """Void the session tickets of expired tokens, so that the next hello needs a valid token. Sessions continue."""
        for room in self.rooms:
            for who in (*room.seats, *room.observer_slots.observers.values()):
                if who.token in given.tokens:
                    who.void_ticket()

    def _end(self, chosen: Callable[[Room, Seat | Observer], bool], reason: str) -> int:
        """End the chosen sessions and void their tickets. Return how many there were."""
        count = 0
        for room in self.rooms:
            for seat in room.seats:
                if seat.state == "seated" and chosen(room, seat):
                    count += 1
                    self._end_seat(room, seat, "kick", reason)
                    self._out.report("kicked", room, seat, f"was {reason}")
                elif seat.state == "free" and seat.ticket_hash and chosen(room, seat):
                    seat.void_ticket()
            for observer in list(room.observer_slots.observers.values()):
                if chosen(room, observer):
                    count += 1
                    self._end_observer(room, observer, reason, "kicked", f"was {reason}")
        return count

    def _end_seat(self, room: Room, seat: Seat, event: str, reason: str) -> None:
        if (account := room.leave_seat(seat.number, event)) is not None:
            self._say_farewell(room, seat, account, clipped(reason))

    def _say_farewell(self, room: Room, seat: Seat, account: SeatAccount, reason: str) -> None:
        seat.farewell = messages.encode(Farewell(seat.session, reason, account, room.account()))
        self.outbox.append((seat.address, seat.farewell))

    def _end_observer(self, room: Room, observer: Observer, reason: str, event: str, words: str) -> None:
        address = observer.address
        room.observer_slots.leave(observer.number)
        self._table.unbind(observer)
        self._out.report(event, room, observer, words)
        self._out.send(Farewell(observer.session, clipped(reason), None, room.account()), address)

    def _leave(self, room: Room, seat: Seat, leave: Leave, now_ns: int) -> None:
        account = room.leave_seat(seat.number, "leave")
        if seat.account is None:
            seat.account = leave.account
        if account is None:
            self._repeat_farewell(seat, now_ns)
            return
        self._out.report("left", room, seat, f"left: {shown(leave.reason)}")
        seat.farewell_ns = now_ns
        self._say_farewell(room, seat, account, "goodbye")

    def _repeat_farewell(self, seat: Seat, now_ns: int) -> None:
        """Send the last farewell again, at most once in FAREWELL_EVERY_NS."""
        if seat.farewell and now_ns - seat.farewell_ns >= FAREWELL_EVERY_NS:
            seat.farewell_ns = now_ns
            self.outbox.append((seat.address, seat.farewell))
        else:
            self._drop("said goodbye")
