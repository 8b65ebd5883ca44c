"""The session's two state machines, without I/O: who may say what when (`SPEC.md` section 4).

    client   idle --call--> calling --welcome--> seated --leave--> leaving --farewell--> closed
             calling: a hello every HELLO_EVERY; refused, or no answer in GIVE_UP_NS: closed
             seated: nothing heard for QUIET_NS: resuming; farewell (server stops): closed
             resuming: a hello with the ticket every HELLO_EVERY; welcome, or the session heard again: seated;
             refused, or silence of RESUME_GIVE_UP_NS: closed
    seat     free --hello--> seated --leave | silence of LOST_NS | server stops--> free
             seated --hello with its ticket--> seated, at another address

Both tables below are the only place that changes a state. A step that is not in the table leaves the state as it is.
"""

from collections import deque
from collections.abc import Mapping

import msgspec

from cogrip.protocol import messages
from cogrip.protocol.accounts import ClientAccount
from cogrip.protocol.clock import Clock
from cogrip.protocol.messages import (
    DEVICE_BYTES,
    MAGIC,
    NO_BOUND,
    PROTOCOL_VERSION,
    Farewell,
    Frame,
    Heartbeat,
    Hello,
    Leave,
    Power,
    Refuse,
    Role,
    State,
    View,
    Waves,
    Welcome,
)
from cogrip.protocol.rates import LEAST_DEVICE_HZ

HELLO_EVERY_NS = 250_000_000
GIVE_UP_NS = 3_000_000_000
HEARTBEAT_EVERY_NS = 250_000_000
STALE_NS = 100_000_000  # no new frame for so long: the hand's force goes to zero, the seat is kept
LOST_NS = 2_000_000_000  # no datagram for so long: the other end is gone
QUIET_NS = 500_000_000  # nothing heard for so long: the client tries to come back
RESUME_GIVE_UP_NS = 10_000_000_000  # nothing heard for so long: nor does it try any more
LEAVE_EVERY_NS = 100_000_000
LEAVE_GIVE_UP_NS = 600_000_000

SECONDS_OVER = "its --seconds are over"  # of a server whose time was set: no session is cut short
IN_ORDER = "the server was stopped"  # with this begins the farewell of a server that was told to end

FOR_CLIENTS = (Waves, State, Power, View)  # as a union it would be made anew for every datagram

Table = Mapping[tuple[str, str], str]

CLIENT: Table = {
    ("idle", "call"): "calling",
    ("calling", "welcome"): "seated",
    ("calling", "refuse"): "closed",
    ("calling", "silence"): "closed",
    ("calling", "leave"): "closed",
    ("seated", "leave"): "leaving",
    ("seated", "farewell"): "closed",
    ("seated", "silence"): "closed",  # without a ticket there is no way back
    ("seated", "quiet"): "resuming",
    ("resuming", "welcome"): "seated",
    ("resuming", "heard"): "seated",
    ("resuming", "refuse"): "closed",
    ("resuming", "silence"): "closed",
    ("resuming", "farewell"): "closed",
    ("resuming", "leave"): "leaving",
    ("leaving", "farewell"): "closed",
    ("leaving", "silence"): "closed",
}
SEAT: Table = {
    ("free", "hello"): "seated",
    ("seated", "leave"): "free",
    ("seated", "silence"): "free",
    ("seated", "stop"): "free",
    ("seated", "kick"): "free",
    ("seated", "resume"): "seated",
}


