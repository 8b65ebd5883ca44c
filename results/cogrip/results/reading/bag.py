"""A run as a bag of ROS 2 (rosbag2): messages of `geometry_msgs`, `sensor_msgs` and `std_msgs` in CDR, under CRTK names.

    NAME/measured_cp, measured_cv, measured_cf      each tick of a client: hand, velocity, force of its device (-F)
    NAME/gripper/measured_js                        of a device with a gripper: its opening, and its rate and force
    NAME/state                                      state of a client's safety, where it changes
    object/measured_cp, measured_cv                 each step of the server: the object
    NAME/proxy/measured_cp, measured_cf             the person's proxy at the object, and the force of its spring on the object
    bodies/measured_cp                              of a scene: a pose for each body, in the order of the recording
    events                                          everything that the server told, markers too

Storage is MCAP, the one that `ros2 bag` of Jazzy takes where nothing is said, and metadata.yaml of version 9, as there.
A stamp is the time of the message in the recording, to the nanosecond, on the server's clock.
"""

import heapq
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from math import cos, hypot, nan, sin
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cogrip.protocol.axes import GRIP_AXES, PLACES, POSE_AXES
from cogrip.protocol.recording.records import Event, Number, Poses, Row, Step, Tick, kind_of
from cogrip.results.reading.export import Exported, ExportError
from cogrip.results.reading.records import End, RunRecords, decoder
from cogrip.server.recorder import step_topic

NAME = "rosbag2"  # name of the bag's folder, and of the file in it
FRAME = "cogrip"  # frame of the object; a hand is in its own, as in the recordings
VERSION = 9  # version of the metadata
POSE = "geometry_msgs/msg/PoseStamped"
TWIST = "geometry_msgs/msg/TwistStamped"
WRENCH = "geometry_msgs/msg/WrenchStamped"
POSES = "geometry_msgs/msg/PoseArray"
JOINT = "sensor_msgs/msg/JointState"
TEXT = "std_msgs/msg/String"
_POSE_NUMBERS = 7  # numbers of a body's pose: place and quaternion w, x, y, z
_FACED = (1.0, 0.0, 0.0, 0.0)


class Message(NamedTuple):
    """A message before it is encoded; make: what builds it of the types."""

    time_ns: int
    topic: str
    kind: str
    make: Callable[["Types"], Any]


class Types:
    """Messages of ROS 2 by their definitions in `rosbags`."""

    def __init__(self, store: Any) -> None:
        self._of: Any = store.types

    def header(self, time_ns: int, frame: str) -> Any:
        sec, nanosec = divmod(time_ns, 10**9)
        return self._of["std_msgs/msg/Header"](self._of["builtin_interfaces/msg/Time"](sec, nanosec), frame)

    def vector(self, values: Sequence[float], kind: str = "Vector3") -> Any:
        return self._of[f"geometry_msgs/msg/{kind}"](*values)

    def pose(self, place: Sequence[float], turned: Sequence[float]) -> Any:
        w, x, y, z = turned
        quaternion = self._of["geometry_msgs/msg/Quaternion"](x, y, z, w)
        return self._of["geometry_msgs/msg/Pose"](self.vector(place, "Point"), quaternion)

    def make(self, kind: str, *parts: Any) -> Any:
        return self._of[kind](*parts)


