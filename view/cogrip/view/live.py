"""Live session as scenes and frames, made of what an observer receives."""

from collections import deque
from math import isnan, nan

from cogrip.client.observed_scene import ObservedScene
from cogrip.client.observer import ObserverCore
from cogrip.devices.web.messages import ZERO, State, vector
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Vector
from cogrip.protocol.axes import PLACES
from cogrip.protocol.drawing import Shape
from cogrip.protocol.scene_words import as_sentence
from cogrip.protocol.session_drawing import LEAST_DRAWN_N, anchors_m
from cogrip.protocol.settings.coupling_kinds import lent_mj
from cogrip.protocol.settings.effects import Effect, drawn_effect
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.texts import shown
from cogrip.protocol.wire.button_edges import bits_of, edge_words
from cogrip.protocol.wire.messages import Person, Pose, View
from cogrip.results.verdict.verdict import least_margin
from cogrip.view import frames
from cogrip.view.frames import PersonFrame, SceneFrame
from cogrip.view.scene import (
    WORKSPACE_M,
    Geometry,
    PageScene,
    SceneEvent,
    ScenePerson,
    colour,
    scene_object,
    turn_of,
    workspace_of,
)

KEPT_STEPS = 512  # steps that are kept of the object's path, for what a person far away is still shown
LOSS_S = 1.0