class ClientSession:
    """The client's half. `outbox` is what to send; `failed` says why it ended badly, "" if it did not.

    ended            why the server ended the session in order, "" if it did not

    welcome          the newest: another session number in it than before means that the seat is a new one
    fresh_ns         when there was last something that a force can be made of: a frame that came, newer than all before, or
                     one that is played in its time; before there are any, a sign of life
    away_ns          how long the last silence was that a session came back from
    resumed, renewed how often it came back: to its own seat, and to a new one
    """

    def __init__(self, hello: Hello) -> None:
        self._asked = hello
        self.hello = messages.padded(hello)  # what is said while nobody has answered
        self._since_ns = 0
        self._next_ns = 0
        self._leave = b""
        self.state = "idle"
        self.outbox: deque[bytes] = deque()
        self.clock = Clock()
        self.welcome: Welcome | None = None
        self.farewell: Farewell | None = None
        self.last_received_ns = self.fresh_ns = 0
        self._begun = False  # frames of this session were taken in
        self.away_ns = 0
        self.resumed = self.renewed = 0
        self.failed = self.ended = ""
        self.dropped: dict[str, int] = {}

    def _step(self, event: str) -> bool:
        after = CLIENT.get((self.state, event))
        if after is None:
            return False
        self.state = after
        return True

    def call(self, now_ns: int) -> None:
        self._step("call")
        self._since_ns = self._next_ns = now_ns
        self.poll(now_ns)

    def leave(self, reason: str, account: ClientAccount | None, now_ns: int) -> None:
        """Say goodbye, repeated until the farewell comes or LEAVE_GIVE_UP_NS have passed."""
        if self._step("leave") and self.welcome:
            text = messages.clipped(reason, messages.LEAVE_TEXT_BYTES)
            self._leave = messages.encode(Leave(self.welcome.session, text, account))
            self._since_ns = self._next_ns = now_ns
            self.poll(now_ns)

    def answer_farewell(self, account: ClientAccount) -> None:
        """The server stopped first: tell it, once, what this end knows."""
        if self.welcome:
            self.outbox.append(messages.encode(Leave(self.welcome.session, "the server stopped", account)))

    def drop(self, reason: str) -> None:
        self.dropped[reason] = self.dropped.get(reason, 0) + 1

    def answers(self, datagram: bytes) -> bool:
        """Whether this is a welcome to our hello: the way that it came by is the one to go on with."""
        try:
            message = messages.decode(datagram)
        except messages.MalformedError:
            return False
        return isinstance(message, Welcome) and message.nonce == self._asked.nonce

    def receive(self, datagram: bytes, now_ns: int) -> Frame | View | None:
        """Take in a datagram; what belongs to the coupling, or to an observer, is handed back.

        Anything unfit is counted by name.
        """
        try:
            message = messages.decode(datagram)
        except messages.MalformedError:
            self.drop("malformed")
            return None
        if isinstance(message, Welcome | Refuse):
            self._answer(message, now_ns)
            return None
        welcome = self.welcome
        if isinstance(message, Hello | Leave) or welcome is None:
            self.drop("unexpected")
            return None
        if message.session != welcome.session:
            self.drop("other session")
            return None
        if isinstance(message, FOR_CLIENTS) and isinstance(message, View) is (welcome.role == "player"):
            self.drop("unexpected")
            return None
        if self._step("heard"):
            self._back(now_ns)
        self.last_received_ns = now_ns
        if isinstance(message, Farewell):
            self._hear_farewell(message)
            return None
        if isinstance(message, Heartbeat):
            self.clock.read(message.stamp, now_ns)
            if not self._begun:  # the server's line begins once it has heard of the hand
                self.fresh_ns = now_ns
            return None
        return message

    def _hear_farewell(self, farewell: Farewell) -> None:
        asked = self.state == "leaving"
        if not self._step("farewell"):
            return
        self.farewell = farewell
        words = messages.shown(farewell.reason)
        if not asked and words.startswith(IN_ORDER):
            self.ended = words
        elif not asked:
            self.failed = f"the server said goodbye: {words}"

    def took(self, now_ns: int) -> None:
        """A frame was taken in that is newer than all before, or one was played in its time."""
        self._begun, self.fresh_ns = True, now_ns

    def _answer(self, message: Welcome | Refuse, now_ns: int) -> None:
        if message.nonce != self._asked.nonce:
            self.drop("other nonce")
            return
        before = self.welcome
        if isinstance(message, Refuse):
            if self._step("refuse"):
                self.failed = f"the server refused: {messages.shown(message.reason)} [{messages.shown(message.code)}]"
        elif before is not None and _other_seat(before, message):
            if self._step("refuse"):
                self.failed = "the server came back with another seat or other settings: join anew"
                self.outbox.append(messages.encode(Leave(message.session, "not the seat that was left")))
        elif message.role == "player" and message.settings.rates.device_hz < LEAST_DEVICE_HZ:
            if self._step("refuse"):
                self.failed = (
                    f"the server asks for rates.device_hz = {message.settings.rates.device_hz}, at least {LEAST_DEVICE_HZ} is "
                    "safe for a hand: raise it in the server's settings"
                )
                self.outbox.append(messages.encode(Leave(message.session, "device_hz is too low")))
        elif self._step("welcome"):
            if before is not None:
                self._back(now_ns, message.session != before.session)
            if before is None or message.session != before.session:
                self._begun, self.fresh_ns = False, now_ns
            self.welcome = message
            self.hello = messages.padded(_resuming(self._asked, message))
            self.last_received_ns = now_ns

    def _back(self, now_ns: int, renewed: bool = False) -> None:
        self.away_ns = now_ns - self.last_received_ns
        if renewed:
            self.renewed += 1
            self.clock = Clock()
        else:
            self.resumed += 1

    def stale(self, now_ns: int) -> bool:
        return now_ns - self.fresh_ns > STALE_NS

    def poll(self, now_ns: int) -> None:
        """Time passes: repeat what is unanswered, give up what has been silent too long."""
        if self.state == "calling":
            if now_ns - self._since_ns >= GIVE_UP_NS and self._step("silence"):
                self.failed = f"no server answered within {GIVE_UP_NS / 1e9:g} s"
            else:
                self._repeat(self.hello, HELLO_EVERY_NS, now_ns)
        elif self.state in ("seated", "resuming"):
            self._miss(now_ns - self.last_received_ns, now_ns)
        elif self.state == "leaving":
            if now_ns - self._since_ns >= LEAVE_GIVE_UP_NS:
                self._step("silence")
            elif self._leave:
                self._repeat(self._leave, LEAVE_EVERY_NS, now_ns)

    def _miss(self, silent_ns: int, now_ns: int) -> None:
        """The server has been silent for so long."""
        assert self.welcome is not None
        if not self.welcome.ticket:
            if silent_ns > LOST_NS and self._step("silence"):
                self.failed = f"the server has been silent for {LOST_NS / 1e9:g} s"
            return
        if silent_ns >= QUIET_NS and self._step("quiet"):
            self._next_ns = now_ns
        if self.state == "resuming":
            if silent_ns >= RESUME_GIVE_UP_NS and self._step("silence"):
                self.failed = f"no server for {RESUME_GIVE_UP_NS / 1e9:g} s"
            else:
                self._repeat(self.hello, HELLO_EVERY_NS, now_ns)

    def _repeat(self, datagram: bytes, every_ns: int, now_ns: int) -> None:
        if now_ns >= self._next_ns:
            self._next_ns += every_ns
            self.outbox.append(datagram)

    def heartbeat(self, now_ns: int) -> None:
        """In place of waves while there are none to send."""
        if self.state == "seated" and self.welcome and now_ns >= self._next_ns:
            self._next_ns = now_ns + HEARTBEAT_EVERY_NS
            self.outbox.append(messages.encode(Heartbeat(self.welcome.session, self.clock.stamp(now_ns))))


