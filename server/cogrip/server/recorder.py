"""Server core that records every input and everything that comes of it: live, in virtual time, under replay.

Records stand in the order in which things happened; a step stands after the datagrams that it sent. Steps of a deserted
room are counted and recorded as one input, `Idle`, before the next input: a daemon that waits writes nothing.
"""

import json
from collections.abc import Callable, Mapping, Sequence

import msgspec
import numpy as np

from cogrip.machine.tick_count import TickCount
from cogrip.protocol.axes import PLACES
from cogrip.protocol.recording.derived import derived_topics
from cogrip.protocol.recording.records import (
    Answer,
    Datagram,
    Event,
    Geoms,
    Ledger,
    Poses,
    Record,
    SeatStep,
    Sensors,
    Step,
)
from cogrip.protocol.recording.secrets import without_secrets
from cogrip.protocol.recording.sink import CoreRecorder, ObservedQueue, Sink, encode, topics
from cogrip.protocol.secure.channel import Address
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.wire.button_edges import edge_words
from cogrip.protocol.wire.messages import Hello
from cogrip.server.admission.admission import AdmissionServices, Authenticator, Denied, Grant
from cogrip.server.core import ServerCore
from cogrip.server.events import ServerEvent
from cogrip.server.inputs import CloseLedger, Idle, ServerInput
from cogrip.server.outputs import Outputs
from cogrip.server.room import Room
from cogrip.server.seats.observers import VIEWS_HZ

WHO = "server"
KINDS = ("datagram_in", "datagram_out", "input", "answer", "event", "account", "gap", "clock")
MOST_TEXTS = 4096
DATAGRAM_IN, DATAGRAM_OUT, INPUT, ANSWER, EVENT, ACCOUNT = range(6)