class LiveScene:
    """Scene, frames and events of one room; `update` after every view."""

    def __init__(self, welcome: SeatSettings) -> None:
        """welcome: settings of an observer's welcome."""
        self._settings = welcome
        self._frame_s = welcome.rates.frame_s
        self._credit_j = 1e-3 * lent_mj(welcome.coupling.kind, welcome.playout.tank_mj)
        self._first: int | None = None
        self._path: deque[tuple[int, Vector]] = deque(maxlen=KEPT_STEPS)
        self._counts: dict[int, deque[tuple[float, int, int]]] = {}
        self._states: dict[int, State] = {}
        self._notes: tuple[str, ...] = ()  # sentences about the room's world
        self._shapes: tuple[Shape, ...] = ()
        self._poses: tuple[Pose, ...] = ()
        self._effects: dict[int, Effect] = {}
        self.people: dict[int, Person] = {}
        self.events: deque[SceneEvent] = deque(maxlen=256)
        self.scene = self._scene()

    def update(self, core: ObserverCore) -> SceneFrame | None:
        """Return the frame of the newest view, None without one. `scene` and `events` follow who is there."""
        view = core.view
        if view is None:
            return None
        if self._first is None or view.number < self._first or (self._path and view.number < self._path[-1][0]):
            self._first = view.number  # also after the server began anew
            self._path.clear()
        axes = len(view.object) // 2
        time_s = (view.number - self._first) * self._frame_s
        position = vector(view.object[:axes])
        self._path.append((view.number, position))
        self._follow(core.people, time_s)
        for mark in core.marked:
            who = self.people[mark.seat].name if mark.seat in self.people else ""
            at_s = max(0.0, min(time_s, (mark.step - self._first) * self._frame_s))
            self._say(at_s, "marker", who, shown(mark.text))
        core.marked.clear()
        self._draw(core.scene)
        if core.scene.notes != self._notes:
            self._notes = core.scene.notes
            self.scene = self._scene()
        if core.effects != self._effects:
            self._effects = dict(core.effects)
            self.scene = self._scene()
        people = tuple([self._person(each, view, axes, time_s) for each in self._seated(view)])
        contact = frames.CONTACT if any(person.flags & frames.PUSHES for person in people) else 0
        return SceneFrame(
            axes, view.number, time_s, position, vector(view.object[axes:]), people, turn_of(self._shapes, self._poses),
            contact, self._poses,
        )  # fmt: skip

    def _draw(self, scene: ObservedScene) -> None:
        """Take the bodies of a scene once all of them are known; until then the object alone is drawn."""
        poses = scene.poses()
        if scene.shapes is self._shapes:
            self._poses = poses
        elif not any(isnan(pose[0]) for pose in poses):
            self._shapes, self._poses = scene.shapes, poses
            self.scene = self._scene()

    def _seated(self, view: View) -> list[int]:
        return sorted({*view.seats, *self.people})

    def _follow(self, people: dict[int, Person], time_s: float) -> None:
        """Take note of who came, who left, and whose state changed."""
        for seat in self.people.keys() - people.keys():
            self._say(time_s, "left", self.people[seat].name, "left")
            self._counts.pop(seat, None)
            self._states.pop(seat, None)
        for seat, person in people.items():
            before = self._states.get(seat)
            if before is None:
                self._say(time_s, "joined", person.name, "joined")
            elif before == "live" and person.state == "silent":
                self._say(time_s, "lost", person.name, "is silent: its force is let go")
            self._states[seat] = person.state
            if words := hand_words(self.people.get(seat), person):
                self._say(time_s, "other", person.name, words)
            pressed = self.people[seat].buttons if seat in self.people else 0
            for bit in bits_of(pressed ^ person.buttons):
                self._say(time_s, "button", person.name, edge_words(bit + 1 if person.buttons >> bit & 1 else -bit - 1))
        changed = self._drawn(people) != self._drawn(self.people)
        self.people = dict(people)
        if changed:
            self.scene = self._scene()

    @staticmethod
    def _drawn(people: dict[int, Person]) -> dict[int, tuple[str, tuple[float, ...]]]:
        return {seat: (person.name, person.offset_m) for seat, person in people.items()}

    def _say(self, time_s: float, kind: str, who: str, text: str) -> None:
        self.events.append(SceneEvent(time_s, kind, who, f"{who} {text}".strip()))  # type: ignore[arg-type]

    def _person(self, seat: int, view: View, axes: int, time_s: float) -> PersonFrame:
        proxy = force = ZERO
        flags = 0
        if seat in view.seats:
            at = view.seats.index(seat)
            proxy, force = (vector(row[axes * at : axes * (at + 1)]) for row in (view.proxies_m, view.forces_n))
            flags = frames.PUSHES if add_floats(each * each for each in force) >= LEAST_DRAWN_N**2 else 0
        person = self.people.get(seat)
        if person is None:  # the message is on its way
            return PersonFrame(seat, "live", flags, 0, proxy, proxy, force, self._path[-1][1])
        margins = {"up_margin_j": person.up_margin_j, "line_margin_j": person.line_margin_j}
        if any(
            margin is not None and margin < least_margin({}, key, self._credit_j) for key, margin in margins.items()
        ):
            flags |= frames.NOT_PASSIVE
        if person.hand_m:
            flags |= frames.HAND_KNOWN
        buffer_ms = nan if person.buffer_frames is None else 1e3 * self._frame_s * person.buffer_frames
        up_ms = _known(person.up_ms) + (0.0 if person.buffer_frames is None else buffer_ms)
        loop_ms = nan if person.behind_frames is None else 1e3 * self._frame_s * person.behind_frames
        down_ms = max(0.0, loop_ms - up_ms)
        return PersonFrame(
            seat, person.state, flags, person.lost, vector(person.hand_m), proxy, force, self._seen(down_ms),
            _known(person.rtt_ms), up_ms, down_ms, buffer_ms, max(down_ms - _known(person.down_ms), 0.0),
            1e3 * _known(person.up_reserve_j), 1e3 * _known(person.line_reserve_j), self._loss(person, time_s),
            person.buttons, _known(person.grip_m), person.orientation or frames.UNKNOWN_TURN,
        )  # fmt: skip

    def _seen(self, down_ms: float) -> Vector:
        """Return where the object was `down_ms` ago: the newest that this person can be shown."""
        if down_ms != down_ms:
            return self._path[-1][1]
        step = self._path[-1][0] - round(1e-3 * down_ms / self._frame_s)
        return next((place for number, place in reversed(self._path) if number <= step), self._path[0][1])

    def _loss(self, person: Person, time_s: float) -> float:
        """Return the share of this person's frames that were lost in the last second."""
        counts = self._counts.setdefault(person.seat, deque())
        if counts and person.sent < counts[-1][2]:  # the line began anew
            counts.clear()
        counts.append((time_s, person.lost, person.sent))
        while counts[0][0] < time_s - LOSS_S:
            counts.popleft()
        sent = person.sent - counts[0][2]
        return (person.lost - counts[0][1]) / sent if sent > 0 else 0.0

    def _scene(self) -> PageScene:
        given = self._settings
        axes, wall = min(given.object.axes, PLACES), given.object.traits.fixed
        geometry = (Geometry("plane", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.2, 0.2)),) if wall else ()
        people = []
        held_at = anchors_m(given.object.kind, ["left"] * (1 + max(self.people, default=0)))
        for seat, person in sorted(self.people.items()):
            held, offset = held_at[seat], vector(person.offset_m)
            anchor = (held[0] - offset[0], held[1] - offset[1], held[2] - offset[2])
            people.append(ScenePerson(seat, person.name, colour(seat), anchor))
        return PageScene(
            given.room, "live", axes, given.rates.network_hz, given.rates.device_hz,
            scene_object(given.object.kind, given.object.mass_kg), tuple(people), geometry,
            effects=tuple([shape for _, effect in sorted(self._effects.items()) for shape in drawn_effect(effect)]),
            note=self._note(), geoms=self._shapes,
            workspace_m=workspace_of(self._shapes, self._poses) if self._shapes else WORKSPACE_M,
        )  # fmt: skip

    def _note(self) -> str:
        """Return what a person who looks at this should know of it."""
        copies = self._settings.coupling.traits.copies
        return " ".join([*([copies] if copies else []), *(as_sentence(shown(text)) for text in self._notes)])


def hand_words(before: Person | None, person: Person) -> str:
    """Return what is new of how a hand moves its tool, "" for nothing."""
    found = []
    if person.clutched is not (before is not None and before.clutched):
        found.append("clutched" if person.clutched else "engaged")
    for name, text in (("position_scale", "position scale"), ("force_scale", "force scale")):
        value: float = getattr(person, name)
        if value != (getattr(before, name) if before is not None else 1.0):
            found.append(f"{text} {value:g}")
    return ", ".join(found)


def _known(value: float | None) -> float:
    return nan if value is None else value
