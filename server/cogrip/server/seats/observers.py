"""Observers of a room: they see the object and the hands; nothing they send reaches either."""

from collections.abc import Sequence

from msgspec.structs import replace

from cogrip.protocol.axes import PLACES
from cogrip.protocol.secure.channel import Address
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import SHORT, VIEWED_SEATS, Observed, Person, Presence, View
from cogrip.protocol.wire.session import LOST_NS, QUIET_NS
from cogrip.server.seats.drawn_bodies import DrawnBodies
from cogrip.server.seats.participants import Observer, Seat
from cogrip.server.worlds.world import World

MOST_STATE, MOST_M, MOST_N, MOST_MS, MOST_J = (
    1e4,
    1e3,
    1e9,
    1e6,
    1e15,
)  # bounds of the fields of a view (`SPEC.md` section 3)
VIEWS_HZ = 64  # most views a second; a screen shows no more
PEOPLE_A_VIEW = 4  # number of people whose messages follow a view; more take turns


class ObserverSlots:
    """The observers of one room, by their numbers."""

    def __init__(self, places: int, network_hz: int) -> None:
        self.places = places
        self.observers: dict[int, Observer] = {}
        self._every = -(-network_hz // VIEWS_HZ)  # rounded up
        self._turn = 0
        self._bodies = DrawnBodies()

    @property
    def full(self) -> bool:
        """Return whether every slot is taken."""
        return len(self.observers) >= self.places

    def enter(self, session: int, nonce: int, now_ns: int) -> Observer:
        """Begin a session in the first free slot."""
        number = next(each for each in range(self.places) if each not in self.observers)
        self.observers[number] = observer = Observer(number, f"observer {number + 1}")
        observer.begin(session, nonce, now_ns)
        return observer

    def leave(self, number: int) -> None:
        """Free a slot."""
        del self.observers[number]

    def silent(self, now_ns: int) -> Sequence[Observer]:
        """Return the observers that have sent nothing for LOST_NS."""
        if not self.observers:
            return ()
        return [each for each in self.observers.values() if now_ns - each.last_received_ns > LOST_NS]

    def views(self, step: int, world: World, seats: Sequence[Seat], now_ns: int) -> list[tuple[Address, bytes]]:
        """Return (address, datagram) of every observer after `step`: bodies, a view, some people; none between two views."""
        if not self.observers or step % self._every:
            return []
        bodies = self._bodies.messages(step, world)
        people = self._next_people(step, world, seats, now_ns)
        views = self._views(step, world, [seat.number for seat in seats if seat.on_object], now_ns)
        return self._to_all(bodies) + views + self._to_all(people)

    def _to_all(self, told: Sequence[Observed]) -> list[tuple[Address, bytes]]:
        return [
            (observer.address, messages.encode(replace(each, session=observer.session)))
            for observer in self.observers.values()
            for each in told
        ]

    def _next_people(self, step: int, world: World, seats: Sequence[Seat], now_ns: int) -> list[Person]:
        """Return PEOPLE_A_VIEW of those who are seated, each time the next ones."""
        seated = [seat for seat in seats if seat.port is not None]
        if len(seated) <= PEOPLE_A_VIEW:
            chosen = seated
        else:
            chosen = [seated[(self._turn + each) % len(seated)] for each in range(PEOPLE_A_VIEW)]
            self._turn = (self._turn + PEOPLE_A_VIEW) % len(seated)
        return [_person(step, world, seat, now_ns) for seat in chosen]

    def _views(self, step: int, world: World, holding: list[int], now_ns: int) -> list[tuple[Address, bytes]]:
        seats = tuple(holding[:VIEWED_SEATS])
        places = world.places  # how bodies are turned is in `Bodies`
        state = _within(MOST_STATE, world.position[:places].tolist() + world.velocity[:places].tolist())
        proxies = _within(MOST_M, [value for number in seats for value in world.proxy(number)[:places].tolist()])
        forces = _within(MOST_N, [value for number in seats for value in world.force[number, :places].tolist()])
        views = [
            (each.address, View(each.session, step, state, seats, proxies, forces, each.clock.stamp(now_ns)))
            for each in self.observers.values()
        ]
        return [(address, messages.encode(view)) for address, view in views]


def _person(step: int, world: World, seat: Seat, now_ns: int) -> Person:
    """Return the message about one seated person; its session is the observer's, to be put in."""
    port, clock = seat.port, seat.clock
    assert port is not None
    quiet = now_ns - seat.last_received_ns >= QUIET_NS
    state: Presence = "joining" if not seat.on_object else "silent" if quiet else "live"
    count, handle, holds = port.count(), port.handle, seat.hand.holds
    return Person(
        1, step, seat.number, seat.name[:SHORT], state, _within(MOST_M, (port.hand or ())[:PLACES]),
        _within(MOST_M, world.offset[seat.number, :PLACES].tolist()) if seat.on_object else (),
        _ms(seat.rtt_ns), _ms(clock.return_ns), _ms(clock.forward_ns), port.playout_frames, port.behind, count.lost, count.sent,
        _joules(port.up_margin_j), _joules(seat.line_margin_j),
        _joules(port.up_reserve.now_j), _joules(seat.line_reserve.now_j),
        handle.buttons, handle.taken, handle.orientation, handle.grip_m,
        holds.position_scale or 1.0, holds.force_scale or 1.0, bool(holds.clutch),
    )  # fmt: skip


def _ms(value_ns: int | None) -> float | None:
    return None if value_ns is None else max(-MOST_MS, min(MOST_MS, value_ns * 1e-6))


def _joules(value_j: float | None) -> float | None:
    return value_j if value_j is not None and abs(value_j) <= MOST_J else None  # None for nan, too


def _within(bound: float, values: Sequence[float]) -> tuple[float, ...]:
    """Return the values within +-bound, 0 for NaN: one implausible hand takes the view from nobody."""
    return tuple([max(-bound, min(bound, value)) if value == value else 0.0 for value in values])