def server_topics(rooms: Sequence[str], scenes: Sequence[str] = (), measured: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the topics of a server's recording: its own, the steps of each room, the bodies of rooms with a scene, what its
    writer derives, and the sensors of scenes that have any."""
    steps = tuple(step_topic(room) for room in rooms)
    bodies = tuple(topic for room in scenes for topic in scene_topics(room))
    derived = tuple(topic for room in rooms for topic in derived_topics(room))
    return topics(WHO, KINDS) + steps + bodies + derived + tuple(map(sensor_topic, measured))


def step_topic(room: str) -> str:
    """Return the topic of a room's steps."""
    return f"/room/{room}/step"


def scene_topics(room: str) -> tuple[str, str]:
    """Return the topics of the shapes and of the poses of a room's scene."""
    return f"/room/{room}/geoms", f"/room/{room}/poses"


def sensor_topic(room: str) -> str:
    """Return the topic of the sensors of a room's scene."""
    return f"/room/{room}/sensors"


class RecordedServer(ServerCore):
    """`ServerCore` within its recorder. Tokens and tickets are not recorded (`cogrip.protocol.recording.secrets`).

    topics  of its recording
    timing  of each room, set by the driver before a step: lateness [us], work of the step before [us], skipped steps
    now_ns  time of the input that is being handled, given to all that comes of it
    """

    def __init__(self, rooms: Sequence[Settings], software: str, services: AdmissionServices) -> None:
        self._recorder, self.now_ns = CoreRecorder(), 0
        self._hash_ticket = services.hash_ticket
        self._sent = ObservedQueue(self._put_sent)
        outputs = Outputs(self._sent, ObservedQueue(self._put_event))
        super().__init__(rooms, software, self._recorded(services), outputs)
        digests = {room.name: digest for room in self.rooms if (digest := room.world.coordinates()[0])}
        self.start = start_text(rooms, software, digests)
        self.timing = {room.name: (0, 0, 0) for room in self.rooms}
        self._address_texts: dict[Address, str] = {}
        self._idle_steps: dict[str, int] = {}
        scenes = [room.name for room in self.rooms if room.world.drawing.shapes()]
        measured = [room.name for room in self.rooms if room.world.accounts.sensor_names()]
        self.topics = server_topics([room.name for room in self.rooms], scenes, measured)
        self._sensor_topic = {room: self.topics.index(sensor_topic(room)) for room in measured}
        self._named: set[str] = set()  # rooms whose sensors' names were recorded
        self._step_topic = {room.name: len(KINDS) + number for number, room in enumerate(self.rooms)}
        self._scene_topic = {room: self.topics.index(scene_topics(room)[0]) for room in scenes}
        self._drawn: dict[str, bytes] = {}  # offsets with which a room's shapes were recorded last
        self._stepped: Room | None = None  # whose last step is not recorded yet
        self._frames, self._timed = 1, (0, 0, 0)  # of that step
        for room in self.rooms:
            self.count_ticks(room, room.ticks)

    def record(self, sink: Sink, encode: Callable[[Record], bytes] = encode) -> None:
        """Write to `sink` what was held, and all that follows: see `CoreRecorder.record`."""
        self.finish_step()
        self._recorder.record(sink, encode)
        self._sent.observe = self._put_sent if self._recorder.keeps else None

    def put(self, topic: int, record: Record) -> None:
        """Write one record at `now_ns`."""
        self._recorder.put(topic, self.now_ns, record)

    def _recorded(self, services: AdmissionServices) -> AdmissionServices:
        """Return the same, with every answer recorded."""

        def new_session() -> int:
            session = services.new_session()
            self.put(ANSWER, Answer(session=session))
            return session

        def new_ticket() -> str:
            ticket = services.new_ticket()
            self.put(ANSWER, Answer(ticket=services.hash_ticket(ticket)))
            return ticket

        authenticator = RecordedAuthenticator(services.authenticator, self)
        return AdmissionServices(new_session, authenticator, new_ticket, services.hash_ticket)

    def count_ticks(self, room: Room, count: Callable[[], TickCount]) -> None:
        """Set the source of a room's tick count: the loop that steps it."""

        def recorded() -> TickCount:
            ticks = count()
            self.put(ANSWER, Answer(room.name, ticks=msgspec.json.encode(ticks).decode()))
            return ticks

        room.ticks = recorded

    def note_timing(self, room: Room, late_us: int, work_us: int, skipped: int) -> None:
        """Set `timing` of a room, where it is recorded."""
        if self._recorder.keeps:
            self.timing[room.name] = (late_us, work_us, skipped)

    def handle(self, given: ServerInput, now_ns: int) -> int:
        self._put_waiting()
        self.now_ns = now_ns
        self._recorder.put_input(INPUT, now_ns, given)
        result = super().handle(given, now_ns)
        if isinstance(given, CloseLedger):
            self._put_ledgers()
        return result

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> None:
        if self._idle_steps or self._stepped is not None:
            self._put_waiting()
        self.now_ns = now_ns
        if self._recorder.keeps:
            self.put(DATAGRAM_IN, Datagram(without_secrets(datagram, self._hash_ticket), self._text(address)))
        ServerCore.receive(self, datagram, address, now_ns)  # `super` costs as much as three calls

    def idle(self, room: Room, steps: int) -> None:
        self._idle_steps[room.name] = self._idle_steps.get(room.name, 0) + steps
        super().idle(room, steps)

    def tick(self, room: Room, now_ns: int, frames: int = 1) -> None:
        self.step(room, now_ns, frames)
        self.finish_step()

    def step(self, room: Room, now_ns: int, frames: int = 1) -> None:
        """Step a room as `tick` does, but for the record of the step: it waits for `finish_step`, or for what comes next.

        So the messages of the step can be sent first.
        """
        if self._stepped is not None:
            self.finish_step()
        if room.deserted:
            self.now_ns = now_ns
            self._idle_steps[room.name] = self._idle_steps.get(room.name, 0) + 1
            ServerCore.tick(self, room, now_ns, frames)
            return
        if self._idle_steps:
            self._put_idle()
        self.now_ns = now_ns
        ServerCore.tick(self, room, now_ns, frames)
        if self._recorder.keeps:
            self._stepped, self._frames, self._timed = room, frames, self.timing[room.name]

    def finish_step(self) -> None:
        """Record the last step, where it is not recorded yet."""
        room, self._stepped = self._stepped, None
        if room is None:
            return
        motion, axes = room.world_step.motion(), room.world.axes
        seats = tuple([_seat_step(room, number) for number in range(len(room.seats))])
        step = Step(room.steps, motion[:axes], motion[axes:], seats, self._frames, *self._timed)
        self.put(self._step_topic[room.name], step)
        for seat in room.seats:
            for edge in seat.port.handle.popped[0] if seat.port is not None else ():
                self.put(EVENT, Event(f"{room.name}: {seat.name} {edge_words(edge)}"))
        if room.steps % -(-room.settings.rates.network_hz // VIEWS_HZ) == 0:
            if room.name in self._scene_topic:
                self._put_bodies(room)
            if room.name in self._sensor_topic:
                self._put_sensors(room)

    def _put_bodies(self, room: Room) -> None:
        topic, world, drawing = self._scene_topic[room.name], room.world, room.world.drawing
        offset = world.offset[:, :PLACES].tobytes()
        if self._drawn.get(room.name) != offset:
            self._drawn[room.name] = offset
            places = np.zeros((len(world.offset), PLACES))
            places[:, : min(PLACES, world.axes)] = world.offset[:, :PLACES]
            left_out = tuple(drawing.left_out()) or msgspec.UNSET
            self.put(topic, Geoms(tuple(drawing.shapes()), tuple(places.ravel().tolist()), left_out))
        self.put(topic + 1, Poses(room.steps, tuple(drawing.poses().ravel().tolist())))

    def _put_sensors(self, room: Room) -> None:
        names = () if room.name in self._named else tuple(room.world.accounts.sensor_names())
        self._named.add(room.name)
        self.put(self._sensor_topic[room.name], Sensors(room.steps, names, room.world.accounts.sensors()))

    def _put_waiting(self) -> None:
        if self._stepped is not None:
            self.finish_step()
        self._put_idle()

    def _put_idle(self) -> None:
        for room, steps in self._idle_steps.items():
            self._recorder.put_input(INPUT, self.now_ns, Idle(room, steps))
        self._idle_steps.clear()

    def _put_sent(self, entry: tuple[Address, bytes]) -> None:
        self.put(DATAGRAM_OUT, Datagram(without_secrets(entry[1], self._hash_ticket), self._text(entry[0])))

    def _put_event(self, event: ServerEvent) -> None:
        self.put(EVENT, Event(event.text))

    def _put_ledgers(self) -> None:
        for room in self.rooms:
            numbers = range(len(room.seats))
            ledger = {
                "room": room.name, "account": room.account(), "seats": [room.seat_account(number) for number in numbers],
                "limited": [room.limited(number) for number in numbers], "dropped": self.dropped,
            }  # fmt: skip
            self.put(ACCOUNT, Ledger(msgspec.json.encode(ledger).decode()))

    def _text(self, address: Address) -> str:
        """Return `address_text`, of which there are few, and many datagrams."""
        text = self._address_texts.get(address)
        if text is None:
            if len(self._address_texts) >= MOST_TEXTS:
                self._address_texts.clear()
            text = self._address_texts[address] = address_text(address)
        return text


class RecordedAuthenticator:
    """`Authenticator` whose every answer is recorded."""

    def __init__(self, authenticator: Authenticator, recorder: RecordedServer) -> None:
        self._authenticator = authenticator
        self._recorder = recorder

    def admit(self, hello: Hello) -> Grant | Denied | None:
        answer = self._authenticator.admit(hello)
        self._recorder.put(ANSWER, Answer(grant=msgspec.json.encode(answer).decode()))
        return answer

    def shown(self, hello: Hello) -> str | None:
        answer = self._authenticator.shown(hello)
        self._recorder.put(ANSWER, Answer(shown=msgspec.json.encode(answer).decode()))
        return answer

    def admitted(self, grant: Grant) -> None:
        self._authenticator.admitted(grant)


def _seat_step(room: Room, number: int) -> SeatStep:
    seat, world = room.seats[number], room.world_step
    port = seat.port
    if port is None:
        nothing: tuple[float, ...] = (0.0,) * room.world.axes
        return SeatStep(seat.settings.user, False, nothing, nothing, None, None, None, None, 0)
    handle = port.handle
    return SeatStep(
        seat.settings.user, True, world.proxy_of(number), world.force_of(number),
        port.up_margin_j, seat.line_margin_j, port.used_j, port.made_j, port.lost,
        port.up_reserve.now_j, seat.line_reserve.now_j, *world.contact_of(number),
        handle.buttons, *handle.popped, handle.orientation, handle.grip_m,
    )  # fmt: skip


def address_text(address: Address) -> str:
    """Return an address, text or a tuple as sockets give them, as JSON text."""
    return msgspec.json.encode(address).decode()


def address_of(text: str) -> Address:
    """Return the address in JSON text. Raises ValueError (msgspec's)."""
    return msgspec.json.decode(text, type=str | tuple[str | int, ...])


def start_text(rooms: Sequence[Settings], software: str, scenes: Mapping[str, str] | None = None) -> str:
    """Return the arguments of a server core as JSON text. scenes: digest of each room's scene, where it has one."""
    table = {"rooms": msgspec.to_builtins(rooms), "software": software}
    return json.dumps(table | {"scenes": dict(scenes)} if scenes else table)


def start_of(text: str) -> tuple[list[Settings], str]:
    """Return rooms and software from `start_text`. Raises ValueError (msgspec's among them) or KeyError."""
    table = json.loads(text)
    return msgspec.convert(table["rooms"], list[Settings]), str(table["software"])


def scenes_of(text: str) -> dict[str, str]:
    """Return the digests of scenes from `start_text`, by room; none where no room has one."""
    return msgspec.convert(json.loads(text).get("scenes", {}), dict[str, str])
