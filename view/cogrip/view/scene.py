"""Scene of a view: what does not change from frame to frame (`docs/view.md`)."""

from collections.abc import Sequence
from typing import Literal

import msgspec

from cogrip.devices.web.messages import Vector

Mode = Literal["live", "recording"]
EventKind = Literal["joined", "left", "lost", "kicked", "fault", "marker", "other"]
# Okabe and Ito's palette, as in the reports; darker from the seventh person on, paler from the thirteenth.
_PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


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


def colour(seat: int) -> str:
    """Return a person's colour as #rrggbb: the one that the plots of a report have."""
    base = _PALETTE[seat % len(_PALETTE)]
    parts = [int(base[each : each + 2], 16) / 255 for each in (1, 3, 5)]
    round_ = seat // len(_PALETTE) % 3
    if round_ == 1:
        parts = [0.55 * part for part in parts]
    elif round_ == 2:
        parts = [0.45 + 0.55 * part for part in parts]
    return "#" + "".join(f"{round(255 * part):02X}" for part in parts)


def to_json(message: Scene | SceneEvent | Sequence[SceneEvent]) -> str:
    """Return a text message."""
    return msgspec.json.encode(message).decode()
