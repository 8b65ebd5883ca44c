"""Messages that a recording's writer derives from others, for 3D panels: scene, transforms and forces of each room.

The server's recording alone has them, at 32 Hz or less. No core knows of them: replay, verification and tables leave them
out, and a recovery derives them anew. Shapes and poses of a scene are no such messages, as the writer has no world: they are
outputs of the server's core, as steps are, and a replay compares them; of them, too, pictures are derived.
"""

import json
from collections.abc import Iterator, Sequence
from math import isfinite, nan

import msgspec

from cogrip.machine.rows import Vector
from cogrip.protocol.recording.header import Header
from cogrip.protocol.recording.records import Geoms, Poses, Row, SeatStep, Step, kind_of
from cogrip.protocol.recording.scene_messages import (
    FRAME_TRANSFORMS,
    SCENE_UPDATE,
    Body,
    Place,
    Push,
    Quaternion,
    body_places,
    forces_update,
    frame_transforms,
    quaternion_of,
    scene_bodies,
    scene_update,
    soft_entities,
    soft_update,
)
from cogrip.protocol.session_drawing import HAND_SIZE_M, OBJECT_COLOUR, anchors_m, colour, object_size_m
from cogrip.protocol.settings.sections import Settings

DERIVED = {"scene": SCENE_UPDATE, "tf": FRAME_TRANSFORMS, "forces": SCENE_UPDATE}
"""Name of the schema, by the last part of the topic."""
MOST_HZ = 32
_SCENE_EVERY = MOST_HZ
"""Pictures from one whole scene to the next, so that a viewer that begins anywhere has it within a second."""
_step = msgspec.json.Decoder(Step).decode
_geoms = msgspec.json.Decoder(Geoms).decode
_poses = msgspec.json.Decoder(Poses).decode


def derived_topics(room: str) -> tuple[str, ...]:
    """Return the topics that are derived of a room's steps."""
    return tuple(f"/room/{room}/{kind}" for kind in DERIVED)


