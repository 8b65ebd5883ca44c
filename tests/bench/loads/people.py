"""Many light people for one server: a socket and a session each, then a datagram of waves a frame. No device, no force.

What they send is whole and passive: it agrees with the server's energy ledger of a line. What they are sent is counted, and
decoded now and then.
"""

import math
import socket
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import NamedTuple

from cogrip.machine.pacing import Pacer
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.secure.channel import PEER, Channel
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.messages import DTLS_BYTES, Hello, Stamp, Waves, encode
from cogrip.protocol.wire.session import ClientSession, make_hello

SLOTS = 4  # people are not in step: a quarter of them sends in each quarter of a frame
LOOK_EVERY = 32  # datagrams of which one is looked into
AT_ONCE = 8  # who is let in at a time
JOIN_LIMIT_NS = 60_000_000_000
POLL_S = 0.005
SWING_SQRTW, SWING_HZ, SWING_M = 0.05, 1.0, 0.005
PEAK_N, SPEED_MPS = 10.0, 2.0  # of the device that they claim
MOST_BYTES = 2048


class LoadError(Exception):
    """Somebody did not get, or keep, a seat. The text says who and why."""


class Tally(NamedTuple):
    """Datagrams of all people since they began to hold, and frames that were left out because this end was late."""

    sent: int
    received: int
    left_out: int


class Swing:
    """The line of a hand that swings to and fro, as it stands after its newest frame; many can send the same."""

    def __init__(self, seat: SeatSettings, phase: float) -> None:
        axes, rates = seat.object.axes, seat.rates
        self._sender = LineSender(axes, seat.playout.redundancy)
        self._axes = axes
        self._half_frame_s = 0.5 * rates.frame_s
        self._phase = phase
        self._step = 2.0 * math.pi * SWING_HZ * rates.frame_s
        self.frames = 0
        self.made_j = 0.0
        self.origin_m = self._place()
        self.position_m = self.origin_m
        self.first = 0
        self.waves = self.total = self.squares = (0.0,) * axes

    def _place(self) -> tuple[float, ...]:
        return tuple([-SWING_M * math.cos(self._phase + self.frames * self._step + axis) for axis in range(self._axes)])

    def step(self) -> None:
        """One frame more."""
        angle = self._phase + self.frames * self._step
        wave = tuple([SWING_SQRTW * math.sin(angle + axis) for axis in range(self._axes)])
        self._sender.push(wave)
        self.frames += 1
        self.made_j += sum([value * value for value in wave]) * self._half_frame_s
        self.position_m = self._place()
        self.first, self.waves, self.total, self.squares = self._sender.contents()

    def message(self, session: int, acknowledged: int, stamp: Stamp) -> bytes:
        return encode(Waves(
            session, self.first, self.waves, self.total, self.squares, self.made_j, self.made_j, acknowledged, stamp,
            self.origin_m + self.position_m,
        ))  # fmt: skip


class Person:
    """One of many. `tend` before and after holding; while holding `say` and `hear`, once a frame."""

    def __init__(self, name: str, hello: Hello, server: tuple[str, int], channel: Channel, source: str = "") -> None:
        """source: an address of this machine to come from, "" any."""
        self.name = name
        self.channel = channel
        self.session = ClientSession(hello)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        if source:
            self.socket.bind((source, 0))
        self.socket.connect(server)
        self.socket.setblocking(False)
        self.number = 0  # of the session
        self.sent = self.received = 0
        self._acknowledged = 0
        self.last = b""  # datagram that was sent

    @property
    def state(self) -> str:
        return self.session.state

    @property
    def failed(self) -> str:
        return self.channel.failed or self.session.failed

    def tend(self, now_ns: int) -> None:
        """Come in, keep the seat, or leave it."""
        session, channel = self.session, self.channel
        channel.poll(now_ns)
        if session.state == "idle" and channel.ready(PEER):
            session.connect(now_ns)
        session.poll(now_ns)
        session.heartbeat(now_ns)
        while session.outbox:
            channel.send(session.outbox.popleft(), PEER)
        self.put()
        while (datagram := self._receive()) is not None:
            for message in channel.receive(datagram, PEER, now_ns):
                session.receive(message, now_ns)
        if session.welcome is not None:
            self.number = session.welcome.session

    def say(self, line: Swing, now_ns: int) -> None:
        """The newest frames of this line."""
        message = line.message(self.number, self._acknowledged, self.session.clock.stamp(now_ns))
        self.channel.send(message, PEER)
        self.put()
        self.sent += 1

    def hear(self, now_ns: int) -> None:
        """Receive what has come; decode one datagram of many."""
        datagram = self._receive()
        if datagram is None:
            return
        self.received += 1
        if self.received % LOOK_EVERY:
            return
        while datagram is not None:
            for message in self.channel.receive(datagram, PEER, now_ns):
                heard = self.session.receive(message, now_ns)
                if isinstance(heard, Waves):
                    self.session.clock.read(heard.stamp, now_ns)
                    self._acknowledged = heard.first + len(heard.waves) // len(heard.total)
            datagram = self._receive()
            self.received += datagram is not None

    def put(self) -> None:
        """Send what the channel has in its outbox."""
        outbox = self.channel.outbox
        while outbox:
            self.last = outbox.popleft()[1]
            with suppress(OSError):  # where the server is not there, it is missed by other signs
                self.socket.send(self.last)

    def _receive(self) -> bytes | None:
        try:
            return self.socket.recv(MOST_BYTES)
        except OSError:
            return None

    def leave(self, now_ns: int) -> None:
        self.session.leave("the bench is over", None, now_ns)

    def close(self) -> None:
        self.channel.close(PEER)
        self.put()
        self.socket.close()


