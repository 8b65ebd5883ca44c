"""Front of a cluster on one host: it has a public socket and the tokens, and redirects each hello to the host of its room."""

import socket
from collections import Counter
from collections.abc import Callable, Sequence

from cogrip.machine.stop import Stop
from cogrip.protocol.secure.channel import Address
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import HELLO_BYTES, MOST_FRONTS, PROTOCOL_VERSION, Hello, MalformedError, Redirect
from cogrip.protocol.wire.session import foreign_version, nonce_of, refusal, version_mismatch
from cogrip.server.admission.admission import Authenticator, Denied
from cogrip.server.events import ServerEvent
from cogrip.server.hosting.cluster.connection import RemoteRooms
from cogrip.server.hosting.cluster.directory import taken_seats
from cogrip.server.hosting.link import PeerAddress
from cogrip.server.hosting.public_socket import FrontChannel, PublicSocket


class ClusterFront(PublicSocket):
    """Front of rooms on the hosts of a cluster. pool: where they are."""

    def __init__(
        self, public: socket.socket, rooms: Sequence[Settings], pool: RemoteRooms, stop: Stop,
        say: Callable[[ServerEvent], None], channel: FrontChannel, authenticator: Authenticator | None = None,
    ) -> None:  # fmt: skip
        super().__init__(public, rooms, pool, stop, say, channel, authenticator)
        self.pool = pool
        self._told: dict[str, str] = {}

    def rooms_of(self, user: str) -> set[str]:
        """Return the rooms where this person has a seat, as the rooms reported last."""
        return {room for room, name in taken_seats(self.pool.homes) if name == user}

    def drops(self) -> dict[str, int]:
        """Return the drop counts by reason, those of the cluster among them."""
        return dict(Counter(super().drops()) + Counter(self.pool.counts))

    def _poll(self, now_ns: int) -> None:
        self.pool.poll(now_ns * 1e-9)
        while self.pool.lines:
            self.say(self.pool.lines.popleft())
        for answer in self.pool.answers():
            self.answered(answer)
        for room, home in self.pool.homes.items():
            if room in self.rooms and self._told.get(room) != home.place:
                self._told[room] = home.place
                self.say(ServerEvent("notice", f"room {room} is served at {home.place}", room))

    def _arrived(self, datagram: bytes, address: PeerAddress, now_ns: int, arrived_ns: int) -> None:
        for message in self._channel.receive(datagram, address, now_ns):
            self._answer(message, address)
        self._channel.renewed.clear()  # nobody has a seat here

    def _answer(self, message: bytes, address: PeerAddress) -> None:
        """Answer a hello; drop and count anything else."""
        version = None
        try:
            hello = messages.decode(message)
        except MalformedError:
            hello, version = None, foreign_version(message)
        if version is None and not isinstance(hello, Hello):
            self.dropped["malformed" if hello is None else "not seated"] += 1
        elif len(message) < HELLO_BYTES:
            self.dropped["short hello"] += 1
        elif version is not None:
            self._send(refusal(nonce_of(message), *version_mismatch(version)), address)
        elif isinstance(hello, Hello):
            self._redirect(hello, address)

    def _redirect(self, hello: Hello, address: Address) -> None:
        verdict = self._authenticator.admit(hello)
        if verdict is None:
            self.dropped["hello not judged yet"] += 1
            return
        if isinstance(verdict, Denied) and not hello.ticket:  # a ticket outlives its token; the room judges it
            room: str | Denied = verdict
        else:
            room = self.room_for(hello, verdict, taken_seats(self.pool.homes))
        if isinstance(room, Denied):
            assert isinstance(address, tuple)
            self._refuse(hello, room, address)
        elif home := self.pool.homes.get(room):
            fronts = self.pool.fronts[:MOST_FRONTS]
            self._send(messages.encode(Redirect(PROTOCOL_VERSION, hello.nonce, home.place, fronts)), address)
        else:
            self.dropped["room not there yet"] += 1  # the hello comes again