def _resuming(hello: Hello, welcome: Welcome) -> Hello:
    """The hello that asks for this very seat again."""
    name = welcome.settings.user if welcome.role == "player" else hello.name
    return msgspec.structs.replace(
        hello, room=welcome.settings.room, name=name, role=welcome.role, ticket=welcome.ticket
    )  # fmt: skip


def _other_seat(before: Welcome, after: Welcome) -> bool:
    """Whether a person cannot simply go on with what this welcome gives."""
    if before.role == after.role == "observer":
        return False
    return (before.role, before.settings) != (after.role, after.settings)


def make_hello(
    *, software: str, nonce: int, room: str, name: str, digest: str, device: str, axes: int, rate_hz: float,
    force_n: float = NO_BOUND, speed_mps: float = NO_BOUND, role: Role = "player", token: str = "",
) -> Hello:  # fmt: skip
    """A hello. force_n, speed_mps: the device record's; what is infinite there is said as NO_BOUND."""
    return Hello(
        MAGIC, PROTOCOL_VERSION, software, nonce, room, name, digest, messages.clipped(device, DEVICE_BYTES), axes, rate_hz,
        min(force_n, NO_BOUND), min(speed_mps, NO_BOUND), role, token,
    )  # fmt: skip


def unfit(
    hello: Hello, *, digest: str, axes: int, device_hz: int, whose: str = "this room at rates.device_hz"
) -> tuple[str, str] | None:
    """(code, reason) why a hello cannot be served, None if it can. The texts are what both sides print.

    device_hz: the seat's; whose: what it is that runs at it, and the setting that says so.
    """
    if hello.version != PROTOCOL_VERSION:
        return version_mismatch(hello.version)
    if hello.digest and hello.digest != digest:
        return "settings", f"your settings ({hello.digest}) are not the server's ({digest}): use the same file, or none"
    if hello.device_axes < axes:
        return "axes", f"device {hello.device} moves on {hello.device_axes} of the {axes} axes of this room"
    if hello.device_rate_hz < device_hz:
        return (
            "rate",
            f"device {hello.device} runs at {hello.device_rate_hz:g} Hz at most, {whose} = {device_hz}",
        )
    return None


def version_mismatch(theirs: int) -> tuple[str, str]:
    text = f"the client speaks protocol {theirs}, the server {PROTOCOL_VERSION}: install the same cogrip on both"
    return "version", text


def refusal(hello_nonce: int, code: str, reason: str) -> bytes:
    """A refusal as a datagram. Its reason is cut to what every client reads, and to less than the hello's length."""
    return messages.encode(Refuse(PROTOCOL_VERSION, hello_nonce, code, messages.clipped(reason)))


def nonce_of(datagram: bytes) -> int:
    """The nonce of a hello of another version, 0 if it cannot be read."""
    try:
        elements = msgspec.msgpack.decode(datagram, type=list[msgspec.Raw])
        return msgspec.msgpack.decode(elements[4], type=int)
    except (msgspec.DecodeError, IndexError, UnicodeDecodeError, RecursionError):
        return 0
