"""Does a recording play again exactly? Its inputs go into the same core, which notes everything as it did then; what it
notes now must be, message for message and byte for byte, what the file holds.

A tick's record holds the sample that the core was given and the force that it answered; the datagrams that came between
its two halves stand before it (`cogrip.client.recorded`).
"""

import json
import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import msgspec

from cogrip.client.recorded import RecordedClient, sample_of
from cogrip.client.recorded import start_of as client_start
from cogrip.protocol.accounts import ClientAccount, TickCount
from cogrip.protocol.recording.header import versions_here
from cogrip.protocol.recording.reader import Damage, Message, Recording, RecordingError
from cogrip.protocol.recording.records import Asked, Command, Datagram, Gap, Step, Tick, kind_of
from cogrip.server.recorded import RecordedServer
from cogrip.server.recorded import start_of as server_start

_tick = msgspec.json.Decoder(Tick).decode
_datagram = msgspec.json.Decoder(Datagram).decode
_command = msgspec.json.Decoder(Command).decode
_asked = msgspec.json.Decoder(Asked).decode
_step = msgspec.json.Decoder(Step).decode
_ticks = msgspec.json.Decoder(TickCount).decode


@dataclass(frozen=True, slots=True)
class Difference:
    """The first message that is not the same. Values are JSON text; "nothing" where one side has no such message."""

    time_ns: int
    topic: str
    field: str
    recorded: str
    replayed: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """How one file played.

    messages, ticks  compared and equal; ticks of a client, steps of a server
    versions         what differs between the machine that recorded and this one
    hole             inputs that are missing: nothing after them can be compared
    cut              the file was not closed; what is there was compared
    """

    who: str
    messages: int
    ticks: int
    seconds: float
    difference: Difference | None
    versions: tuple[str, ...]
    hole: Damage | Gap | None
    cut: bool

    @property
    def exact(self) -> bool:
        return self.difference is None and self.hole is None


class _End(Exception):
    """Nothing after this can be compared."""


class _Comparison:
    """A `Sink` that holds what is noted now against what was recorded."""

    def __init__(self, topics: tuple[str, ...]) -> None:
        self.topics = topics
        self._recorded: deque[Message] = deque()
        self._replayed: deque[Message] = deque()
        self.equal = 0
        self.difference: Difference | None = None

    def expect(self, message: Message) -> None:
        if self._replayed:
            self._compare(message, self._replayed.popleft())
        else:
            self._recorded.append(message)

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        message = Message(topic, time_ns, payload)
        if self._recorded:
            self._compare(self._recorded.popleft(), message)
        else:
            self._replayed.append(message)

    def finish(self, whole: bool) -> None:
        """Whatever one side has and the other has not. Of a file that was cut the last outputs may be missing."""
        for message in self._recorded:
            self._differ(message, "", message.payload.decode(), "nothing")
        for message in self._replayed if whole else ():
            self._differ(message, "", "nothing", message.payload.decode())

    def _compare(self, recorded: Message, replayed: Message) -> None:
        if recorded == replayed:
            self.equal += 1
        elif recorded.topic != replayed.topic:
            there, here = self.topics[recorded.topic], self.topics[replayed.topic]
            self._differ(recorded, "", f"{there} {recorded.payload.decode()}", f"{here} {replayed.payload.decode()}")
        elif recorded.payload == replayed.payload:
            self._differ(recorded, "time_ns", str(recorded.time_ns), str(replayed.time_ns))
        else:
            self._differ(recorded, *_first_field(json.loads(recorded.payload), json.loads(replayed.payload)))

    def _differ(self, message: Message, where: str, recorded: str, replayed: str) -> None:
        if self.difference is None:
            self.difference = Difference(message.time_ns, self.topics[message.topic], where, recorded, replayed)


def _first_field(recorded: Any, replayed: Any, where: str = "") -> tuple[str, str, str]:
    """(path, value there, value here) of the first difference between two JSON values."""
    if isinstance(recorded, dict) and isinstance(replayed, dict):
        for key in [*recorded, *(key for key in replayed if key not in recorded)]:
            if recorded.get(key) != replayed.get(key) or (key in recorded) != (key in replayed):
                return _first_field(recorded.get(key), replayed.get(key), f"{where}.{key}" if where else key)
    if isinstance(recorded, list) and isinstance(replayed, list) and len(recorded) == len(replayed):
        for number, (one, other) in enumerate(zip(recorded, replayed, strict=True)):
            if one != other or math.copysign(1.0, _sign(one)) != math.copysign(1.0, _sign(other)):
                return _first_field(one, other, f"{where}[{number}]")
    return where, json.dumps(recorded), json.dumps(replayed)


def _sign(value: Any) -> float:
    return value if isinstance(value, float) else 1.0


