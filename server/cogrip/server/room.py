"""A room: one object, its seats, and one step a frame."""

from collections.abc import Callable, Hashable
from math import dist

import numpy as np

from cogrip.protocol import messages
from cogrip.protocol.accounts import ClientAccount, LinkCount, RoomAccount, SeatAccount, TickCount
from cogrip.protocol.messages import Heartbeat
from cogrip.protocol.session import LOST_NS, SEAT, Clock
from cogrip.protocol.settings import SeatSettings, Settings, digest, seat_settings
from cogrip.server.ports import PORTS, Port
from cogrip.server.worlds.registry import make_world

Address = Hashable


class Seat:
    """One person's place. The session state changes by protocol.session.SEAT alone."""

    def __init__(self, settings: SeatSettings) -> None:
        self.settings = settings
        self.state = "free"
        self.session = 0
        self.address: Address = None
        self.nonce = 0
        self.last_heard_ns = 0
        self.clock = Clock()
        self.port: Port | None = None
        self.on_object = False
        self.line_margin_j = 0.0
        self.account: ClientAccount | None = None  # what the client said when it left
        self.last: SeatAccount | None = None  # what we knew when it left

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
        self._port_before = np.zeros(len(self.seats))
        self.steps = 0
        self.ticks: Callable[[], TickCount] = lambda: TickCount(due=self.steps, run=self.steps)  # the loop sets its own
        self.travel_m = 0.0
        self.diverged = ""

    def sit(self, number: int, session: int, nonce: int, address: Address, now_ns: int) -> SeatSettings:
        """Give a free seat away."""
        seat = self.seats[number]
        seat.step("hello")
        seat.session, seat.nonce, seat.address, seat.last_heard_ns = session, nonce, address, now_ns
        seat.clock = Clock()
        seat.port = PORTS[seat.settings.coupling.kind](seat.settings)
        seat.on_object = False
        seat.line_margin_j = 0.0
        seat.account = seat.last = None
        self._port_before[number] = self.world.port_work[number]
        return seat.settings

    def rise(self, number: int, event: str) -> SeatAccount | None:
        """A person leaves (`leave`, `silence` or `stop`)."""
        seat = self.seats[number]
        if not seat.step(event):
            return None
        seat.last = self.seat_account(number)
        if seat.on_object:
            self.world.leave(number)
        seat.on_object = False
        seat.port = None
        return seat.last

    @property
    def deserted(self) -> bool:
        """Whether nobody sits here."""
        return not any(seat.port for seat in self.seats)

    def silent(self, now_ns: int) -> list[int]:
        """Seats that have not been heard for LOST_NS."""
        return [
            number
            for number, seat in enumerate(self.seats)
            if seat.state == "seated" and now_ns - seat.last_heard_ns > LOST_NS
        ]

    def tick(self, now_ns: int, frames: int = 1) -> list[tuple[Address, bytes]]:
        """Step the object; `frames` > 1 if the loop missed frames - 1 steps (the object stood still for them)."""
        world, seats = self.world, self.seats
        if self.deserted:  # an object that nobody holds is put down, and stays
            world.velocity = np.zeros(world.axes)
            self.steps += 1
            return []
        rows = []
        for number, seat in enumerate(seats):
            missed = frames
            if seat.port and not seat.on_object and seat.port.origin is not None:
                world.join(number, np.array(seat.port.origin))
                seat.on_object = True
                missed = 1  # nothing was missed of a line that has just begun
            rows.append(seat.port.take(missed) if seat.port and seat.on_object else self._idle)
        before = world.position
        if not any(seat.on_object for seat in seats):
            world.velocity = np.zeros(world.axes)  # an object that nobody holds is put down
        answers = world.step(np.array(rows)).tolist()
        self.steps += 1
        here = tuple(world.position.tolist())
        self.travel_m += dist(here, before)
        if world.left_workspace and not self.diverged:
            self.diverged = f"the object left the workspace at {here} m"
        state = here + tuple(world.velocity.tolist())
        work = (world.port_work - self._port_before).tolist()
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
            if port_in_j is not None:
                seat.line_margin_j = min(seat.line_margin_j, port_in_j - work[number])
            message = port.message(seat.session, seat.clock.stamp(now_ns), state, -work[number])
            out.append((seat.address, messages.encode(message)))
        return out

    def seat_account(self, number: int) -> SeatAccount:
        """What is known of a seat now, or was when it was left."""
        seat = self.seats[number]
        if seat.port is None:
            return seat.last or SeatAccount((0.0,) * self.world.axes, None, None, LinkCount())
        proxy = tuple(self.world.proxy(number).tolist())
        return SeatAccount(proxy, seat.port.up_margin_j, seat.line_margin_j, seat.port.count())

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
