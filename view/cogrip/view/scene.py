"""Scene of a view: what does not change from frame to frame (`docs/view.md`)."""

from collections.abc import Sequence
from typing import Literal

import msgspec

from cogrip.devices.web.messages import Vector
from cogrip.protocol.drawing import colour as colour

Mode = Literal["live", "recording"]
EventKind = Literal["joined", "left", "lost", "kicked", "fault", "marker", "other"]


class SceneEvent(msgspec.Struct, frozen=True, tag_field="type", tag="event"):
    """Something that happened at `time_s` on the session's clock."""

    time_s: float
    kind: EventKind
    who: str
    text: str


class ScenePerson(msgspec.Struct, frozen=True):
    """A person in the scene. anchor_m: where on the object this person holds it."""

    seat: int
    name: str
    colour: str
    anchor_m: Vector


class SceneObject(msgspec.Struct, frozen=True):
    """The shared object as it is drawn. kind: as in the settings."""

    kind: str
    shape: Literal["box", "sphere", "wall"]
    size_m: Vector
    mass_kg: float


class Geometry(msgspec.Struct, frozen=True):
    """A fixed body of the scene."""

    shape: Literal["box", "plane"]
    position_m: Vector
    normal: Vector
    size_m: Vector


class Scene(msgspec.Struct, frozen=True, tag_field="type", tag="scene"):
    """All that a page needs before its first frame."""

    room: str
    mode: Mode
    axes: int
    network_hz: int
    device_hz: int
    object: SceneObject
    people: tuple[ScenePerson, ...] = ()
    geometry: tuple[Geometry, ...] = ()
    workspace_m: tuple[tuple[float, float], ...] = ((-0.1, 0.1),) * 3
    hand: bool = False
    own_seat: int | None = None
    note: str = ""
    duration_s: float | None = None
    chunks: int = 0
    events: tuple[SceneEvent, ...] = ()
    version: int = 1


def to_json(message: Scene | SceneEvent | Sequence[SceneEvent]) -> str:
    """Return a text message."""
    return msgspec.json.encode(message).decode()
