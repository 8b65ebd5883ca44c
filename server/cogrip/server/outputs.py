"""Outputs of a server core: messages to send, events to report, datagrams dropped."""

from collections import Counter, deque

from cogrip.protocol.secure.channel import Address, place_text
from cogrip.protocol.wire import messages
from cogrip.server.events import ServerEvent
from cogrip.server.room import Room
from cogrip.server.seats.participants import Participant


class Outputs:
    """outbox: (address, message); events: for people and logs; dropped: counts by reason."""

    def __init__(
        self, outbox: deque[tuple[Address, bytes]] | None = None, events: deque[ServerEvent] | None = None
    ) -> None:
        self.outbox: deque[tuple[Address, bytes]] = deque() if outbox is None else outbox
        self.events: deque[ServerEvent] = deque() if events is None else events
        self.dropped: Counter[str] = Counter()

    def drop(self, reason: str, count: int = 1) -> None:
        """Count what goes no further."""
        self.dropped[reason] += count

    def send(self, message: messages.AnyMessage, address: Address) -> None:
        """Encode a message and put it into the outbox."""
        self.outbox.append((address, messages.encode(message)))

    def report(self, event: str, room: Room, who: Participant, words: str, address: Address = None) -> None:
        """Report an event of one participant. words: what follows the name."""
        where = place_text(address) if address is not None else ""
        text = f"{room.called}: {who.name} {words}"
        self.events.append(ServerEvent(event, text, room.called, who.name, where, token=who.token))
