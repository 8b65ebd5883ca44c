"""A recorded run as a view: scene, events and frames, a chunk of ten seconds at a time.

Frames are the room's own steps, every k-th of them, with the numbers that were recorded: nothing is interpolated. What a client
knows (hand, round trip ...) is its newest tick at that moment. Where the server's part is missing the ticks of the first client
are the frames, and the object is where that person saw it; where a client's part is missing its hand is not known.
"""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import nan
from pathlib import Path

import msgspec

from cogrip.devices.web.messages import State, vector
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Vector
from cogrip.protocol.axes import PLACES
from cogrip.protocol.drawing import MOST_SHAPES
from cogrip.protocol.foreign_file import ForeignFileError
from cogrip.protocol.recording.derived import offset_of
from cogrip.protocol.recording.reader import RecordingError
from cogrip.protocol.recording.records import Geoms, Number, Poses, Row, SeatStep, Step, Tick
from cogrip.protocol.scene_words import as_sentence, left_out_words
from cogrip.protocol.session_drawing import LEAST_DRAWN_N, anchors_m
from cogrip.protocol.settings.coupling_kinds import lent_mj
from cogrip.protocol.settings.effects import drawn_effect
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.texts import shown
from cogrip.protocol.wire.messages import Pose
from cogrip.results.reading.folder import SETTINGS
from cogrip.results.reading.records import open_run
from cogrip.results.verdict.verdict import least_margin
from cogrip.server.recorder import scene_topics, step_topic
from cogrip.view import frames
from cogrip.view.file_index import FileIndex
from cogrip.view.frames import PersonFrame, SceneFrame
from cogrip.view.recorded_events import client_event, server_event
from cogrip.view.scene import (
    WORKSPACE_M,
    PageScene,
    SceneEvent,
    ScenePerson,
    colour,
    scene_object,
    turn_of,
    workspace_of,
)

CHUNK_S = 10.0
MOST_HZ = 64  # most frames a second
SILENT_S = 0.5  # a client that has not ticked for so long is silent
LOSS_S = 1.0  # time over which the share of frames lost is taken
_BEFORE_S = LOSS_S + SILENT_S  # time that is read before a chunk, for what its first frames need
_EVENTS_AT_MOST = 2000
_JOINING_S = 1.0  # longest time between a person's joining and the first step that tells of it
UNKNOWN: Vector = (nan, nan, nan)
UNKNOWN_POSE: Pose = (nan,) * 7
_STATES: dict[str, State] = {"live": "live", "clutched": "live", "degraded": "degraded", "fault": "fault"}
_tick = msgspec.json.Decoder(Tick).decode
_step = msgspec.json.Decoder(Step).decode
_geoms = msgspec.json.Decoder(Geoms).decode
_poses = msgspec.json.Decoder(Poses).decode


class ViewError(ForeignFileError):
    """A run that cannot be shown. The text says why, and the cure."""


@dataclass(slots=True)
class _Ticks:
    """Ticks of one client over some seconds, decoded when they are asked for."""

    times_s: list[float]
    payloads: list[bytes]
    decoded: dict[int, Tick]

    def newest(self, time_s: float) -> tuple[float, Tick] | None:
        """Return the newest tick at `time_s`, with its time; None where there was none in the last SILENT_S."""
        place = bisect_right(self.times_s, time_s) - 1
        if place < 0 or time_s - self.times_s[place] > SILENT_S:
            return None
        if place not in self.decoded:
            self.decoded[place] = _tick(self.payloads[place])
        return self.times_s[place], self.decoded[place]


