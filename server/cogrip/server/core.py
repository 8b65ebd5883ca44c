"""The server without I/O: datagrams in, datagrams out; many rooms, no socket, no clock."""

from collections import deque
from collections.abc import Callable, Sequence

from cogrip.protocol import messages
from cogrip.protocol.messages import PROTOCOL_VERSION, Farewell, Heartbeat, Hello, Leave, State, Waves
from cogrip.protocol.session import nonce_of, refusal, unfit, version_mismatch
from cogrip.protocol.settings import Settings
from cogrip.server.room import Address, Room


class ServerCore:
    """`outbox` holds (address, datagram) to send, `events` what people should hear of, `dropped` counts by reason.

    new_session: gives a random session number from 1 to 2^63 - 1 (its source is the caller's: no chance in here).
    """

    def __init__(self, rooms: Sequence[Settings], software: str, new_session: Callable[[], int]) -> None:
        self.rooms = [Room(settings) for settings in rooms]
        self._software = software
        self._new_session = new_session
        self._seated: dict[Address, tuple[Room, int]] = {}
        self.outbox: deque[tuple[Address, bytes]] = deque()
        self.events: deque[str] = deque()
        self.dropped: dict[str, int] = {}

    def drop(self, reason: str) -> None:
        self.dropped[reason] = self.dropped.get(reason, 0) + 1

    def socket_failed(self, reason: str) -> None:
        """The socket refused to send or receive: counted as a drop."""
        self.drop(f"socket: {reason}")

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> None:
        """Take in one datagram. Whatever does not belong is dropped and counted by name."""
        try:
            message = messages.decode(datagram)
        except messages.MalformedError:
            theirs = messages.foreign_version(datagram)
            if theirs is None:
                self.drop("malformed")
            elif len(datagram) < messages.HELLO_BYTES:
                self.drop("short hello")
            else:
                self._refuse(nonce_of(datagram), address, *version_mismatch(theirs))
            return
        if isinstance(message, Hello):
            self._greet(message, len(datagram), address, now_ns)
            return
        place = self._seated.get(address)
        if place is None:
            self.drop("not seated")
            return
        room, number = place
        seat = room.seats[number]
        if isinstance(message, Waves | State | Heartbeat | Leave):
            if message.session != seat.session:
                self.drop("other session")
                return
            seat.last_heard_ns = now_ns
            if isinstance(message, Leave):
                self._bid_farewell(room, number, message, now_ns)
                return
            seat.clock.read(message.stamp, now_ns)
            if isinstance(message, Heartbeat):
                return
            if seat.port is None or not seat.port.receive(message):
                self.drop("unfit")
            return
        self.drop("unexpected")

    def tick(self, room: Room, now_ns: int, frames: int = 1) -> None:
        """One step of one room; its datagrams go to the outbox."""
        for number in room.silent(now_ns):
            seat = room.seats[number]
            self._seated.pop(seat.address, None)
            room.rise(number, "silence")
            self.drop("seat timed out")
            self.events.append(f"{room.name}: {seat.settings.user} has been silent for too long and lost the seat")
        self.outbox.extend(room.tick(now_ns, frames))

    def stop(self, reason: str) -> None:
        """Tell everyone goodbye; their accounts may still come (`awaits_accounts`)."""
        for room in self.rooms:
            for number, seat in enumerate(room.seats):
                account = room.rise(number, "stop")
                if account is not None:
                    farewell = Farewell(seat.session, reason, account, room.account())
                    self.outbox.append((seat.address, messages.encode(farewell)))

    @property
    def awaits_accounts(self) -> bool:
        """True while someone whose seat was ended by `stop` has not said what they know."""
        return any(seat.last is not None and seat.account is None for room in self.rooms for seat in room.seats)

    def _refuse(self, nonce: int, address: Address, code: str, reason: str) -> None:
        self.drop(f"refused: {code}")
        self.events.append(f"refused {_place(address)}: {reason} [{code}]")
        self.outbox.append((address, refusal(nonce, code, reason)))

    def _greet(self, hello: Hello, size: int, address: Address, now_ns: int) -> None:
        if size < messages.HELLO_BYTES:
            self.drop("short hello")  # an answer may not be longer than the question
            return
        place = self._seated.get(address)
        if place is not None:
            room, number = place
            if room.seats[number].nonce == hello.nonce:  # our welcome was lost: say it again
                self._welcome(room, number, address)
                return
            self._seated.pop(address)
            room.rise(number, "silence")
        found = self._find(hello)
        if isinstance(found[0], str):
            self._refuse(hello.nonce, address, found[0], found[1])
            return
        room, number = found
        misfit = unfit(hello, digest=room.digest, axes=room.world.axes, device_hz=room.settings.rates.device_hz)
        if misfit is not None:
            self._refuse(hello.nonce, address, *misfit)
            return
        self._seated.pop(room.seats[number].address, None)  # whoever sat here before
        room.sit(number, self._new_session(), hello.nonce, address, now_ns)
        self._seated[address] = (room, number)
        self.events.append(
            f"{room.name}: {room.seats[number].settings.user} joined from {_place(address)} with {hello.device}"
        )
        self._welcome(room, number, address)

    def _find(self, hello: Hello) -> tuple[Room, int] | tuple[str, str]:
        rooms = [room for room in self.rooms if hello.room in ("", room.name)]
        if not rooms:
            return (
                "room",
                f"there is no room {hello.room!r} here; there is: {', '.join(room.name for room in self.rooms)}",
            )
        for room in rooms:
            for number, seat in enumerate(room.seats):
                if seat.state == "free" and hello.name in ("", seat.settings.user):
                    return room, number
        names = [seat.settings.user for room in rooms for seat in room.seats]
        if hello.name and hello.name not in names:
            return "name", f"no seat is kept for {hello.name!r}; seats are: {', '.join(names)}"
        if hello.name:
            return "taken", f"the seat of {hello.name!r} is taken; wait until it is left or time out"
        return "full", f"the room is full: all {len(names)} seats are taken"

    def _welcome(self, room: Room, number: int, address: Address) -> None:
        seat = room.seats[number]
        welcome = messages.Welcome(
            PROTOCOL_VERSION, seat.nonce, seat.session, room.digest, self._software, seat.settings
        )
        self.outbox.append((address, messages.encode(welcome)))

    def _bid_farewell(self, room: Room, number: int, leave: Leave, now_ns: int) -> None:
        seat = room.seats[number]
        account = room.rise(number, "leave")
        if seat.account is None:
            seat.account = leave.account
        if account is not None:
            self.events.append(f"{room.name}: {seat.settings.user} left: {leave.reason}")
        # the seat keeps its address until the next hello, so that a repeated leave is answered again
        farewell = Farewell(seat.session, "goodbye", account or seat.last, room.account())
        self.outbox.append((seat.address, messages.encode(farewell)))


def _place(address: Address) -> str:
    """An address for people."""
    return f"{address[0]}:{address[1]}" if isinstance(address, tuple) and len(address) >= 2 else str(address)
