"""Observers of a room: they see the object and the hands; nothing they send reaches either."""

from cogrip.protocol import messages
from cogrip.protocol.channel import Address
from cogrip.protocol.messages import VIEWED_SEATS, View
from cogrip.protocol.session import LOST_NS
from cogrip.server.participants import Observer
from cogrip.server.worlds.world import World

MOST_STATE, MOST_M, MOST_N = 1e4, 1e3, 1e9  # bounds of the fields of a view (`SPEC.md` section 3)
VIEWS_HZ = 32  # at most; a picture needs no more


class ObserverSlots:
    """The observers of one room, by their numbers."""

    def __init__(self, places: int, network_hz: int) -> None:
        self.places = places
        self.observers: dict[int, Observer] = {}
        self._every = -(-network_hz // VIEWS_HZ)  # rounded up

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

    def silent(self, now_ns: int) -> list[Observer]:
        """Return the observers that have not been heard for LOST_NS."""
        return [each for each in self.observers.values() if now_ns - each.last_received_ns > LOST_NS]

    def views(self, step: int, world: World, holding: list[int], now_ns: int) -> list[tuple[Address, bytes]]:
        """Return (address, datagram) of every observer after `step`; none between two views. holding: seats on the object."""
        if not self.observers or step % self._every:
            return []
        seats = tuple(holding[:VIEWED_SEATS])
        state = _within(MOST_STATE, world.position.tolist() + world.velocity.tolist())
        proxies = _within(MOST_M, [value for number in seats for value in world.proxy(number).tolist()])
        forces = _within(MOST_N, [value for number in seats for value in world.force[number].tolist()])
        views = [
            (each.address, View(each.session, step, state, seats, proxies, forces, each.clock.stamp(now_ns)))
            for each in self.observers.values()
        ]
        return [(address, messages.encode(view)) for address, view in views]


def _within(bound: float, values: list[float]) -> tuple[float, ...]:
    """Return the values within +-bound, 0 for NaN: one implausible hand takes the view from nobody."""
    return tuple([max(-bound, min(bound, value)) if value == value else 0.0 for value in values])