class RecordedView:
    """Scene and chunks of a run. Make it with `open_view`.

    began_ns  UTC of the view's time 0, by the recording machine's clock; of a run in virtual time, that time
    """

    def __init__(self, path: Path) -> None:
        run = open_run(path)
        self._settings = run.settings() or _settings_beside(run.folder)
        copies = self._settings.coupling.traits.copies if self._settings and run.server else ""
        self._notes = [*([copies] if copies else []), *run.notes]
        self._clients = {name: FileIndex(end, ("tick", "event")) for name, end in run.clients.items()}
        self._server: FileIndex | None = None
        self._bodies: list[str] = []  # topics of the shapes and the poses of a scene
        if run.server is not None and self._settings is not None:
            self._step = step_topic(self._settings.name)
            there = run.server.recording.topics
            self._bodies = [topic for topic in scene_topics(self._settings.name) if topic in there]
            self._server = FileIndex(run.server, (self._step, "event", *self._bodies))
        self._names = tuple(run.names())
        self._began = {name: span[0] for name, index in self._clients.items() if (span := index.first_and_last("tick"))}
        spans = [span for index, kind in self._motions() if (span := index.first_and_last(kind))]
        if not spans:
            raise ViewError(f"{path} holds no motion: nobody had a seat while it was recorded; name another run")
        self._start_s = min(first_s for first_s, _ in spans)
        self._end_s = max(last_s for _, last_s in spans)
        self._rate_hz = next((index.end.rate_hz for index, _ in self._motions()), 0)
        shift = next(
            index.end.recording.header.epoch_ns - round(index.end.offset_s * 1e9) for index, _ in self._motions()
        )
        self.began_ns = round(self._start_s * 1e9) + shift
        self._every = -(-self._rate_hz // MOST_HZ)
        self._offsets: list[tuple[float, Row]] = []  # of seats' own frames from the object's, each from a time on
        self._geoms, self._first_poses = self._find_bodies()
        if self._geoms.left_out:
            self._notes.append(as_sentence(left_out_words(self._geoms.left_out)))
        self.scene = self._make_scene(self._settings or Settings(), next(iter(self._clients.values()), None))
        self.frames = lru_cache(maxsize=3)(self._frames)

    def _motions(self) -> list[tuple[FileIndex, str]]:
        """Return what gives the frames: the server's steps, or the ticks of the first client that has any."""
        if self._server is not None:
            return [(self._server, self._step)]
        return [(self._clients[name], "tick") for name in list(self._began)[:1]]

    def _find_bodies(self) -> tuple[Geoms, tuple[Pose, ...]]:
        """Return the shapes of a scene, and the first poses of its bodies; none where there are no bodies."""
        if self._server is not None and self._bodies:
            told = [(time_s, _geoms(message.payload)) for time_s, message in self._server.messages(self._bodies[0])]
            first = next((_poses(message.payload) for _, message in self._server.messages(self._bodies[1])), None)
            if told and first is not None:
                self._offsets = [(time_s, geoms.offsets_m) for time_s, geoms in told]
                return told[0][1], _of_bodies(first)
        return Geoms((), ()), ()

    def _make_scene(self, settings: Settings, client: FileIndex | None) -> PageScene:
        sides = [user.side for user in settings.users] if self._server else ["left"] * len(self._names)
        kind, axes = settings.object.kind, min(settings.object.axes, PLACES)
        if self._server is None and client is not None:
            axes = next((len(_tick(message.payload).object_m[:PLACES]) for _, message in client.messages("tick")), axes)
            self._notes.append(
                "The server's recording is not here: the object is where the first person saw it; "
                "`cogrip merge` brings the parts together."
            )
        missing = [name for name in self._names if name not in self._clients]
        if missing:
            self._notes.append(f"Not recorded here, so their hands are not known: {', '.join(missing)}.")
        events = tuple(self._events())
        people = [
            ScenePerson(seat, name, colour(seat), self._anchor(seat, anchor, events))
            for seat, (name, anchor) in enumerate(zip(self._names, anchors_m(kind, sides), strict=False))
        ]
        duration_s = self._end_s - self._start_s
        room = settings.name if self._server or client is None else client.end.recording.header.room
        return PageScene(
            room, "recording", axes, settings.rates.network_hz, settings.rates.device_hz,
            scene_object(kind, settings.object.mass_kg), tuple(people),
            note=shown(" ".join(self._notes)), duration_s=duration_s, chunks=int(duration_s // CHUNK_S) + 1,
            events=events, geoms=self._geoms.shapes,
            effects=tuple([shape for effect in settings.effects for shape in drawn_effect(effect)]),
            workspace_m=workspace_of(self._geoms.shapes, self._first_poses) if self._geoms.shapes else WORKSPACE_M,
        )  # fmt: skip

    def _anchor(self, seat: int, held_m: Vector, events: Sequence[SceneEvent]) -> Vector:
        """Return where a person's hand and proxy are drawn from: the point held, less what joining put between their frames."""
        name = self._names[seat]
        joined_s = next((event.time_s for event in events if event.kind == "joined" and event.who == name), 0.0)
        begin_s = joined_s + self._start_s
        offset = self._geoms.offsets_m[3 * seat : 3 * seat + 3]
        if len(offset) == 3:  # of a scene: the tool itself
            return vector([-(each or 0.0) for each in offset])
        if self._server is not None:
            for _, message in self._server.messages(self._step, begin_s - _JOINING_S, begin_s + _JOINING_S):
                step = _step(message.payload)
                if seat < len(step.seats) and step.seats[seat].seated:
                    x, y, z = (
                        held - away
                        for held, away in zip(held_m, _vector(offset_of(step.seats[seat], step)), strict=True)
                    )
                    return x, y, z
        return held_m

    def _shift(self, seat: int, time_s: float) -> Vector:
        """Return by how much a person's own frame is elsewhere than at the anchor: a tied tool is taken anew where it is."""
        at = bisect_right(self._offsets, time_s, key=lambda told: told[0]) - 1
        if at < 1:
            return 0.0, 0.0, 0.0
        rows = [_vector(self._offsets[told][1][3 * seat : 3 * seat + 3]) for told in (0, at)]
        x, y, z = (was - now for was, now in zip(*rows, strict=True))
        return x, y, z

    def _events(self) -> Iterator[SceneEvent]:
        found: list[SceneEvent] = []
        if self._server is not None and self._settings is not None:
            for time_s, message in self._server.messages("event"):
                text = msgspec.json.decode(message.payload)["text"]
                if event := server_event(self._on_clock(time_s), text, self._settings.name, self._names):
                    found.append(event)
        for name, index in self._clients.items():
            for time_s, message in index.messages("event"):
                text = msgspec.json.decode(message.payload)["text"]
                event = client_event(self._on_clock(time_s), text, name)
                if event and not (event.kind == "marker" and self._server):  # the server has those of everybody
                    found.append(event)
        yield from sorted(found, key=lambda event: event.time_s)[:_EVENTS_AT_MOST]

    def _on_clock(self, time_s: float) -> float:
        return min(max(0.0, time_s - self._start_s), self._end_s - self._start_s)

    def chunk(self, number: int) -> bytes:
        """Return one chunk as the socket sends it. Raises ViewError for a number that is not there."""
        return frames.encode_chunk(number, self.frames(number))

    def _frames(self, number: int) -> tuple[SceneFrame, ...]:
        """Return the frames of one chunk. Raises ViewError for a number that is not there."""
        if not 0 <= number < self.scene.chunks:
            raise ViewError(f"chunk {number} is not there; the recording has {self.scene.chunks}, from 0")
        from_s = self._start_s + number * CHUNK_S
        to_s = from_s + CHUNK_S
        begin_s = from_s - _BEFORE_S
        try:
            clients = {name: _ticks(index, begin_s, to_s) for name, index in self._clients.items()}
            if self._server is None:
                return tuple(self._frames_of_ticks(clients, from_s))
            steps = [
                (time_s, _step(message.payload)) for time_s, message in self._server.messages(self._step, begin_s, to_s)
            ]
            bodies = self._poses_between(from_s, to_s)
        except msgspec.MsgspecError as error:
            raise ViewError(f"a message of the recording is not what its topic says: {error}") from None
        return tuple(self._frames_of_steps(steps, clients, from_s, bodies))

    def _poses_between(self, from_s: float, to_s: float) -> dict[int, tuple[Pose, ...]]:
        """Return the poses of all bodies by the step after which they were."""
        if self._server is None or not self._geoms.shapes:
            return {}
        messages = self._server.messages(self._bodies[1], from_s, to_s)
        found = {poses.step: _of_bodies(poses) for poses in (_poses(message.payload) for _, message in messages)}
        return {step: poses for step, poses in found.items() if len(poses) == len(self._first_poses)}

    def _frames_of_steps(
        self, steps: Sequence[tuple[float, Step]], clients: dict[str, _Ticks], from_s: float,
        bodies: dict[int, tuple[Pose, ...]],
    ) -> Iterator[SceneFrame]:  # fmt: skip
        times_s = [time_s for time_s, _ in steps]
        given = self._settings
        credit_j = 1e-3 * lent_mj(given.coupling.kind, given.playout.tank_mj) if given else 0.0
        unknown = (UNKNOWN_POSE,) * len(self._first_poses)
        for time_s, step in steps:
            if time_s < from_s or step.step % self._every:
                continue
            before_s, before = steps[max(0, bisect_right(times_s, time_s - LOSS_S) - 1)]
            people: list[PersonFrame] = []
            for seat, name in enumerate(self._names):
                now = step.seats[seat] if seat < len(step.seats) else None
                earlier = before.seats[seat] if seat < len(before.seats) else None
                lost = (now.lost - earlier.lost, time_s - before_s) if now and earlier else None
                people.append(self._person(seat, now, time_s, clients.get(name), lost, credit_j))
            poses = bodies.get(step.step, unknown)
            yield self._frame(step.step, time_s, _vector(step.object_m), _vector(step.object_mps), people, poses)

    def _frames_of_ticks(self, clients: dict[str, _Ticks], from_s: float) -> Iterator[SceneFrame]:
        first = next(iter(self._motions()), None)
        clock = clients[first[0].end.who] if first else _Ticks([], [], {})
        for time_s in clock.times_s:
            found = clock.newest(time_s) if time_s >= from_s else None
            if found is None or found[1].tick % self._every:
                continue
            people = [
                self._person(seat, None, time_s, clients.get(name), None, 0.0) for seat, name in enumerate(self._names)
            ]
            yield self._frame(found[1].tick, time_s, _vector(found[1].object_m), UNKNOWN, people)

    def _frame(
        self, number: int, time_s: float, position_m: Vector, velocity_mps: Vector, people: Sequence[PersonFrame],
        bodies: tuple[Pose, ...] = (),
    ) -> SceneFrame:  # fmt: skip
        touched = any(person.flags & frames.PUSHES for person in people)
        axes, flags = self.scene.axes, frames.CONTACT if touched else 0
        turned = turn_of(self._geoms.shapes, bodies)
        return SceneFrame(
            axes, number, time_s - self._start_s, position_m, velocity_mps, tuple(people), turned, flags, bodies
        )

    def _person(
        self, seat: int, step: SeatStep | None, time_s: float, ticks: _Ticks | None, lost_up: tuple[int, float] | None,
        credit_j: float,
    ) -> PersonFrame:  # fmt: skip
        found = ticks.newest(time_s) if ticks else None
        if (self._server is not None and (step is None or not step.seated)) or (step is None and found is None):
            return PersonFrame(seat)
        tick = found[1] if found else None
        counts = [lost_up] if lost_up else []
        if tick and ticks and (earlier := ticks.newest(time_s - LOSS_S) or ticks.newest(ticks.times_s[0])):
            counts.append((tick.lost - earlier[1].lost, time_s - earlier[0]))
        hz = self.scene.network_hz
        shares = [min(1.0, max(0.0, count / (hz * span_s))) for count, span_s in counts if span_s > 0.0]
        force_n = _vector(step.force_n if step else tick.force_n if tick else ())
        margins_j = [("up_margin_j", step.up_margin_j), ("line_margin_j", step.line_margin_j)] if step else []
        margins_j += [("down_margin_j", tick.margin_j)] if tick else []
        pushes = add_floats(each * each for each in force_n) >= LEAST_DRAWN_N**2
        active = any(margin_j is not None and margin_j < least_margin({}, key, credit_j) for key, margin_j in margins_j)
        known = tick is not None and tick.position_m is not None
        handle, shift = tick or step, self._shift(seat, time_s)
        assert handle is not None
        return PersonFrame(
            seat, self._state(seat, tick, time_s),
            (frames.PUSHES if pushes else 0) | (frames.NOT_PASSIVE if active else 0) | (frames.HAND_KNOWN if known else 0),
            (step.lost if step else 0) + (tick.lost if tick else 0),
            _moved(_vector(tick.position_m), shift) if tick and tick.position_m is not None else UNKNOWN,
            _moved(_vector(step.proxy_m), shift) if step else UNKNOWN,
            force_n,
            _vector(tick.object_m) if tick else UNKNOWN,
            rtt_ms=_number(tick.rtt_ms if tick else None),
            up_ms=_number(tick.up_ms if tick else None),
            down_ms=_number(tick.down_ms if tick else None),
            buffer_down_ms=_number(tick.playout_frames if tick else None) * 1e3 / hz,
            up_reserve_mj=_number(step.up_reserve_j if step else None) * 1e3,
            line_reserve_mj=_number(step.line_reserve_j if step else None) * 1e3,
            loss=add_floats(shares) / len(shares) if shares else nan,
            buttons=handle.buttons, grip_m=_number(handle.grip_m),
            orientation=tuple(map(_number, handle.orientation)) if handle.orientation else frames.UNKNOWN_TURN,
        )  # fmt: skip

    def _state(self, seat: int, tick: Tick | None, time_s: float) -> State:
        """Return the state of somebody who has the seat."""
        if tick is not None:
            return _STATES.get(tick.state, "joining")
        name = self._names[seat]
        if name not in self._clients:
            return "live"  # as far as the server knows
        return "silent" if self._began.get(name, time_s) < time_s else "joining"


def open_view(path: str | Path) -> RecordedView:
    """Open a run folder or a recording. Raises ViewError with one line for what cannot be shown."""
    try:
        return RecordedView(Path(path))
    except (FileNotFoundError, RecordingError) as error:
        raise ViewError(str(error)) from None
    except OSError as error:
        raise ViewError(f"{path}: {error.strerror}; name a run folder that can be read") from None
    except (msgspec.MsgspecError, KeyError, TypeError) as error:
        raise ViewError(f"{path} holds a recording that does not say what it should: {error}") from None


def _settings_beside(folder: Path) -> Settings | None:
    """Return the settings in a run folder that has no server's recording; None where they are not there, or not readable."""
    try:
        return msgspec.json.decode((folder / SETTINGS).read_bytes(), type=Settings)
    except (OSError, msgspec.MsgspecError):
        return None


def _moved(place_m: Vector, by_m: Vector) -> Vector:
    x, y, z = (place + by for place, by in zip(place_m, by_m, strict=True))
    return x, y, z


def _ticks(index: FileIndex, from_s: float, to_s: float) -> _Ticks:
    found = list(index.messages("tick", from_s, to_s))
    return _Ticks([time_s for time_s, _ in found], [message.payload for _, message in found], {})


def _vector(row: Row) -> Vector:
    """Return three numbers: 0 for an axis that is not there, NaN for a number that is not known."""
    return vector([nan if each is None else each for each in row[:PLACES]])


def _of_bodies(poses: Poses) -> tuple[Pose, ...]:
    """Return seven numbers a body, NaN for one that is not known."""
    values = [nan if each is None else each for each in poses.poses]
    return tuple([tuple(values[at : at + 7]) for at in range(0, min(len(values) - 6, 7 * MOST_SHAPES), 7)])


def _number(value: Number) -> float:
    return nan if value is None else value
