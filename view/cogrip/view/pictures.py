"""Pictures of a frame for 3D panels: `foxglove.SceneUpdate` and `foxglove.FrameTransforms`.

Frames are `<room>` (the root), `<room>/object`, and of each person `<room>/<name>/hand`, `.../proxy` and `.../seen`: the object
as that person sees it at this moment.
"""

from collections.abc import Iterator
from math import isfinite

from cogrip.machine.rows import Vector
from cogrip.protocol.recording.scene_messages import (
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
    turned_to,
)
from cogrip.protocol.session_drawing import HAND_SIZE_M, OBJECT_COLOUR
from cogrip.view.frames import PersonFrame, SceneFrame
from cogrip.view.scene import PageScene, ScenePerson

_PLANE_M = 0.001  # thickness of a plane as it is drawn


def drawn(scene: PageScene, frame: SceneFrame) -> frozenset[str]:
    """Return the frames that have a place in this frame."""
    fixed = [scene.room] if scene.geoms or scene.effects else []
    return frozenset([place.frame for place in _places(scene, frame)] + fixed)


def scene(scene: PageScene, drawn: frozenset[str], time_ns: int) -> bytes:
    """Return the bodies of the frames in `drawn`."""
    return scene_update(time_ns, [body for body in _bodies(scene) if body.frame in drawn])


def transforms(scene: PageScene, frame: SceneFrame, time_ns: int) -> bytes:
    """Return where everything is."""
    return frame_transforms(time_ns, scene.room, list(_places(scene, frame)))


def forces(scene: PageScene, frame: SceneFrame, time_ns: int) -> bytes:
    """Return everybody's force on the object and stretched coupling, and what is flexible in a scene."""
    pushes: list[Push] = []
    for person, who in _people(scene, frame):
        proxy_m, hand_m = _at(person.proxy_m, who), _at(person.hand_m, who)
        if proxy_m is not None and _known(person.force_n):
            pushes.append(Push(proxy_m, person.force_n, who.colour, hand_m))
    soft = soft_entities(time_ns, scene.room, scene.geoms, frame.bodies)
    return forces_update(time_ns, scene.room, pushes, soft)


def _people(scene: PageScene, frame: SceneFrame) -> Iterator[tuple[PersonFrame, ScenePerson]]:
    """Yield those who have a seat."""
    by_seat = {person.seat: person for person in scene.people}
    for person in frame.people:
        if person.state != "free" and person.seat in by_seat:
            yield person, by_seat[person.seat]


def _places(scene: PageScene, frame: SceneFrame) -> Iterator[Place]:
    w, x, y, z = frame.orientation
    if _known(frame.position_m):
        yield Place(f"{scene.room}/object", frame.position_m, Quaternion(x, y, z, w))
    for number, body in enumerate(scene.geometry):
        turned = turned_to(body.normal) if body.shape == "plane" and any(body.normal) else Quaternion()
        yield Place(f"{scene.room}/fixed/{number}", body.position_m, turned)
    yield from body_places(scene.room, scene.geoms, frame.bodies)
    for person, who in _people(scene, frame):
        held = quaternion_of(person.orientation) if all(map(isfinite, person.orientation)) else Quaternion()
        for name, at_m, turned in (
            ("hand", _at(person.hand_m, who), held),
            ("proxy", _at(person.proxy_m, who), Quaternion()),
        ):
            if at_m is not None:
                yield Place(f"{scene.room}/{who.name}/{name}", at_m, turned)
        if _known(person.seen_m):
            yield Place(f"{scene.room}/{who.name}/seen", person.seen_m)


def _bodies(scene: PageScene) -> Iterator[Body]:
    size_m, point_m = scene.object.size_m, (HAND_SIZE_M, HAND_SIZE_M, HAND_SIZE_M)
    box = scene.object.shape != "sphere"
    if shapes := (*scene.geoms, *scene.effects):
        yield from scene_bodies(scene.room, shapes, {who.seat for who in scene.people})
    if not scene.geoms:
        yield Body(f"{scene.room}/object", size_m, OBJECT_COLOUR, box, alpha=0.6)
    for number, body in enumerate(scene.geometry):
        depth, width, height = body.size_m
        yield Body(f"{scene.room}/fixed/{number}", (max(depth, _PLANE_M), width, height), OBJECT_COLOUR, box=True)
    for who in scene.people:
        yield Body(f"{scene.room}/{who.name}/hand", point_m, who.colour, label=who.name)
        yield Body(f"{scene.room}/{who.name}/proxy", point_m, who.colour, alpha=0.5)
        if not scene.geoms:
            yield Body(f"{scene.room}/{who.name}/seen", size_m, who.colour, box, alpha=0.12)


def _at(place_m: Vector, who: ScenePerson) -> Vector | None:
    """Return a point of a person in the room; None where it is not known."""
    if not _known(place_m):
        return None
    x, y, z = (each + away for each, away in zip(place_m, who.anchor_m, strict=True))
    return x, y, z


def _known(values: Vector) -> bool:
    return all(isfinite(each) for each in values)
