"""Room: one object, its seats and observers, and one step a frame."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from math import dist

import numpy as np
from msgspec.structs import replace

from cogrip.machine.rows import Row
from cogrip.machine.tick_count import TickCount
from cogrip.protocol.line.energy_reserve import EnergyReserve
from cogrip.protocol.secure.channel import Address
from cogrip.protocol.settings.digest import digest
from cogrip.protocol.settings.effects import Effect
from cogrip.protocol.settings.hand import HandChange
from cogrip.protocol.settings.rates import NS_PER_S
from cogrip.protocol.settings.room import seat_settings
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.settings.settable import LEAST_MASS_KG, RoomChange
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.accounts import RoomAccount, SeatAccount
from cogrip.protocol.wire.button_edges import EdgeReceiver, bits_of
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.messages import FRAMES, Heartbeat, Mark, Waves
from cogrip.protocol.wire.session import LOST_NS
from cogrip.server.checkpoint import VERSION, CheckpointError, RoomCheckpoint
from cogrip.server.ports.seat_limits import BURST_S, ClaimedRecord, SeatLimits, limits_of
from cogrip.server.schemes import SCHEMES, make_room_world
from cogrip.server.seats.effects import EffectSender, RoomEffects
from cogrip.server.seats.geometry_sender import GeometrySender
from cogrip.server.seats.hand_changes import SentChanges
from cogrip.server.seats.markers import RoomMarkers
from cogrip.server.seats.observers import ObserverSlots
from cogrip.server.seats.participants import Seat
from cogrip.server.seats.ramp import Ramp
from cogrip.server.seats.restoration import place_again, put_back
from cogrip.server.seats.seat_account import account_of
from cogrip.server.seats.spring_ramp import LEAST_NSPM, SpringRamp
from cogrip.server.seats.stiffness_adaptation import StiffnessAdapter
from cogrip.server.worlds.departures import Departure, let_leave, watch_object
from cogrip.server.worlds.world import WorldError

LEAST_GRAVITY_MPS2 = 1.0  # of less, gravity changes by as much as of this in a frame
RESERVED_NS = 5_000_000_000  # time for which a restored seat is reserved for its ticket's holder


class Room:
    """Seats and world of one settings file. In a step the world takes a row of each seat, and gives an answer to each.

    travel_m  path length of the object so far
    unstable  why numbers of the world were not finite, or grew beyond what hands bring about; "" if they did not
    left      what left the workspace, each the first time
    put_back  times that the object was put back from out of everybody's reach
    ticks     source of the tick count: the loop sets its own
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.name = settings.name
        self.digest = digest(settings)
        self.seats = [Seat(seat_settings(settings, number), number) for number in range(len(settings.users))]
        self._scheme = SCHEMES[settings.coupling.kind]
        self.frame = FRAMES[settings.coupling.traits.frame]
        self.takes_waves = self.frame is Waves
        self.world = make_room_world(settings, [seat.settings for seat in self.seats])
        self.world_step = self.world.as_step()
        self._axes, self._places = self.world.axes, self.world.places
        self._idle_row = (0.0,) * (self._axes * self.world.inputs_per_axis)
        self._frame_ns = NS_PER_S // settings.rates.network_hz
        self.observer_slots = ObserverSlots(settings.admission.observers, settings.rates.network_hz)
        self.markers = RoomMarkers(settings.rates.network_hz)
        self.effects = RoomEffects(settings)
        self._observer_effects: EffectSender | None = None  # to observers
        self.refused_effects: list[str] = []  # why, since its owner emptied it
        self.steps = 0
        self.ticks: Callable[[], TickCount] = lambda: TickCount(due=self.steps, run=self.steps)
        self.travel_m, self.put_back = 0.0, 0
        self.called = self.name  # name by which people find it
        self.template = ""  # of a room on demand
        self.labels: Mapping[str, str] = {}
        self.is_open = True
        self._saved: Row = ()  # state of the world of a spare room, as it begins
        self.changes = RoomChange()  # what was set of the room since it began
        self._ramps: tuple[tuple[Ramp, Callable[[float], None]], ...] = ()  # of what was set, once anything was
        self.unstable = ""
        self.left: list[Departure] = []

    def take_seat(
        self, number: int, session: int, nonce: int, now_ns: int, record: ClaimedRecord, hand: SentChanges | None = None
    ) -> None:
        """Begin a seat session at a free seat, with a new port and an empty energy ledger.

        hand: of the session before, where the same client resumes it
        """
        seat = self.seats[number]
        seat.step("hello")
        # a new session continues the power limiter's token bucket
        rested_s = max(0, now_ns - seat.last_received_ns) * 1e-9
        power_left = min(1.0, seat.power_left + rested_s / BURST_S)
        seat.begin(session, nonce, now_ns)
        seat.farewell, seat.rtt_ns = b"", None
        seat.hand = SentChanges(seat.begins_with, self.settings.rates.network_hz, hand)
        self._begin_line(seat)
        seat.record, seat.reserved_until_ns = record, None
        seat.limits = self.limits(number)
        seat.port = port = self._scheme.make_port(seat.settings, seat.limits, power_left)
        if seat.hand.line.impedance_nspm is not None or seat.hand.line.prefer is not None:
            port.let_impedance_change()
        port.credit_left = seat.credit_left  # all seat sessions together lend one credit
        seat.adapter = None
        if port.loops is not None and self.world.can_adapt_stiffness:
            seat.adapter = StiffnessAdapter(seat.settings, port.loops)
            self.world.set_target_stiffness(number, seat.settings.rendered_npm)
        seat.on_object, seat.effects = False, None
        seat.line_margin_j = 0.0
        seat.line_reserve = EnergyReserve(self.settings.rates.network_hz)
        seat.close_seat_session()
        self._tell_geometry(number)
        self.world.start_ledger(number)

    def _begin_line(self, seat: Seat) -> None:
        """Give a seat that begins the line and the spring of its settings, with what was changed where a session goes on."""
        seat.settings = seat.begins_with.changed(seat.hand.line)
        if seat.spring is None and seat.settings is seat.begins_with:
            return
        seat.spring = SpringRamp(seat.settings)
        if self.world.can_adapt_stiffness:
            self.world.set_target_stiffness(seat.number, seat.settings.rendered_npm)
            self.world.set_damping(seat.number, seat.settings.coupling.damping_nspm)

    def resume_seat(self, number: int, now_ns: int) -> None:
        """Resume a seat session from another address."""
        seat = self.seats[number]
        seat.step("resume")
        seat.last_received_ns, seat.clock = now_ns, MessageClock()
        self._tell_geometry(number)

    def _tell_geometry(self, number: int) -> None:
        """Begin to send a player the shapes with which its client renders contact."""
        shapes = self.world.drawing.local_shapes(number)
        self.seats[number].geometry = GeometrySender(shapes, self.settings.rates.network_hz) if shapes else None

    def leave_seat(self, number: int, event: str) -> SeatAccount | None:
        """End a seat session by `leave`, `silence`, `kick` or `stop`; only after `silence` the ticket still resumes it.

        Returns its account; None where nobody had the seat.
        """
        seat = self.seats[number]
        if not seat.step(event):
            return None
        seat.last = self.seat_account(number)
        if seat.on_object:
            for bit in bits_of(seat.port.handle.buttons if seat.port else 0):
                self.world.button(number, bit + 1, False)
            self.world.leave(number)
        seat.on_object = False
        seat.limited = self.limited(number)
        if seat.port is not None:
            seat.power_left, seat.credit_left = seat.port.power_left, seat.port.credit_left
        seat.port = seat.adapter = None
        if event != "silence":
            seat.ticket = seat.ticket_hash = ""
        return seat.last

    # Rooms on demand: a spare room is opened under a name, and closed again

    def make_spare(self, template: str) -> None:
        """Close the room, as a spare one of a template, with the state that it has now as its start."""
        self.template, self.is_open, self.called = template, False, ""
        self._saved = self.world.save()

    def open(self, called: str, labels: Mapping[str, str]) -> None:
        """Let people in under this name, with the object at its start."""
        world, rate_hz = self.world, self.settings.rates.network_hz
        world.restore(self._saved)
        if self._ramps:
            world.set_mass(self.settings.object.mass_kg)
            world.set_object_damping(self.settings.object.damping_nspm)
        self.called, self.labels, self.is_open = called, dict(labels), True
        self.travel_m, self.put_back, self.unstable, self.left = 0.0, 0, "", []
        self.changes, self._ramps = RoomChange(), ()
        self.markers, self.effects = RoomMarkers(rate_hz), RoomEffects(self.settings, self.steps)
        for seat in self.seats:
            seat.forget()

    def close(self) -> None:
        """Let nobody in any more."""
        self.is_open, self.called, self.labels = False, "", {}

    def limits(self, number: int) -> SeatLimits:
        """Return the bounds of what a seat may bring in."""
        seat = self.seats[number]
        return limits_of(seat.record, self.settings, number, seat.hand.wanted) if seat.record else SeatLimits()

    def set_hand(self, number: int, change: HandChange) -> None:
        """Tell a seat's client a change of its hand's settings.

        The limits become those of the old and the new settings together, as waves of the old ones are still on their way.
        """
        seat = self.seats[number]
        frame = seat.hand.add(change)
        if seat.port is None:
            return
        if seat.record is not None:
            seat.limits = seat.limits.or_more(limits_of(seat.record, self.settings, number, frame))
            seat.port.set_limits(seat.limits)
        if change.impedance_nspm is not None or change.prefer is not None:
            seat.port.let_impedance_change()
        if change.of_spring():
            self._change_spring(seat)

    def _change_spring(self, seat: Seat) -> None:
        """Have the spring go to what was set; the world pays for one that grows stiffer under load (theory 3.7)."""
        if seat.spring is None:
            seat.spring = SpringRamp(seat.settings)
            self.world.lend(seat.number)
        seat.settings = now = seat.begins_with.changed(seat.hand.line)
        seat.spring.aim(now)
        if seat.adapter is not None:
            seat.adapter.use_stiffness(now.coupling.stiffness_npm)

    def change(self, change: RoomChange, resumed: bool = False) -> None:
        """Have the object, gravity and effects become what was set of them. resumed: before a crash or a hand-over."""
        world = self.world
        if not self._ramps:
            frame_s = 1.0 / self.settings.rates.network_hz
            self._ramps = (
                (Ramp(world.mass_kg, LEAST_MASS_KG, frame_s), world.set_mass),
                (Ramp(world.object_damping, LEAST_NSPM, frame_s), world.set_object_damping),
                (Ramp(world.gravity_mps2, LEAST_GRAVITY_MPS2, frame_s), world.set_gravity),
            )
        goals = change.object_mass_kg, change.object_damping_nspm, change.scene_gravity_mps2
        for (ramp, _), goal in zip(self._ramps, goals, strict=True):
            if goal is not None:
                ramp.goal = goal
        self.effects.switch(change.effects, self.steps, resumed)
        self.changes = change.after(self.changes)

    def unfit_change(self, change: RoomChange) -> str:
        """Return why this room cannot have a change, "" where it can."""
        coupling, kind, key = self.settings.coupling.kind, self.settings.object.kind, change.text.partition("=")[0]
        here = f'{key} cannot change with coupling.kind = "{coupling}" and object.kind = "{kind}"'
        of_object = change.object_mass_kg is not None or change.object_damping_nspm is not None
        if of_object and not self.world.can_change_object:
            return f"{here}: the bodies are the scene's, or a client's own copy, or nothing moves; restart the room"
        if change.scene_gravity_mps2 is not None and not self.world.can_change_gravity:
            return f"{here}: there is no scene, or clients have copies of it; restart the room"
        return self.effects.unfit(change.effects, self.steps)

    def limited(self, number: int) -> dict[str, int]:
        """Return how often a seat was limited so far, by reason."""
        seat = self.seats[number]
        now = seat.port.limited if seat.port else {}
        return dict(Counter(seat.limited) + Counter(now) if seat.limited else now)

    def free(self, number: int, now_ns: int) -> bool:
        """Return whether a newcomer may have this seat."""
        return self.seats[number].is_free(now_ns)

    def reserved_ns(self, number: int, now_ns: int) -> int:
        """Return for how much longer a seat is reserved for somebody who fell silent; 0 where nobody did."""
        return self.seats[number].reserved_ns(now_ns)

    def checkpoint(self) -> RoomCheckpoint:
        """Return the state from which a restarted server continues."""
        here, seats = self.world_step.motion()[: self._axes], tuple([seat.checkpoint() for seat in self.seats])
        placed, progress = self.world.coordinates(), self.world.progress.save()
        return RoomCheckpoint(
            VERSION,
            self.name,
            self.digest,
            here,
            self.travel_m,
            self.steps,
            seats,
            *placed,
            progress,
            self.changes,
            self.called if self.template else "",
            dict(self.labels),
        )

    def restore(self, checkpoint: RoomCheckpoint, now_ns: int) -> None:
        """Begin where the server before ended, the object at rest. Raises CheckpointError, and nothing has changed."""
        if checkpoint.room != self.name or checkpoint.digest != self.digest:
            raise CheckpointError(f"it is of room {checkpoint.room!r} with other settings ({checkpoint.digest})")
        place_again(self.world, self.seats, checkpoint)
        self.travel_m, self.steps = checkpoint.travel_m, checkpoint.steps
        if checkpoint.called and self.template:
            self.called, self.labels, self.is_open = checkpoint.called, dict(checkpoint.labels), True
        if checkpoint.changes != RoomChange():
            self.change(checkpoint.changes, resumed=True)
        for seat, before in zip(self.seats, checkpoint.seats, strict=True):
            seat.restore(before)
            if before.ticket:
                seat.reserved_until_ns = now_ns + RESERVED_NS

    @property
    def deserted(self) -> bool:
        """Return whether there is neither a seat session nor an observer."""
        return self.is_deserted()

    def is_deserted(self) -> bool:
        """Return `deserted`."""
        for seat in self.seats:
            if seat.port is not None:
                return False
        return not self.observer_slots.observers

    def anybody_holds(self) -> bool:
        """Return whether somebody holds the object."""
        for seat in self.seats:  # noqa: SIM110 - compiled, a loop whose variable has a type
            if seat.on_object:
                return True
        return False

    def silent(self, now_ns: int) -> Sequence[Seat]:
        """Return the seats whose client has sent nothing for LOST_NS."""
        found: tuple[Seat, ...] = ()
        for seat in self.seats:
            if now_ns - seat.last_received_ns > LOST_NS and seat.state == "seated":
                found = *found, seat
        return found

    def idle(self, steps: int) -> None:
        """Count steps in which nobody held the object: it rests, in the workspace's middle if it had left it."""
        self.world.bring_to_rest()
        if self.world.left_workspace:
            self.world.position = np.zeros(self.world.axes)
        self.steps += steps

    def tick(self, now_ns: int, frames: int = 1) -> list[tuple[Address, bytes]]:
        """Step the object once; frames: 1, and 1 more for each step that the loop missed, in which the object stood still.

        Return (address, datagram) of each seat and observer.
        """
        if self.is_deserted():
            self.idle(1)
            return []
        for ramp, apply in self._ramps:
            if (value := ramp.update()) is not None:
                apply(value)
        answers = self._advance(self._pop(frames, now_ns))
        state, work = self.world_step.motion(), self.world_step.port_work_j()
        self.effects.follow(self.steps, self.markers)
        out: list[tuple[Address, bytes]] = []
        for number in range(len(self.seats)):
            seat = self.seats[number]
            if seat.port is None:
                continue
            if changes := seat.hand.due(seat.session, self.steps):
                out += [(seat.address, messages.encode(each)) for each in changes]
            if seat.geometry is not None:
                out += [(seat.address, messages.encode(geom)) for geom in seat.geometry.next(seat.session)]
            if not seat.on_object:  # its device is being opened: frames before its first one would only come late
                out.append((seat.address, messages.encode(Heartbeat(seat.session, seat.clock.stamp(now_ns)))))
                continue
            if self._has_effects(seat):
                out += self._tell_effects(seat)
            message = self._message_of(seat, tuple(answers[number]), work[number], state, frames, now_ns)
            out.append((seat.address, message))
        if self.observer_slots.observers:
            out += self.observer_slots.views(self.steps, self.world, self.seats, now_ns) + self._show_effects()
        if marks := self.markers.due(self.steps):
            out += self._marks(marks)
        return out

    def _advance(self, rows: Sequence[Row]) -> Sequence[Sequence[float]]:
        """Step the world by the row of each seat; put an object back that nobody can reach. Return the answer to each."""
        step, places = self.world_step, self._places
        before = step.motion()[:places]
        if not self.anybody_holds():
            self.world.bring_to_rest()  # an object that nobody holds is put down
        answers: Sequence[Sequence[float]] = ()
        failed = False
        try:
            answers = step.advance(rows)
        except WorldError as error:
            failed, self.unstable = True, self.unstable or str(error)
            self.world.reset()
        self.steps += 1
        here = step.motion()[:places]
        if step.left_workspace():
            self.unstable = watch_object(self.world, step.motion(), self.left, self.unstable)
        if self.world.departed:
            let_leave(self.world, self.left, self.steps / self.settings.rates.network_hz)
        if failed or step.out_of_reach():
            return self._put_back()
        self.travel_m += dist(here, before)
        return answers

    def _message_of(self, seat: Seat, answer: Row, work_j: float, state: Row, frames: int, now_ns: int) -> bytes:
        """Push a step's answer into a seat's line, update its energy reserve and margin, and return the message."""
        port, axes = seat.port, self._axes
        assert port is not None
        port.push(answer if port.axes == axes else answer[: port.axes])
        port_in_j, port_out_j = port.port_in_j(), work_j + port.absorbed_j
        seat.line_reserve.elapse(frames)
        if port_in_j is not None:
            reserve_j = float(port_in_j) - port_out_j + port.rounding_j()
            seat.line_reserve.update(reserve_j)
            if reserve_j < seat.line_margin_j:
                seat.line_margin_j = reserve_j
        seen = state if port.axes == axes else state[: port.axes] + state[axes : axes + port.axes]
        if engaged := self.world_step.engaged_at(seat.number):
            seen = seen + engaged
        return port.message(seat.session, seat.clock, now_ns, seen, -port_out_j)

    def _effects_of(self, number: int) -> Sequence[Effect]:
        settled, own = self.effects.of(number), self.world_step.effects_of(number)
        return settled if not own else own if not settled else (*settled, *own)

    def _has_effects(self, seat: Seat) -> bool:
        """Return whether a person's client has been sent effects, or is to be."""
        return seat.effects is not None or bool(self._effects_of(seat.number))

    def _effect_sender(self) -> EffectSender:
        return EffectSender(self.settings.rates.network_hz, self.world.axes, self.settings.effect_tank_mj)

    def _show_effects(self) -> list[tuple[Address, bytes]]:
        """Return the messages to observers about everybody's effects, in turn, as observers acknowledge nothing."""
        if not any(seat.effects for seat in self.seats):
            return []
        shown = self._observer_effects = self._observer_effects or self._effect_sender()
        each = {id(effect): effect for seat in self.seats if seat.on_object for effect in self._effects_of(seat.number)}
        shown.follow(tuple(each.values()), (), self.steps)
        shown.refused.clear()  # as each person's own have said
        if (message := shown.next(1, self.steps)) is None:
            return []
        observers = self.observer_slots.observers.values()
        return [(who.address, messages.encode(replace(message, session=who.session))) for who in observers]

    def _tell_effects(self, seat: Seat) -> list[tuple[Address, bytes]]:
        """Return the message to a person's client about the effects that it is to render."""
        given, sender = self._effects_of(seat.number), seat.effects
        if sender is None:
            if not given:
                return []
            sender = seat.effects = self._effect_sender()
        offset = self.world.offset[seat.number, : self.world.places].tolist()
        sender.follow(given, offset, self.steps)
        if sender.refused:
            self.refused_effects += sender.refused
            sender.refused = []
        message = sender.next(seat.session, self.steps)
        return [] if message is None else [(seat.address, messages.encode(message))]

    def _marks(self, marks: Sequence[Mark]) -> list[tuple[Address, bytes]]:
        """Return these markers for everybody."""
        people = [*(seat for seat in self.seats if seat.port is not None), *self.observer_slots.observers.values()]
        return [(who.address, messages.encode(replace(mark, session=who.session))) for mark in marks for who in people]

    def _pop(self, frames: int, now_ns: int) -> list[Row]:
        """Return the row of each seat. A seat whose first frame has come joins the world, which gets what clients reported."""
        world = self.world
        next_step_ns = now_ns + self._frame_ns
        rows = []
        for number in range(len(self.seats)):
            seat = self.seats[number]
            port = seat.port
            if port is None:
                rows.append(self._idle_row)
                continue
            port.next_step_ns = next_step_ns
            missed = frames
            if not seat.on_object and port.origin is not None:
                world.join(number, np.array(port.origin + self._idle_row[port.axes : self._axes]))
                seat.on_object = True
                missed = 1  # a line that has just begun has missed nothing
            if not seat.on_object:
                rows.append(self._idle_row)
                continue
            row = port.pop(missed)
            rows.append(row if port.axes == self._axes else row + self._idle_row[port.axes :])
            if port.proxy is not None and port.hand is not None:
                world.set_reported_positions(number, port.hand, port.proxy)
            if port.impedance_nspm is not None:
                world.set_impedance(number, port.impedance_nspm)
            if port.turned is not None:
                world.set_reported_rotation(number, *port.turned)
            self._give_handle(number, port.handle)
            if seat.adapter is not None:
                if port.impedance_nspm is not None:
                    seat.adapter.use_impedance(port.impedance_nspm)
                target_npm = seat.adapter.update()
                if target_npm is not None:
                    world.set_target_stiffness(number, target_npm)
            if seat.spring is not None:
                self._follow_spring(seat)
        return rows

    def _follow_spring(self, seat: Seat) -> None:
        spring = seat.spring
        assert spring is not None
        if (stiffness_npm := spring.stiffness.update()) is not None and seat.adapter is None:
            self.world.set_target_stiffness(seat.number, stiffness_npm)
        if (damping_nspm := spring.damping.update()) is not None:
            self.world.set_damping(seat.number, damping_nspm)

    def _give_handle(self, number: int, handle: EdgeReceiver) -> None:
        """Pass a person's button edges, orientation and grip to the world."""
        for edge in handle.pop():
            self.world.button(number, abs(edge), edge > 0)
        if handle.orientation is not None or handle.grip_m is not None:
            self.world.handle(number, handle.orientation, handle.grip_m)

    def _put_back(self) -> list[Row]:
        """Put the object at rest in the middle, and let everybody join anew with the hand where it is.

        The energy of springs and motion is discarded, so none is created. Return the answers to this step.
        """
        self.put_back += 1
        return put_back(self.world, self.seats, self._idle_row)

    def seat_account(self, number: int) -> SeatAccount:
        """Return the account of a seat session: the present one, else the last."""
        return account_of(self.seats[number], self.world)

    def account(self) -> RoomAccount:
        """Return the account of the object and of the loop."""
        motion, axes = self.world_step.motion(), self._axes
        return RoomAccount(
            position_m=motion[:axes], velocity_mps=motion[axes:], travel_m=self.travel_m, unstable=bool(self.unstable),
            energy_balance_error_j=float(self.world.balance_error_j), ticks=self.ticks(), left=bool(self.left),
        )  # fmt: skip
