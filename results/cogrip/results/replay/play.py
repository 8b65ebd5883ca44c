"""Recorded inputs into new cores. A play takes every message of its recording in turn and does what it tells.

A tick's record holds the sample that the core was given and stands where its force was known, so the datagrams that came
between the two halves of the tick stand before it (`cogrip.client.recorder`): they wait until it is clear whose they are.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Literal, Protocol

import msgspec

from cogrip.client.inputs import decode as decode_client_input
from cogrip.client.recorder import RecordedClient
from cogrip.client.recorder import start_of as client_start
from cogrip.client.tick_record import sample_of
from cogrip.machine.tick_count import TickCount
from cogrip.protocol.recording.reader import RecordedMessage
from cogrip.protocol.recording.records import Datagram, Input, Step, Tick
from cogrip.protocol.recording.sink import Sink
from cogrip.protocol.wire.messages import Hello
from cogrip.results.replay.replay_input import ReplayInput, UntoldError
from cogrip.server.admission.admission import AdmissionServices, Denied, Grant
from cogrip.server.checkpoint import CheckpointError
from cogrip.server.inputs import Idle
from cogrip.server.inputs import decode as decode_server_input
from cogrip.server.recorder import RecordedServer, address_of, scenes_of, step_topic
from cogrip.server.recorder import start_of as server_start

_tick = msgspec.json.Decoder(Tick).decode
_datagram = msgspec.json.Decoder(Datagram).decode
_input = msgspec.json.Decoder(Input).decode
_step = msgspec.json.Decoder(Step).decode
_granted = msgspec.json.Decoder(Grant | Denied | None).decode
_shown = msgspec.json.Decoder(str | None).decode
_ticks = msgspec.json.Decoder(TickCount).decode


class Play(Protocol):
    """`ticks`: of a client, or steps of a server, played so far."""

    ticks: int

    def take(self, message: RecordedMessage) -> None:
        """Do what an input tells; let an output pass. Raises ValueError for what is not known."""
        ...

    def finish(self) -> None:
        """There are no more messages."""
        ...


class ClientPlay:
    """One person's core."""

    def __init__(self, replay_input: ReplayInput, sink: Sink) -> None:
        hello, capability = client_start(replay_input.recording.header.start)
        self.core = RecordedClient(hello, capability)
        self.core.record(sink)
        self.ticks = 0
        self._kinds = replay_input.kinds
        self._waiting: list[tuple[bytes, int]] = []

    def take(self, message: RecordedMessage) -> None:
        self.core.outbox.clear()  # recorded; nobody is there to receive it
        kind, now_ns = self._kinds[message.topic], message.time_ns
        if kind == "tick":
            self._tick(_tick(message.payload), now_ns)
        elif kind == "datagram_in":
            self._waiting.append((_datagram(message.payload).data, now_ns))
            if not self.core.seated:  # nothing ticks yet
                self._receive_waiting()
        elif kind == "input":
            self._receive_waiting()
            self.core.handle(decode_client_input(_input(message.payload).value), now_ns)

    def finish(self) -> None:
        self._receive_waiting()

    def _receive_waiting(self) -> None:
        for datagram, now_ns in self._waiting:
            self.core.receive(datagram, now_ns)
        self._waiting.clear()

    def _tick(self, tick: Tick, now_ns: int) -> None:
        core = self.core
        if not core.seated:
            raise ValueError(f"tick {tick.tick} stands before a seat was had")
        core.sense(tick.tick, sample_of(tick, core.capability.gives_velocity), now_ns)
        self._receive_waiting()
        core.timing = (tick.late_us, tick.work_us, tick.skipped)
        core.act(now_ns)
        self.ticks += 1


class ServerPlay:
    """A server's core with all its rooms."""

    def __init__(self, replay_input: ReplayInput, sink: Sink) -> None:
        rooms, software = server_start(replay_input.recording.header.start)
        services = AdmissionServices(
            lambda: _told(replay_input, "session"),
            ReplayedAuthenticator(replay_input),
            lambda: _told(replay_input, "ticket"),
        )
        self.core = RecordedServer(rooms, software, services)
        self._refuse_other_scenes(scenes_of(replay_input.recording.header.start))
        for room in self.core.rooms:
            self.core.count_ticks(room, lambda: _ticks(_told(replay_input, "ticks")))
        self.core.record(sink)
        self.ticks = 0
        self._kinds = replay_input.kinds
        topics = {step_topic(room.name): room for room in self.core.rooms}
        self._rooms = [topics.get(topic) for topic in replay_input.recording.topics]

    def take(self, message: RecordedMessage) -> None:
        kind, now_ns, core = self._kinds[message.topic], message.time_ns, self.core
        core.outbox.clear()  # recorded; nobody is there to receive it
        core.events.clear()
        if kind == "step":
            room, step = self._rooms[message.topic], _step(message.payload)
            if room is None:
                raise ValueError("a step of a room that the recording's settings do not have")
            core.timing[room.name] = (step.late_us, step.work_us, step.skipped)
            core.tick(room, now_ns, step.frames)
            self.ticks += 1
        elif kind == "datagram_in":
            datagram = _datagram(message.payload)
            core.receive(datagram.data, address_of(datagram.address), now_ns)
        elif kind == "input":
            given = decode_server_input(_input(message.payload).value)
            if isinstance(given, Idle):
                self.ticks += given.steps
            with suppress(CheckpointError):  # refused then, too: the server began without it
                core.handle(given, now_ns)

    def _refuse_other_scenes(self, recorded: Mapping[str, str]) -> None:
        """Raise ValueError where a file is not the one that was recorded."""
        for room in self.core.rooms:
            was, now = recorded.get(room.name), room.world.coordinates()[0]
            if was is not None and was != now:
                file = room.settings.object.file
                raise ValueError(f"{file} is another scene ({now}) than the recorded one ({was}); put that file back")

    def finish(self) -> None:
        """Nothing is left to do."""


class ReplayedAuthenticator:
    """`Authenticator` that gives the recorded answers."""

    def __init__(self, replay_input: ReplayInput) -> None:
        self._replay_input = replay_input

    def admit(self, hello: Hello) -> Grant | Denied | None:
        granted: Grant | Denied | None = _granted(_told(self._replay_input, "grant"))
        return granted

    def shown(self, hello: Hello) -> str | None:
        shown: str | None = _shown(_told(self._replay_input, "shown"))
        return shown

    def admitted(self, grant: Grant) -> None:
        """Nothing is used up."""


PLAYS: dict[str, Callable[[ReplayInput, Sink], Play]] = {"client": ClientPlay, "server": ServerPlay}
"""Play by the role in a recording's header."""


def _told(replay_input: ReplayInput, query: Literal["session", "ticket", "grant", "shown", "ticks"]) -> Any:
    """Return the next answer. Raises UntoldError where it answers another query: one is missing before it."""
    answer = replay_input.answer()
    answered = next(
        (name for name in ("session", "grant", "shown", "ticks") if getattr(answer, name)), "ticket"
    )  # "" where none is given
    if answered != query:
        raise UntoldError
    return getattr(answer, query)
