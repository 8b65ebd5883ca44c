"""Bodies of a scene as an observer has received them: all shapes, and the newest pose of each body."""

from math import nan

from cogrip.protocol.drawing import Shape
from cogrip.protocol.wire.messages import Bodies, Geom, Note, Pose

UNKNOWN: Pose = (nan,) * 7


class ObservedScene:
    """shapes: all of them, in order; empty until they have come. A session has one scene: another session begins anew."""

    def __init__(self) -> None:
        self._begin(0)

    def _begin(self, session: int) -> None:
        self.shapes: tuple[Shape, ...] = ()
        self._session, self._count = session, 0
        self._parts: dict[int, Shape] = {}
        self._poses: dict[int, tuple[int, Pose]] = {}  # body -> step, pose
        self._notes: dict[int, str] = {}

    def receive(self, message: Geom | Bodies | Note) -> str:
        """Take in a message. Returns why it is dropped, "" where it is not."""
        if message.session != self._session:
            self._begin(message.session)
        if isinstance(message, Note):
            return self._receive_note(message)
        return self._receive_shape(message) if isinstance(message, Geom) else self._receive_poses(message)

    def _receive_note(self, note: Note) -> str:
        if note.number >= note.count:
            return "unfit"
        self._notes[note.number] = note.text
        return ""

    @property
    def notes(self) -> tuple[str, ...]:
        """Return the sentences about the room's world that have come, in their order."""
        return tuple([text for _, text in sorted(self._notes.items())])

    def _receive_shape(self, geom: Geom) -> str:
        if geom.number >= geom.count or geom.count != (self._count or geom.count):
            return "unfit"
        self._count = geom.count
        self._parts.setdefault(geom.number, geom.shape)
        if not self.shapes and len(self._parts) == geom.count:
            self.shapes = tuple([self._parts[number] for number in range(geom.count)])
        return ""

    def _receive_poses(self, bodies: Bodies) -> str:
        newer = False
        for body, pose in bodies.read():
            if body not in self._poses or bodies.number > self._poses[body][0]:
                self._poses[body], newer = (bodies.number, pose), True
        return "" if newer else "late poses"

    def poses(self) -> tuple[Pose, ...]:
        """Return the pose of each body that the shapes are of; UNKNOWN for one that has not come."""
        most = max((body for shape in self.shapes for body in shape.bodies), default=-1)
        return tuple([self._poses[body][1] if body in self._poses else UNKNOWN for body in range(most + 1)])
