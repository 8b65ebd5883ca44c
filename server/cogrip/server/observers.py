"""Observers of a room: they see the object and the hands, and nothing they say reaches either."""

from cogrip.protocol import messages
from cogrip.protocol.channel import Address
from cogrip.protocol.clock import Clock
from cogrip.protocol.messages import VIEWED_SEATS, View
from cogrip.protocol.session import LOST_NS
from cogrip.server.rate_limit import HELLOS, Buckets
from cogrip.server.worlds.world import World

MOST_STATE, MOST_M, MOST_N = 1e4, 1e3, 1e9  # what a view can say (`SPEC.md` section 3)
VIEWS_HZ = 32  # at most; a picture needs no more


class Observer:
    """One who looks on."""

    def __init__(self, name: str, session: int, nonce: int, address: Address, now_ns: int) -> None:
        self.name = name
        self.session = session
        self.nonce = nonce
        self.address = address
        self.last_received_ns = self.since_ns = now_ns
        self.clock = Clock()
        self.ticket = ""  # its mark
        self.token = ""
        self.hellos = Buckets(1, HELLOS)


class ObserverSlots:
    """The observers of one room, by their numbers."""

    def __init__(self, places: int, network_hz: int) -> None:
        self.places = places
        self.observers: dict[int, Observer] = {}
        self._every = -(-network_hz // VIEWS_HZ)  # rounded up

    @property
    def full(self) -> bool:
        return len(self.observers) >= self.places

    def enter(self, session: int, nonce: int, address: Address, now_ns: int) -> int:
        """Take the first free place; gives its number."""
        number = next(each for each in range(self.places) if each not in self.observers)
        self.observers[number] = Observer(f"observer {number + 1}", session, nonce, address, now_ns)
        return number

    def leave(self, number: int) -> None:
        del self.observers[number]

    def silent(self, now_ns: int) -> list[int]:
        return [number for number, each in self.observers.items() if now_ns - each.last_received_ns > LOST_NS]

    def views(self, step: int, world: World, seated: list[int], now_ns: int) -> list[tuple[Address, bytes]]:
        """What goes out after `step`; nothing between two views, or where nobody looks on."""
        if not self.observers or step % self._every:
            return []
        seats = tuple(seated[:VIEWED_SEATS])
        state = _within(MOST_STATE, world.position.tolist() + world.velocity.tolist())
        proxies = _within(MOST_M, [value for number in seats for value in world.proxy(number).tolist()])
        forces = _within(MOST_N, [value for number in seats for value in world.force[number].tolist()])
        return [
            (
                each.address,
                messages.encode(View(each.session, step, state, seats, proxies, forces, each.clock.stamp(now_ns))),
            )
            for each in self.observers.values()
        ]


def _within(bound: float, values: list[float]) -> tuple[float, ...]:
    """One hand that is nowhere takes the picture from nobody."""
    return tuple([max(-bound, min(bound, value)) if value == value else 0.0 for value in values])