class Echoed(Person):
    """Sends datagrams of the same size to somebody who sends them back: there is no session."""

    padding = bytes(DTLS_BYTES)
    number = 2**62  # as long as a session's

    @property
    def state(self) -> str:
        return "seated" if self.socket.fileno() >= 0 else "closed"

    def tend(self, now_ns: int) -> None:
        """Nobody has to be asked."""

    def say(self, line: Swing, now_ns: int) -> None:
        with suppress(OSError):
            self.socket.send(line.message(self.number, line.frames, Stamp(now_ns, now_ns, now_ns)) + self.padding)
        self.sent += 1

    def hear(self, now_ns: int) -> None:
        datagram = self._receive()
        self.received += datagram is not None
        if self.received % LOOK_EVERY == 0:
            while datagram is not None:
                datagram = self._receive()
                self.received += datagram is not None

    def leave(self, now_ns: int) -> None:
        """There is no place to be left."""


class Load:
    """Some people of one server, driven by one thread. `join`, then `run` as often as is wanted, then `leave`."""

    def __init__(self, people: Sequence[Person], seat: SeatSettings) -> None:
        """seat: one like that of all of them."""
        self.people = people
        self.pacer: Pacer | None = None
        self._seat = seat
        self._lines: list[Swing] = []
        self._left_out = 0

    def join(self) -> None:
        """Let everyone in, some at a time. Raises LoadError."""
        waiting, begun = deque(self.people), list[Person]()
        limit_ns = time.monotonic_ns() + JOIN_LIMIT_NS
        while waiting or any(person.state != "seated" for person in begun):
            now_ns = time.monotonic_ns()
            outside = sum(person.state != "seated" for person in begun)
            while waiting and outside < AT_ONCE:
                begun.append(waiting.popleft())
                outside += 1
            for person in begun:
                person.tend(now_ns)
                if person.failed or now_ns >= limit_ns:
                    raise LoadError(f"{person.name} got no seat: {person.failed or 'it took too long'}")
            time.sleep(POLL_S)
        self._begin()

    def _begin(self) -> None:
        """All lines begin with this frame."""
        seat = self._seat
        self._lines = [Swing(seat, phase=0.5 * math.pi * slot) for slot in range(SLOTS)]
        self.pacer = Pacer(seat.rates.network_hz * SLOTS, time.monotonic_ns() + 2_000_000)

    def run(self, seconds: float, each_frame: Callable[[int], None] | None = None) -> None:
        """Hold for so long. each_frame: called once a frame with the time [ns]."""
        pacer, people, lines = self.pacer, self.people, self._lines
        assert pacer is not None
        groups = [people[slot::SLOTS] for slot in range(SLOTS)]
        end_ns = time.monotonic_ns() + round(seconds * 1e9)
        while (now_ns := time.monotonic_ns()) < end_ns:
            skipped = pacer.skipped
            frame, slot = divmod(pacer.wait(), SLOTS)
            now_ns = time.monotonic_ns()
            if pacer.skipped > skipped:
                self._left_out += (pacer.skipped - skipped) * len(people) // SLOTS
            line = lines[slot]
            while line.frames <= frame:
                line.step()
            for person in groups[slot]:
                person.say(line, now_ns)
                person.hear(now_ns)
            if each_frame is not None and not slot:
                each_frame(now_ns)
            pacer.done()

    def tally(self) -> Tally:
        return Tally(
            sum(person.sent for person in self.people), sum(person.received for person in self.people), self._left_out
        )

    def tend(self, seconds: float) -> None:
        """Keep the seats without waves."""
        end_ns = time.monotonic_ns() + round(seconds * 1e9)
        while (now_ns := time.monotonic_ns()) < end_ns:
            for person in self.people:
                person.tend(now_ns)
            time.sleep(POLL_S)

    def leave(self) -> None:
        """Say goodbye and close."""
        now_ns = time.monotonic_ns()
        for person in self.people:
            person.leave(now_ns)
        while any(person.state == "leaving" for person in self.people):  # a session gives up by itself
            now_ns = time.monotonic_ns()
            for person in self.people:
                person.tend(now_ns)
            time.sleep(POLL_S)
        self.close()

    def close(self) -> None:
        for person in self.people:
            person.close()


def make_people(
    count: int,
    per_room: int,
    servers: Sequence[tuple[str, int]],
    make_channel: Callable[[], Channel],
    token: str = "",
    kind: type[Person] = Person,
) -> list[Person]:
    """People of rooms that are called as `room_name` says, `per_room` in each.

    servers: addresses, one for all rooms or one each
    """
    people = []
    for number in range(count):
        hello = make_hello(
            software="bench", nonce=number + 1, room=room_name(number // per_room), name="", digest="", device="sim:light",
            axes=3, rate_hz=8192.0, force_n=PEAK_N, speed_mps=SPEED_MPS, token=token,
        )  # fmt: skip
        server = servers[number // per_room % len(servers)]
        people.append(kind(f"person {number + 1}", hello, server, make_channel(), source(number)))
    return people


def room_name(number: int) -> str:
    return f"room {number + 1}"


def source(number: int) -> str:
    """An address of its own for each person: budgets go by address. Elsewhere than on Linux loopback has only one."""
    return f"127.0.{2 + number // 250}.{1 + number % 250}" if sys.platform.startswith("linux") else ""