class RoomPictures:
    """Derives the messages of one room from its steps. Frames are `<room>`, `<room>/object`, `<room>/<person>/proxy`.

    Of a scene it draws the bodies, `<room>/body/<number>`, instead of the object.
    """

    def __init__(self, settings: Settings) -> None:
        self._room = settings.name
        self._kind = settings.object.kind
        self._anchors = anchors_m(self._kind, [user.side for user in settings.users])
        self._every = -(-settings.rates.network_hz // MOST_HZ)
        self._steps = self._pictures = 0
        self._seated: tuple[bool, ...] = ()
        self._offsets: dict[int, Row] = {}
        self._shown = Geoms((), ())
        self._poses = 0

    def messages(self, payload: bytes, time_ns: int) -> Iterator[tuple[str, bytes]]:
        """Yield kind and payload of what a step gives; time_ns: its log time."""
        number, self._steps = self._steps, self._steps + 1
        if number % self._every:
            return
        try:
            step = _step(payload)
        except msgspec.MsgspecError:  # of another version
            return
        people = list(zip(range(len(self._anchors)), step.seats, self._anchors, strict=False))
        object_m = _vector(step.object_m)
        for seat, person, _ in people:
            if person.seated:
                self._offsets.setdefault(seat, self._offset(seat, person, step))
            else:
                self._offsets.pop(seat, None)
        pushes = [
            (seat, person, _push(seat, person, anchor, self._offsets[seat]))
            for seat, person, anchor in people
            if person.seated
        ]
        if object_m is None or any(push is None for *_, push in pushes):
            return
        seated = tuple([person.seated for person in step.seats])
        if seated != self._seated or self._pictures % _SCENE_EVERY == 0:
            self._seated = seated
            yield "scene", scene_update(time_ns, self._bodies(step.seats))
        self._pictures += 1
        places = [Place(f"{self._room}/object", object_m)]
        places += [Place(self._frame(person), push.at_m, _turned(person)) for _, person, push in pushes if push]
        yield "tf", frame_transforms(time_ns, self._room, places)
        yield "forces", forces_update(time_ns, self._room, [push for *_, push in pushes if push])

    def bodies(self, kind: str, payload: bytes, time_ns: int) -> Iterator[tuple[str, bytes]]:
        """Yield kind and payload of what shapes or poses of a scene give."""
        if kind == "poses":
            self._poses += 1
            if self._poses % 2 == 0:  # they come at up to 2 MOST_HZ
                return
        try:
            if kind == "geoms":
                self._shown, self._seated, self._offsets = _geoms(payload), (), {}
                return
            poses = [nan if each is None else each for each in _poses(payload).poses]
        except msgspec.MsgspecError:  # of another version
            return
        rows = [poses[at : at + 7] for at in range(0, len(poses) - 6, 7)]
        yield "tf", frame_transforms(time_ns, self._room, body_places(self._room, self._shown.shapes, rows))
        if soft := soft_entities(time_ns, self._room, self._shown.shapes, rows):
            yield "forces", soft_update(soft)

    def _offset(self, seat: int, person: SeatStep, step: Step) -> Row:
        return self._shown.offsets_m[3 * seat : 3 * seat + 3] or offset_of(person, step)

    def _frame(self, person: SeatStep) -> str:
        return f"{self._room}/{person.user}/proxy"

    def _bodies(self, seats: Sequence[SeatStep]) -> list[Body]:
        size = (HAND_SIZE_M, HAND_SIZE_M, HAND_SIZE_M)
        held = {seat for seat, person in enumerate(seats) if person.seated}
        bodies = scene_bodies(self._room, self._shown.shapes, held)
        bodies = bodies or [Body(f"{self._room}/object", object_size_m(self._kind), OBJECT_COLOUR, box=True, alpha=0.6)]
        for seat, person in enumerate(seats):
            if person.seated:
                bodies.append(Body(self._frame(person), size, colour(seat), label=person.user))
        return bodies


class Pictures:
    """Derives the messages of all rooms of a recording; of one whose header has no derived topics there are none.

    topics  numbers of those that messages are derived of
    """

    def __init__(self, header: Header) -> None:
        numbers = {topic: number for number, topic in enumerate(header.topics)}
        self._rooms: dict[int, tuple[RoomPictures, dict[str, int]]] = {}
        self.topics = self._rooms.keys()
        self._kinds: dict[int, str] = {}  # of topics that are no steps
        if not any(kind_of(topic) in DERIVED for topic in header.topics):
            return
        try:
            rooms = msgspec.convert(json.loads(header.start)["rooms"], list[Settings])
        except (ValueError, KeyError, TypeError):  # it can be recorded all the same
            return
        for settings in rooms:
            places = {kind_of(topic): numbers[topic] for topic in derived_topics(settings.name) if topic in numbers}
            step = numbers.get(f"/room/{settings.name}/step")
            if step is not None and len(places) == len(DERIVED):
                room = RoomPictures(settings), places
                self._rooms[step] = room
                for kind in ("geoms", "poses"):
                    if (number := numbers.get(f"/room/{settings.name}/{kind}")) is not None:
                        self._rooms[number], self._kinds[number] = room, kind

    def of(self, topic: int, log_time_ns: int, payload: bytes) -> list[tuple[int, bytes]]:
        """Return the topic numbers and payloads of what this message gives."""
        found = self._rooms.get(topic)
        if found is None:
            return []
        room, places = found
        kind = self._kinds.get(topic)
        given = room.bodies(kind, payload, log_time_ns) if kind else room.messages(payload, log_time_ns)
        return [(places[kind], made) for kind, made in given]


def offset_of(person: SeatStep, step: Step) -> Row:
    """Return what lies between a person's own frame and the object's, in the first step with a seat: the proxy begins on the
    object, wherever the hand is (theory section 3.7)."""
    return tuple([(proxy or 0.0) - (place or 0.0) for proxy, place in zip(person.proxy_m, step.object_m, strict=False)])


def _push(seat: int, person: SeatStep, anchor: Vector, offset: Row) -> Push | None:
    proxy_m, force_n, away_m = _vector(person.proxy_m), _vector(person.force_n), _vector(offset)
    if proxy_m is None or force_n is None or away_m is None:
        return None
    x, y, z = (place + held - away for place, held, away in zip(proxy_m, anchor, away_m, strict=True))
    return Push((x, y, z), force_n, colour(seat))


def _turned(person: SeatStep) -> Quaternion:
    """Return the orientation of a person's handle; unturned where it is not known."""
    known = [each for each in person.orientation or () if each is not None]
    return quaternion_of(known) if len(known) == 4 else Quaternion()


def _vector(row: Row) -> Vector | None:
    """Return three numbers, 0 for an axis that is not there; None where one is not known."""
    values = [each for each in row if each is not None and isfinite(each)]
    if len(values) != len(row):
        return None
    x, y, z = (*values, 0.0, 0.0, 0.0)[:3]
    return x, y, z
