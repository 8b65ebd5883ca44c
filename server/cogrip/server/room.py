"""A room: one object, its seats, those who look on, and one step a frame."""

from collections.abc import Callable, Sequence
from math import dist, inf, isnan
from typing import NamedTuple

import numpy as np

from cogrip.protocol import messages
from cogrip.protocol.accounts import ClientAccount, LinkCount, RoomAccount, SeatAccount, TickCount
from cogrip.protocol.channel import Address
from cogrip.protocol.clock import Clock
from cogrip.protocol.line.energy_reserve import EnergyReserve
from cogrip.protocol.messages import Heartbeat
from cogrip.protocol.session import LOST_NS, QUIET_NS, SEAT
from cogrip.protocol.settings import SeatSettings, Settings, digest, seat_settings
from cogrip.server.checkpoint import VERSION, CheckpointError, RoomCheckpoint, SeatCheckpoint
from cogrip.server.observers import ObserverSlots
from cogrip.server.ports import PORTS, Port, WavePort
from cogrip.server.rate_limit import HELLOS, Buckets
from cogrip.server.seat_limits import BURST_S, Record, SeatLimits, limits_of
from cogrip.server.stiffness_adaptation import StiffnessAdapter
from cogrip.server.worlds.registry import make_world
from cogrip.server.worlds.world import Row

MOST_EARLIER = 8  # sittings before the last one that a seat still knows of
RESERVED_NS = 5_000_000_000  # a restored seat is kept so long for whoever had it


class SeatSession(NamedTuple):
    """What both ends knew of a sitting that is over; None where the client did not say."""

    client: ClientAccount | None
    seat: SeatAccount

    def least_margin(self) -> float:
        """Of what this end measured [J]; what is no number is the least of all. A client's word crowds nothing out."""
        told = [self.seat.up_margin_j, self.seat.line_margin_j]
        return min([-inf if isnan(margin) else margin for margin in told if margin is not None], default=0.0)


class Seat:
    """One person's place. The session state changes by protocol.session.SEAT alone."""

    def __init__(self, settings: SeatSettings) -> None:
        self.settings = settings
        self.state = "free"
        self.session = 0
        self.address: Address = None
        self.nonce = 0
        self.last_received_ns = self.since_ns = 0
        self.clock = Clock()
        self.rtt_ns: int | None = None  # the last round trip that was measured
        self.port: Port | None = None
        self.adapter: StiffnessAdapter | None = None
        self.on_object = False
        self.line_margin_j = 0.0
        self.line_reserve = EnergyReserve(settings.rates.network_hz)
        self.account: ClientAccount | None = None  # what the client said when it left
        self.last: SeatAccount | None = None  # what we knew when it left
        self.earlier: list[SeatSession] = []  # those before, oldest first
        self.ticket = ""  # mark of the ticket that opens this seat again, "" none
        self.token = ""  # public id of the token it was taken with
        self.record: Record | None = None  # of the device it was taken with
        self.reserved_until_ns: int | None = None  # for the ticket's holder
        self.hellos = Buckets(1, HELLOS)
        self.farewell = b""  # the last one, to be said again
        self.farewell_ns = 0
        self.power_left = 1.0  # of the power's bucket, when the seat was left
        self.limited: dict[str, int] = {}  # what was limited here before the present port, by reason

    @property
    def name(self) -> str:
        """Whose seat it is."""
        return self.settings.user

    def close_seat_session(self) -> None:
        """Somebody sits down anew: keep what was known of the sitting before. Of too many, the most passive one is let go."""
        if self.last is not None:
            self.earlier.append(SeatSession(self.account, self.last))
        if len(self.earlier) > MOST_EARLIER:
            self.earlier.remove(max(self.earlier, key=SeatSession.least_margin))
        self.account = self.last = None

    def step(self, event: str) -> bool:
        after = SEAT.get((self.state, event))
        if after is None:
            return False
        self.state = after
        return True