class _Tape:
    """The messages of a file with a view ahead; the recorder's own are taken out."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._messages = self._read()
        self._ahead: deque[Message] = deque()
        self._answers: deque[Asked] = deque()
        self.kinds = [kind_of(topic) for topic in recording.topics]
        self.hole: Damage | Gap | None = None
        self.first_ns: int | None = None
        self.last_ns = 0

    def _read(self) -> Iterator[Message]:
        for chunk in self._recording.chunks():
            if self._recording.damage:  # between the chunk before and this one something is missing
                self.hole = self._recording.damage[0]
                return
            for message in chunk:
                kind = self.kinds[message.topic]
                if kind == "gap":
                    self.hole = msgspec.json.decode(message.payload, type=Gap)
                    return
                if kind != "clock":
                    yield message

    def __iter__(self) -> Iterator[Message]:
        while True:
            if not self._ahead:
                following = next(self._messages, None)
                if following is None:
                    return
                self._take(following)
            message = self._ahead.popleft()
            if self.first_ns is None:
                self.first_ns = message.time_ns
            self.last_ns = message.time_ns
            yield message

    def asked(self, wanted: str) -> Asked:
        """What the core was told when it asked: the next such answer. Raises _End if the file holds none."""
        while not self._answers:
            following = next(self._messages, None)
            if following is None:
                raise _End(wanted)
            self._take(following)
        return self._answers.popleft()

    def _take(self, message: Message) -> None:
        self._ahead.append(message)
        if self.kinds[message.topic] == "asked":
            self._answers.append(_asked(message.payload))


def verify(recording: Recording) -> Verdict:
    """Play a recording through a new core. Raises RecordingError for one that says no start, or none that fits."""
    header = recording.header
    play = {"client": _play_client, "server": _play_server}.get(header.role)
    if play is None:
        raise RecordingError(f"{recording.path} is of a {header.role!r}; only clients and servers can be replayed")
    tape, comparison = _Tape(recording), _Comparison(recording.topics)
    ticks = 0
    try:
        for ticks in play(header.start, tape, comparison):
            if comparison.difference is not None:
                break
        else:
            comparison.finish(recording.complete and tape.hole is None)
    except _End:
        comparison.finish(False)
    except (KeyError, ValueError, TypeError) as error:
        raise RecordingError(f"{recording.path} cannot be replayed: {error!r}") from error
    damage = recording.damage
    cut = not recording.complete
    hole = tape.hole
    if hole is None and damage and damage[-1].to_ns is not None:
        hole = damage[0]
    seconds = 0.0 if tape.first_ns is None else (tape.last_ns - tape.first_ns) * 1e-9
    versions = tuple(header.versions.differences(versions_here()))
    return Verdict(header.who, comparison.equal, ticks, seconds, comparison.difference, versions, hole, cut)


def _play_client(start: str, tape: _Tape, comparison: _Comparison) -> Iterator[int]:
    """The number of ticks played, after each message."""
    hello, capability = client_start(start)
    core = RecordedClient(hello, capability)
    core.record(comparison)
    waiting: list[tuple[bytes, int]] = []  # datagrams that came since the last call
    account: ClientAccount | None = None
    ticks = 0

    def hear() -> None:
        for datagram, now_ns in waiting:
            core.receive(datagram, now_ns)
        waiting.clear()

    for message in tape:
        comparison.expect(message)
        kind, now_ns = tape.kinds[message.topic], message.time_ns
        if kind == "tick":
            tick = _tick(message.payload)
            core.sense(tick.tick, sample_of(tick, capability.gives_velocity), now_ns)
            hear()
            core.timing = (tick.late_us, tick.work_us, tick.skipped)
            core.act(now_ns)
            ticks += 1
        elif kind == "datagram_in":
            waiting.append((_datagram(message.payload).data, now_ns))
            if not core.seated:  # nothing ticks yet
                hear()
        elif kind == "command":
            hear()
            command = _command(message.payload)
            if command.verb == "account":
                account = core.account(_ticks(command.ticks))
            elif command.verb == "leave":
                assert account is not None
                core.leave(command.reason, account, now_ns)
            elif command.verb == "fail":
                core.fail(command.reason)
            elif command.verb in ("stop", "rearm"):
                getattr(core, command.verb)()
            elif command.verb in ("call", "poll", "keep_seat"):
                getattr(core, command.verb)(now_ns)
            else:
                raise ValueError(f"no command {command.verb!r} is known")
        yield ticks
    hear()
    yield ticks


def _play_server(start: str, tape: _Tape, comparison: _Comparison) -> Iterator[int]:
    """The number of steps played, after each message."""
    rooms, software = server_start(start)
    core = RecordedServer(rooms, software, lambda: tape.asked("session").session)
    for room in core.rooms:
        core.count_ticks(room, lambda: _ticks(tape.asked("ticks").ticks))
    core.record(comparison)
    by_topic = {f"/room/{room.name}/step": room for room in core.rooms}
    topics = comparison.topics
    steps = 0
    for message in tape:
        comparison.expect(message)
        kind, now_ns = tape.kinds[message.topic], message.time_ns
        if kind == "step":
            step = _step(message.payload)
            room = by_topic[topics[message.topic]]
            core.timing[room.name] = (step.late_us, step.work_us, step.skipped)
            core.tick(room, now_ns, step.frames)
            steps += 1
        elif kind == "datagram_in":
            datagram = _datagram(message.payload)
            core.receive(datagram.data, datagram.address, now_ns)
        elif kind == "command":
            command = _command(message.payload)
            if command.verb == "stop":
                core.stop(command.reason)
            elif command.verb == "close_books":
                core.close_books()
            else:
                raise ValueError(f"no command {command.verb!r} is known")
        yield steps