def export_bag(run: RunRecords, out: Path) -> list[Exported]:
    """Write a run into the folder `rosbag2` below `out`.

    Raises ExportError, before anything is written, where `rosbags` is missing or something is in the way, and OSError where it
    cannot be written; what it had begun is then removed.
    """
    rosbag2, typesys = _rosbags()
    folder = out / NAME
    if folder.exists():
        raise ExportError(f"{folder} exists, and nothing is overwritten; remove it, or name another folder")
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    types, connections, rows = Types(store), dict[str, Any](), 0
    try:
        with rosbag2.Writer(folder, version=VERSION, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
            for message in _messages(run):
                if message.topic not in connections:
                    connections[message.topic] = writer.add_connection(message.topic, message.kind, typestore=store)
                encoded = store.serialize_cdr(message.make(types), message.kind)
                writer.write(connections[message.topic], message.time_ns, encoded)
                rows += 1
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    if not rows:
        shutil.rmtree(folder)
        raise ExportError(f"{run.folder} has no tick and no step: there is nothing to put in a bag")
    return [Exported(folder, rows)]


def _rosbags() -> tuple[Any, Any]:
    """Return the packages of rosbags that write. Raises ExportError where they are not installed."""
    try:
        from rosbags import rosbag2, typesys
    except ImportError:
        raise ExportError(
            "--to rosbag2 needs rosbags, which is not installed: pip install 'cogrip[rosbag2]', or export --to csv"
        ) from None
    return rosbag2, typesys


def _messages(run: RunRecords) -> Iterator[Message]:
    """Yield the messages of all ends, oldest first."""
    ends = [*run.clients.values(), *([run.server] if run.server else [])]
    first = run.server or ends[0]
    origin_ns = first.recording.header.epoch_ns - round(first.offset_s * 1e9)
    places = namespaces(run.names())
    streams = []
    for end in ends:
        shift_ns = origin_ns + round(end.offset_s * 1e9)
        if end.recording.header.role == "server":
            streams.append(_of_server(end, run.room(), shift_ns, places))
        else:
            streams.append(_of_client(end, shift_ns, places[end.who]))
    return heapq.merge(*streams, key=lambda message: message.time_ns)


def namespaces(names: Iterable[str]) -> dict[str, str]:
    """Return the namespace of each person, by name: letters of ASCII, digits and single underscores; no two have the same."""
    found: dict[str, str] = {}
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_") or "person"
        plain = f"p{plain}" if plain[0].isdigit() else plain
        taken, place, number = {*found.values(), "object", "bodies", "events"}, plain, 1
        while place in taken:
            number += 1
            place = f"{plain}_{number}"
        found[name] = place
    return found


def _decoded(end: End, wanted: dict[int, Any], shift_ns: int) -> Iterator[tuple[int, Any]]:
    """Yield stamp and record of the messages of some topics, in the order of the file; decoders by number of the topic."""
    for chunk in end.recording.chunks():
        for message in chunk:
            decode = wanted.get(message.topic)
            if decode is not None:
                yield max(0, message.time_ns + shift_ns), decode(message.payload)


def _topics(end: End, names: Sequence[str]) -> dict[int, Any]:
    return {
        number: decoder(kind_of(topic)) for number, topic in enumerate(end.recording.topics) if topic in names
    }  # fmt: skip


def _of_client(end: End, shift_ns: int, place: str) -> Iterator[Message]:
    state = ""
    for time_ns, tick in _decoded(end, _topics(end, [f"/{end.who}/tick"]), shift_ns):
        assert isinstance(tick, Tick)
        if tick.position_m is not None:
            yield _pose(time_ns, f"/{place}/measured_cp", place, tick.position_m, tick.orientation)
        yield _twist(time_ns, f"/{place}/measured_cv", place, tick.velocity_mps)
        yield _wrench(time_ns, f"/{place}/measured_cf", place, tick.force_n, -1.0)
        if len(tick.force_n) == GRIP_AXES and tick.position_m is not None:
            rows = tick.position_m, tick.velocity_mps, tick.force_n
            opening, rate, force = (_number(row[PLACES]) for row in rows)
            yield _joint(time_ns, f"/{place}/gripper/measured_js", place, opening, rate, -force)
        if tick.state != state:
            state = tick.state
            yield _text(time_ns, f"/{place}/state", state)


def _of_server(end: End, room: str, shift_ns: int, places: dict[str, str]) -> Iterator[Message]:
    wanted = _topics(end, ["/server/event", step_topic(room), step_topic(room).removesuffix("step") + "poses"])
    for time_ns, record in _decoded(end, wanted, shift_ns):
        if isinstance(record, Event):
            yield _text(time_ns, "/events", record.text)
        elif isinstance(record, Poses):
            yield _poses(time_ns, "/bodies/measured_cp", record.poses)
        elif isinstance(record, Step):
            yield _pose(time_ns, "/object/measured_cp", FRAME, record.object_m, None)
            yield _twist(time_ns, "/object/measured_cv", FRAME, record.object_mps)
            for seat in record.seats:
                if seat.seated:
                    place = f"/{places[seat.user]}/proxy"
                    yield _pose(time_ns, f"{place}/measured_cp", FRAME, seat.proxy_m, seat.orientation)
                    yield _wrench(time_ns, f"{place}/measured_cf", FRAME, seat.force_n, 1.0)


def _number(value: Number) -> float:
    return nan if value is None else value


def _three(row: Row, sign: float = 1.0) -> list[float]:
    """Return the places of a row, 0 for axes that there are not."""
    return [sign * _number(value) for value in row[:PLACES]] + [0.0] * (PLACES - len(row))


def _turning(row: Row, sign: float = 1.0) -> list[float]:
    """Return the axes of a row that turn, 0 where there are none."""
    return [sign * _number(value) for value in row[PLACES:]] if len(row) == POSE_AXES else [0.0] * PLACES


def _quaternion(row: Row, orientation: Row | None) -> Sequence[float]:
    """Return the orientation of a hand as w, x, y, z: what its handle says, or its rotation vector; else none."""
    if orientation is not None:
        return [_number(value) for value in orientation]
    if len(row) != POSE_AXES:
        return _FACED
    x, y, z = _turning(row)
    angle = hypot(x, y, z)
    share = 0.5 if angle == 0.0 else sin(0.5 * angle) / angle
    return cos(0.5 * angle), share * x, share * y, share * z


def _pose(time_ns: int, topic: str, frame: str, row: Row, orientation: Row | None) -> Message:
    def make(types: Types) -> Any:
        return types.make(POSE, types.header(time_ns, frame), types.pose(_three(row), _quaternion(row, orientation)))

    return Message(time_ns, topic, POSE, make)


def _twist(time_ns: int, topic: str, frame: str, row: Row) -> Message:
    def make(types: Types) -> Any:
        twist = types.make("geometry_msgs/msg/Twist", types.vector(_three(row)), types.vector(_turning(row)))
        return types.make(TWIST, types.header(time_ns, frame), twist)

    return Message(time_ns, topic, TWIST, make)


def _wrench(time_ns: int, topic: str, frame: str, row: Row, sign: float) -> Message:
    def make(types: Types) -> Any:
        force, torque = types.vector(_three(row, sign)), types.vector(_turning(row, sign))
        return types.make(WRENCH, types.header(time_ns, frame), types.make("geometry_msgs/msg/Wrench", force, torque))

    return Message(time_ns, topic, WRENCH, make)


def _poses(time_ns: int, topic: str, numbers: Row) -> Message:
    def make(types: Types) -> Any:
        flat = [_number(value) for value in numbers]
        bodies = [flat[at : at + _POSE_NUMBERS] for at in range(0, len(flat), _POSE_NUMBERS)]
        poses = [types.pose(body[:PLACES], body[PLACES:]) for body in bodies]
        return types.make(POSES, types.header(time_ns, FRAME), poses)

    return Message(time_ns, topic, POSES, make)


def _joint(time_ns: int, topic: str, frame: str, opening: float, rate: float, force: float) -> Message:
    def make(types: Types) -> Any:
        values = [np.array([value]) for value in (opening, rate, force)]
        return types.make(JOINT, types.header(time_ns, frame), ["opening"], *values)

    return Message(time_ns, topic, JOINT, make)


def _text(time_ns: int, topic: str, text: str) -> Message:
    return Message(time_ns, topic, TEXT, lambda types: types.make(TEXT, text))