class Room:
    """Seats and world of one settings file. `tick` once a frame, in seat order."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.name = settings.name
        self.digest = digest(settings)
        self.seats = [Seat(seat_settings(settings, number)) for number in range(len(settings.users))]
        self.world = make_world([seat.settings for seat in self.seats])
        self._idle = (0.0,) * (self.world.axes * self.world.inputs_per_axis)
        self.observer_slots = ObserverSlots(settings.admission.observers, settings.rates.network_hz)
        self.steps = 0
        self.ticks: Callable[[], TickCount] = lambda: TickCount(due=self.steps, run=self.steps)  # the loop sets its own
        self.travel_m = 0.0
        self.diverged = ""
        self.put_back = 0  # times that the object was, from out of everybody's reach

    def take_seat(
        self, number: int, session: int, nonce: int, address: Address, now_ns: int, record: Record
    ) -> SeatSettings:
        """Give a free seat away."""
        seat = self.seats[number]
        seat.step("hello")
        rested_s = max(0, now_ns - seat.last_received_ns) * 1e-9  # whoever sits down anew finds no fuller bucket
        power_left = min(1.0, seat.power_left + rested_s / BURST_S)
        seat.farewell = b""
        seat.session, seat.nonce, seat.address, seat.last_received_ns = session, nonce, address, now_ns
        seat.since_ns = now_ns
        seat.clock, seat.rtt_ns = Clock(), None
        seat.record, seat.reserved_until_ns = record, None
        seat.port = PORTS[seat.settings.coupling.kind](seat.settings, self.limits(number), power_left)
        seat.adapter = None
        if isinstance(seat.port, WavePort) and seat.port.loops is not None and self.world.can_follow:
            seat.adapter = StiffnessAdapter(seat.settings, seat.port.loops)
            self.world.aim(number, seat.settings.rendered_npm)
        seat.on_object = False
        seat.line_margin_j = 0.0
        seat.line_reserve = EnergyReserve(self.settings.rates.network_hz)
        seat.close_seat_session()
        self.world.start_ledger(number)
        return seat.settings

    def limits(self, number: int) -> SeatLimits:
        """What a seat may bring in."""
        record = self.seats[number].record
        return limits_of(record, self.settings, number) if record is not None else SeatLimits()

    def limited(self, number: int) -> dict[str, int]:
        """What was limited at a seat so far, by reason."""
        seat = self.seats[number]
        counts = dict(seat.limited)
        for name, count in (seat.port.limited if seat.port else {}).items():
            counts[name] = counts.get(name, 0) + count
        return counts

    def move(self, number: int, address: Address, now_ns: int) -> None:
        """A person goes on from another address."""
        seat = self.seats[number]
        seat.step("resume")
        seat.address, seat.last_received_ns, seat.clock = address, now_ns, Clock()

    def leave_seat(self, number: int, event: str) -> SeatAccount | None:
        """A person leaves (`leave`, `silence`, `kick` or `stop`). Only who fell silent may come back by the ticket."""
        seat = self.seats[number]
        if not seat.step(event):
            return None
        seat.last = self.seat_account(number)
        if seat.on_object:
            self.world.leave(number)
        seat.on_object = False
        seat.limited = self.limited(number)
        if seat.port is not None:
            seat.power_left = seat.port.power_left
        seat.port = seat.adapter = None
        if event != "silence":
            seat.ticket = ""
        return seat.last

    def free(self, number: int, now_ns: int) -> bool:
        """Whether whoever comes may have this seat."""
        seat = self.seats[number]
        return seat.state == "free" and (seat.reserved_until_ns is None or now_ns >= seat.reserved_until_ns)

    def kept_ns(self, number: int, now_ns: int) -> int:
        """Return for how much longer a seat is kept for somebody who is not heard; 0 where nobody is missed."""
        seat = self.seats[number]
        if seat.state == "free":
            return max(0, (seat.reserved_until_ns or 0) - now_ns)
        silent_ns = now_ns - seat.last_received_ns
        return max(1, LOST_NS - silent_ns) if silent_ns >= QUIET_NS else 0

    def checkpoint(self) -> RoomCheckpoint:
        """What a next server has to know of this room."""
        seats = [
            SeatCheckpoint(seat.settings.user, seat.session, seat.nonce, seat.ticket, seat.token, seat.record)
            for seat in self.seats
        ]
        here = tuple(self.world.position.tolist())
        return RoomCheckpoint(VERSION, self.name, self.digest, here, self.travel_m, self.steps, tuple(seats))

    def restore(self, checkpoint: RoomCheckpoint, now_ns: int) -> None:
        """Begin where the server before ended, the object at rest. Raises CheckpointError, and nothing has changed."""
        users = [seat.settings.user for seat in self.seats]
        if checkpoint.room != self.name or checkpoint.digest != self.digest:
            raise CheckpointError(f"it is of room {checkpoint.room!r} with other settings ({checkpoint.digest})")
        if [seat.user for seat in checkpoint.seats] != users or len(checkpoint.position_m) != self.world.axes:
            raise CheckpointError("its seats or axes are not this room's")
        self.world.position = np.array(checkpoint.position_m)
        self.travel_m, self.steps = checkpoint.travel_m, checkpoint.steps
        for seat, before in zip(self.seats, checkpoint.seats, strict=True):
            seat.session, seat.nonce, seat.ticket = before.session, before.nonce, before.ticket
            seat.token, seat.record = before.token, before.record
            if before.ticket:
                seat.reserved_until_ns = now_ns + RESERVED_NS

    @property
    def deserted(self) -> bool:
        """Whether nobody sits here, or looks on."""
        return not self.observer_slots.observers and not any(seat.port for seat in self.seats)

    def silent(self, now_ns: int) -> list[int]:
        """Seats that have not been heard for LOST_NS."""
        return [
            number
            for number, seat in enumerate(self.seats)
            if seat.state == "seated" and now_ns - seat.last_received_ns > LOST_NS
        ]

    def tick(self, now_ns: int, frames: int = 1) -> list[tuple[Address, bytes]]:
        """Step the object; `frames` > 1 if the loop missed frames - 1 steps (the object stood still for them)."""
        world, seats = self.world, self.seats
        if self.deserted:  # an object that nobody holds is put down, and stays
            world.rest()
            if world.left_workspace:  # where nobody would find it
                world.position = np.zeros(world.axes)
            self.steps += 1
            return []
        rows = self._take(frames)
        before = world.motion()[: world.axes]
        if not any(seat.on_object for seat in seats):
            world.rest()  # an object that nobody holds is put down
        answers: Sequence[Sequence[float]] = world.advance(rows)
        self.steps += 1
        state = world.motion()
        here = state[: world.axes]
        if world.left_workspace and not self.diverged:
            self.diverged = f"the object left the workspace at {here} m"
        if world.out_of_reach:
            answers = self._put_back()
            state = world.motion()
        else:
            self.travel_m += dist(here, before)
        work = world.worked()
        out = []
        for number, seat in enumerate(seats):
            port = seat.port
            if port is None:
                continue
            if not seat.on_object:  # its device is being opened: frames before its first one would only come late
                out.append((seat.address, messages.encode(Heartbeat(seat.session, seat.clock.stamp(now_ns)))))
                continue
            port.put(tuple(answers[number]))
            port_in_j = port.port_in_j()
            seat.line_reserve.elapse(frames)
            if port_in_j is not None:
                reserve_j = port_in_j - work[number] + port.rounding_j
                seat.line_reserve.update(reserve_j)
                seat.line_margin_j = min(seat.line_margin_j, reserve_j)
            message = port.message(seat.session, seat.clock.stamp(now_ns), state, -work[number])
            out.append((seat.address, messages.encode(message)))
        if self.observer_slots.observers:
            holding = [number for number, seat in enumerate(seats) if seat.on_object]
            out += self.observer_slots.views(self.steps, world, holding, now_ns)
        return out

    def _put_back(self) -> list[Row]:
        """The object is laid to rest in the middle, and everybody takes hold of it anew, where the hand is: what springs and
        motion held is lost, so no energy is made. Gives what goes back to each in place of the step's answer."""
        world = self.world
        self.put_back += 1
        answers: list[Row] = [()] * len(self.seats)
        for number, seat in enumerate(self.seats):
            if seat.on_object:
                world.leave(number)
        world.position = np.zeros(world.axes)
        world.rest()
        for number, seat in enumerate(self.seats):
            if seat.on_object and seat.port is not None and seat.port.hand is not None:
                world.join(number, np.array(seat.port.hand))
                answers[number] = seat.port.neutral
        return answers

    def _take(self, frames: int) -> list[Row]:
        """What comes in at each seat; whose first frame is there takes hold of the object, and springs are told their aim."""
        world = self.world
        rows = []
        for number, seat in enumerate(self.seats):
            missed = frames
            if seat.port and not seat.on_object and seat.port.origin is not None:
                world.join(number, np.array(seat.port.origin))
                seat.on_object = True
                missed = 1  # nothing was missed of a line that has just begun
            rows.append(seat.port.take(missed) if seat.port and seat.on_object else self._idle)
            if seat.adapter is not None and seat.on_object:
                aim = seat.adapter.heed()
                if aim is not None:
                    world.aim(number, aim)
        return rows

    def seat_account(self, number: int) -> SeatAccount:
        """What is known of a seat now, or was when it was left."""
        seat = self.seats[number]
        if seat.port is None:
            return seat.last or SeatAccount((0.0,) * self.world.axes, None, None, LinkCount())
        proxy = self.world.proxy_of(number)
        return SeatAccount(
            proxy, seat.port.up_margin_j, seat.line_margin_j, seat.port.count(),
            seat.port.playout_account(), rendered_npm=self.world.stiffness_of(number) if seat.on_object else None,
            up_reserve_j=seat.port.up_reserve.reported_j, line_reserve_j=seat.line_reserve.reported_j,
        )  # fmt: skip

    def account(self) -> RoomAccount:
        world = self.world
        return RoomAccount(
            position_m=tuple(world.position.tolist()),
            velocity_mps=tuple(world.velocity.tolist()),
            travel_m=self.travel_m,
            diverged=bool(self.diverged),
            energy_balance_error_j=float(world.balance_error_j),
            ticks=self.ticks(),
        )
