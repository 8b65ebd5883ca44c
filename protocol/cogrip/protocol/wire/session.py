"""The session's two state machines, without I/O: who may send what in which state (`SPEC.md` section 4).

The two tables below are the only place that changes a state. A step that is not in the table leaves the state as it is.
A client sends a hello every HELLO_EVERY_NS while it is connecting or, with its ticket, resuming.
"""

from collections import Counter, deque
from collections.abc import Mapping
from typing import Literal

import msgspec

from cogrip.protocol.axes import GRIP_AXES, POSE_AXES
from cogrip.protocol.settings.rates import LEAST_DEVICE_HZ
from cogrip.protocol.texts import clipped, shown
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.accounts import ClientAccount
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.messages import (
    PROTOCOL_VERSION,
    Farewell,
    Frame,
    Heartbeat,
    Hello,
    Leave,
    Observed,
    Redirect,
    Refuse,
    Restart,
    View,
    Welcome,
)

HELLO_EVERY_NS = 250_000_000
GIVE_UP_NS = 3_000_000_000
HEARTBEAT_EVERY_NS = 250_000_000
STALE_NS = 100_000_000  # time without a new frame after which the hand's force goes to zero; the seat is kept
LOST_NS = 2_000_000_000  # time without a datagram after which the other end is gone
QUIET_NS = 500_000_000  # time without a datagram after which the client tries to resume
RESUME_GIVE_UP_NS = 10_000_000_000  # time without a datagram and without a handshake after which the client gives up
RESUME_MOST_NS = 30_000_000_000
"""Time without a datagram after which the client gives up although handshakes are made: its rooms are not there yet."""
LEAVE_EVERY_NS = 100_000_000
LEAVE_GIVE_UP_NS = 600_000_000

SECONDS_OVER = "its --seconds are over"  # end of a server with a time limit: no session is cut short
IN_ORDER = "the server was stopped"  # beginning of the farewell of a server that was stopped on purpose

MOST_REDIRECTS = 4  # most redirects in a row

FOR_OBSERVERS = (View, messages.Person, messages.Bodies, messages.Note)
"""Messages for observers, as a tuple: a union would be made for every datagram."""
ANSWERS, NOT_OF_A_SESSION = (Welcome, Refuse), (Hello, Leave, messages.Edges, Redirect)
FOR_CLIENTS = (messages.Waves, messages.State, messages.Power, messages.Partner, messages.SetHand, *FOR_OBSERVERS)

ClientState = Literal["idle", "connecting", "seated", "resuming", "leaving", "closed"]
ClientEvent = Literal["connect", "welcome", "refuse", "silence", "leave", "farewell", "quiet", "received", "restart"]
Table = Mapping[tuple[str, str], str]

CLIENT: Mapping[tuple[ClientState, ClientEvent], ClientState] = {
    ("idle", "connect"): "connecting",
    ("connecting", "welcome"): "seated",
    ("connecting", "refuse"): "closed",
    ("connecting", "silence"): "closed",
    ("connecting", "leave"): "closed",
    ("seated", "leave"): "leaving",
    ("seated", "farewell"): "closed",
    ("seated", "silence"): "closed",  # without a ticket nothing can be resumed
    ("seated", "quiet"): "resuming",
    ("seated", "restart"): "resuming",
    ("resuming", "welcome"): "seated",
    ("resuming", "received"): "seated",
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
    """The client's half of a session.

    outbox           datagrams to send, oldest first
    dropped          count of dropped datagrams by reason
    failed           why the session ended badly, "" if it did not
    ended            why the server ended it on purpose, "" if it did not
    welcome          the newest one; another session number than before means a new seat session
    farewell         the server's, None before it came
    last_received_ns time of the newest datagram of this session
    fresh_ns         time of the newest input for a force: a frame newer than all before, or one played in its time;
                     before there are any, a welcome or heartbeat
    silence_ns       duration of the last silence that ended in a resumption
    resumed, renewed number of resumptions: of the own seat, and with a new seat session
    restarting       the server has said that it restarts, and no welcome has come since
    give_up_ns       silence after which a resumption is given up, where the server does not ask for more
    """

    def __init__(self, hello: Hello) -> None:
        self._asked = hello
        self.hello = messages.padded(hello)  # sent until the server answers
        self._since_ns = self._next_ns = 0
        self._leave = b""
        self.state: ClientState = "idle"
        self.outbox: deque[bytes] = deque()
        self.clock = MessageClock()
        self.welcome: Welcome | None = None
        self.farewell: Farewell | None = None
        self.last_received_ns = self.fresh_ns = self._reached_ns = 0
        self._begun = False  # a frame of this session has been taken in
        self.silence_ns = self.resumed = self.renewed = 0
        self.failed = self.ended = ""
        self.restarting = False
        self.give_up_ns = RESUME_GIVE_UP_NS
        self._wait_ns = 0  # as the server asks that restarts
        self.dropped: Counter[str] = Counter()

    def _step(self, event: ClientEvent) -> bool:
        after = CLIENT.get((self.state, event))
        if after is None:
            return False
        self.state = after
        return True

    def connect(self, now_ns: int) -> None:
        """Ask for a seat."""
        self._step("connect")
        self._since_ns = self._next_ns = now_ns
        self.poll(now_ns)

    def leave(self, reason: str, account: ClientAccount | None, now_ns: int) -> None:
        """Send a leave, repeated until the farewell comes or LEAVE_GIVE_UP_NS have passed."""
        if self._step("leave") and self.welcome:
            text = clipped(reason, messages.LEAVE_TEXT_BYTES)
            self._leave = messages.encode(Leave(self.welcome.session, text, account))
            self._since_ns = self._next_ns = now_ns
            self.poll(now_ns)

    def answer_farewell(self, account: ClientAccount) -> None:
        """Send one leave with this end's account to a server that stopped first."""
        if self.welcome:
            self.outbox.append(messages.encode(Leave(self.welcome.session, "the server stopped", account)))

    def drop(self, reason: str) -> None:
        """Count a dropped datagram."""
        self.dropped[reason] += 1

    def is_welcome(self, datagram: bytes) -> bool:
        """Return whether this is a welcome to this session's hello: then its path is the one to migrate to."""
        try:
            message = messages.decode(datagram)
        except messages.MalformedError:
            return False
        return isinstance(message, Welcome) and message.nonce == self._asked.nonce

    def redirect(self, datagram: bytes) -> Redirect | None:
        """Return the redirect that answers this session's hello, where one is awaited and this is one."""
        if self.state not in ("connecting", "resuming"):
            return None
        try:
            message = messages.decode(datagram)
        except messages.MalformedError:
            return None
        return message if isinstance(message, Redirect) and message.nonce == self._asked.nonce else None

    def receive(self, datagram: bytes, now_ns: int) -> Frame | View | Observed | messages.SetHand | None:
        """Handle a datagram; return its message for coupling or observer. One that does not fit is dropped and counted."""
        try:
            message = messages.decode(datagram)
        except messages.MalformedError:
            self.drop("malformed")
            return None
        welcome = self.welcome
        player = welcome if welcome is not None and welcome.role == "player" and self.state == "seated" else None
        if type(message) is messages.Waves and player is not None and message.session == player.session:
            self.last_received_ns = now_ns  # nearly all messages: a short cut of what follows
            return message
        if isinstance(message, ANSWERS):
            self._receive_answer(message, now_ns)
            return None
        if isinstance(message, NOT_OF_A_SESSION) or welcome is None:
            self.drop("unexpected")
            return None
        if message.session != welcome.session:
            self.drop("other session")
            return None
        if isinstance(message, FOR_CLIENTS) and isinstance(message, FOR_OBSERVERS) is (welcome.role == "player"):
            self.drop("unexpected")
            return None
        if self.restarting or isinstance(message, Restart):
            self._hold_off(message, now_ns)
            return None
        if self._step("received"):
            self._count_resumption(now_ns)
        self.last_received_ns = now_ns
        if isinstance(message, Farewell):
            self._receive_farewell(message)
            return None
        if isinstance(message, Heartbeat):
            self.clock.read(message.stamp, now_ns)
            if not self._begun:  # the server's line begins with the hand's first frame
                self.fresh_ns = max(self.fresh_ns, now_ns)
            return None
        return message

    def _receive_farewell(self, farewell: Farewell) -> None:
        leaving = self.state == "leaving"
        if not self._step("farewell"):
            return
        self.farewell = farewell
        reason = shown(farewell.reason)
        if not leaving and reason.startswith(IN_ORDER):
            self.ended = reason
        elif not leaving:
            self.failed = f"the server said goodbye: {reason}"

    def _hold_off(self, told: object, now_ns: int) -> None:
        """Let go at once, and wait for the next server; drop what the one that ends has sent before."""
        if self.restarting or not isinstance(told, Restart):
            self.drop("before the restart")
            return
        if self.welcome is None or not self.welcome.ticket:  # nothing can be resumed
            self.drop("unexpected")
            return
        if self._step("restart"):
            self._next_ns = now_ns
        if self.state == "resuming":
            self.restarting, self._wait_ns, self.last_received_ns = True, told.wait_ms * 1_000_000, now_ns

    def mark_fresh(self, now_ns: int) -> None:
        """Record that a frame was taken in that is newer than all before, or that one was played in its time."""
        self._begun, self.fresh_ns = True, max(self.fresh_ns, now_ns)  # it may have come before the first tick

    def _receive_answer(self, message: Welcome | Refuse, now_ns: int) -> None:
        if message.nonce != self._asked.nonce:
            self.drop("other nonce")
            return
        before = self.welcome
        fault = None if isinstance(message, Refuse) else _unacceptable(before, message, self._asked)
        if not self._step("refuse" if fault or isinstance(message, Refuse) else "welcome"):
            self.drop("late answer")
        elif isinstance(message, Refuse):
            self.failed = f"the server refused: {shown(message.reason)} [{shown(message.code)}]"
        elif fault is not None:
            goodbye, self.failed = fault
            self.outbox.append(messages.encode(Leave(message.session, goodbye)))
        else:
            renewed = before is None or message.session != before.session
            if before is not None:
                self._count_resumption(now_ns, renewed)
            if renewed:
                self._begun, self.fresh_ns = False, now_ns
            self.welcome = message
            self.restarting, self._wait_ns = False, 0
            self.hello = messages.padded(_resumption_hello(self._asked, message))
            self.last_received_ns = now_ns

    def _count_resumption(self, now_ns: int, renewed: bool = False) -> None:
        self.silence_ns = now_ns - self.last_received_ns
        if renewed:
            self.renewed += 1
            self.clock = MessageClock()
        else:
            self.resumed += 1

    def stale(self, now_ns: int) -> bool:
        """Return whether the newest input for a force is too old to make one."""
        return now_ns - self.fresh_ns > STALE_NS

    def poll(self, now_ns: int) -> None:
        """Run the timers: repeat what is unanswered, end the session after the longest silence. Call at least every tick."""
        if self.state == "seated" and now_ns - self.last_received_ns < QUIET_NS:
            return
        if self.state == "connecting":
            if now_ns - self._since_ns >= GIVE_UP_NS and self._step("silence"):
                self.failed = f"no server answered within {GIVE_UP_NS / 1e9:g} s"
            else:
                self._repeat(self.hello, HELLO_EVERY_NS, now_ns)
        elif self.state in ("seated", "resuming"):
            self._check_silence(now_ns - self.last_received_ns, now_ns)
        elif self.state == "leaving":
            if now_ns - self._since_ns >= LEAVE_GIVE_UP_NS:
                self._step("silence")
            elif self._leave:
                self._repeat(self._leave, LEAVE_EVERY_NS, now_ns)

    def reached(self, now_ns: int) -> None:
        """Note a handshake with the server: it is there, if not its room yet."""
        self._reached_ns = now_ns

    def _check_silence(self, silent_ns: int, now_ns: int) -> None:
        assert self.welcome is not None
        if not self.welcome.ticket:
            if silent_ns > LOST_NS and self._step("silence"):
                self.failed = f"the server has been silent for {LOST_NS / 1e9:g} s"
            return
        if silent_ns >= QUIET_NS and self._step("quiet"):
            self._next_ns = now_ns
        if self.state == "resuming":
            alone_ns = min(silent_ns, now_ns - self._reached_ns)
            give_up_ns = max(self.give_up_ns, self._wait_ns)
            over = alone_ns >= give_up_ns or silent_ns >= max(RESUME_MOST_NS, give_up_ns)
            if over and self._step("silence"):
                self.failed = f"no server for {silent_ns / 1e9:.0f} s"
            else:
                self._repeat(self.hello, HELLO_EVERY_NS, now_ns)

    def _repeat(self, datagram: bytes, every_ns: int, now_ns: int) -> None:
        if now_ns >= self._next_ns:
            self._next_ns += every_ns
            self.outbox.append(datagram)

    def heartbeat(self, now_ns: int) -> None:
        """Send a heartbeat when it is due, while there are no waves to send."""
        if self.state == "seated" and self.welcome and now_ns >= self._next_ns:
            self._next_ns = now_ns + HEARTBEAT_EVERY_NS
            self.outbox.append(messages.encode(Heartbeat(self.welcome.session, self.clock.stamp(now_ns))))


def _resumption_hello(hello: Hello, welcome: Welcome) -> Hello:
    """Return the hello that asks for this very seat again."""
    name = welcome.settings.user if welcome.role == "player" else hello.name
    seat = {"room": welcome.settings.room, "name": name, "role": welcome.role, "ticket": welcome.ticket}
    return msgspec.structs.replace(hello, **seat)


def _unacceptable(before: Welcome | None, after: Welcome, hello: Hello) -> tuple[str, str] | None:
    """Return (reason for the leave, failure) where a person cannot take, or go on with, the seat of this welcome."""
    both_observe = before is not None and before.role == after.role == "observer"
    if before and not both_observe and (before.role, before.settings) != (after.role, after.settings):
        return "not the seat that was left", "the server came back with another seat or other settings: join anew"
    if after.role == "observer":
        return None
    if why := unfit_axes(hello, after.settings.object.axes):
        return "a seat of other axes", why
    device_hz = after.settings.rates.device_hz
    if device_hz >= LEAST_DEVICE_HZ:
        return None
    return "device_hz is too low", (
        f"the server asks for rates.device_hz = {device_hz}, at least {LEAST_DEVICE_HZ} is safe for a hand: raise it in the "
        "server's settings"
    )


def make_hello(
    *, software: str, nonce: int, room: str, name: str, digest: str, device: str, axes: int, rate_hz: float,
    force_n: float = messages.NO_BOUND, speed_mps: float = messages.NO_BOUND, role: messages.Role = "player", token: str = "",
    torque_nm: float = 0.0, speed_radps: float = 0.0,
) -> Hello:  # fmt: skip
    """Return a hello. force_n to speed_radps: bounds of the device record; an infinite one is sent as NO_BOUND."""
    address = clipped(device, messages.DEVICE_BYTES)
    bounds = [min(bound, messages.NO_BOUND) for bound in (force_n, speed_mps, torque_nm, speed_radps)]
    head = messages.MAGIC, PROTOCOL_VERSION, software, nonce, room, name, digest, address
    force, speed, torque, turning = bounds
    return Hello(*head, axes, rate_hz, force, speed, role, token, "", torque, turning)


def unfit_axes(hello: Hello, axes: int) -> str:
    """Return why a device cannot have a seat of so many axes, "" if it can."""
    if axes == GRIP_AXES and hello.device_axes != axes:
        return (
            f"device {hello.device} has no gripper with force, and this seat's tool is one; take another device or seat"
        )
    if hello.device_axes < axes:
        cure = ': set orientation = "free", "damped" or "fixed" for this seat' if axes == POSE_AXES else ""
        return f"device {hello.device} moves on {hello.device_axes} of the {axes} axes of this room{cure}"
    return ""


def unfit(
    hello: Hello, *, digest: str, axes: int, device_hz: int, whose: str = "this room at rates.device_hz"
) -> tuple[str, str] | None:
    """Return (code, reason) why a hello cannot be served, None if it can. Both sides print the reason.

    device_hz: rate of the seat; whose: what runs at that rate, and by which setting.
    """
    if hello.version != PROTOCOL_VERSION:
        return version_mismatch(hello.version)
    if hello.digest and hello.digest != digest:
        return "settings", f"your settings ({hello.digest}) are not the server's ({digest}): use the same file, or none"
    if why := unfit_axes(hello, axes):
        return "axes", why
    if hello.device_rate_hz < device_hz:
        return "rate", f"device {hello.device} runs at {hello.device_rate_hz:g} Hz at most, {whose} = {device_hz}"
    return None


def version_mismatch(theirs: int) -> tuple[str, str]:
    """Return (code, reason) for a client of another protocol version."""
    text = f"the client speaks protocol {theirs}, the server {PROTOCOL_VERSION}: install the same cogrip on both"
    return "version", text


def refusal(hello_nonce: int, code: str, reason: str) -> bytes:
    """Return a refusal as a datagram. The reason is clipped: every client reads it, and no answer is longer than its hello."""
    return messages.encode(Refuse(PROTOCOL_VERSION, hello_nonce, code, clipped(reason)))


def foreign_version(datagram: bytes) -> int | None:
    """Return the protocol version of a hello that `decode` refused for its version; None if it is not one."""
    try:
        elements = msgspec.msgpack.decode(datagram[: messages.MAX_MESSAGE_BYTES], type=list[msgspec.Raw])
        if len(elements) < 3 or msgspec.msgpack.decode(elements[0], type=int) != 1:
            return None
        if msgspec.msgpack.decode(elements[1], type=str) != messages.MAGIC:
            return None
        version = msgspec.msgpack.decode(elements[2], type=int)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    return version if version != PROTOCOL_VERSION else None


def nonce_of(datagram: bytes) -> int:
    """Return the nonce of a hello of another version, 0 if it cannot be read."""
    try:
        elements = msgspec.msgpack.decode(datagram, type=list[msgspec.Raw])
        return msgspec.msgpack.decode(elements[4], type=int)
    except (msgspec.DecodeError, IndexError, UnicodeDecodeError, RecursionError):
        return 0
