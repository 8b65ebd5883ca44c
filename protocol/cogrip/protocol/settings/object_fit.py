"""Settings that fit a kind of object, and those that do not."""

from collections.abc import Sequence

from cogrip.protocol.axes import GRIP_AXES, PLACES, POSE_AXES
from cogrip.protocol.settings.object_kinds import KINDS, kind_of, unfit_kind
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.settings.task import unfit
from cogrip.protocol.settings.types import MOST_PARTNERS, MOST_WAVES, PINCH


def unfit_object(settings: Settings, compensated: Sequence[str]) -> str:
    """Return why settings do not fit their kind of object, with the cure; "" where they do. compensated: who asks for that."""
    given, coupling = settings.object, settings.coupling
    local = coupling.traits.local
    if why := unfit(settings.task, given.traits.scene):
        return why
    if why := unfit_kind(given.kind):
        return f'object.kind = "{given.kind}": {why}'
    if not given.traits.scene:
        users = list(enumerate(settings.users))
        own = [(f"object.{key}", getattr(given, key)) for key in ("file", "folder", "script", "keyframe", "ctrl")]
        own += [(f"users.{n}.tool", user.tool) for n, user in users]
        own += [(f"users.{n}.orientation", user.orientation) for n, user in users]
        for key, value in own:
            if value:
                return f'{key} = {value!r} is for object.kind = "scene", not "{given.kind}"; leave one of them out'
        if given.axes > PLACES and given.kind in KINDS:
            return f'object.axes = {given.axes}, but object.kind = "{given.kind}" has at most {PLACES}; lower it'
    if local and not given.traits.local:
        return (
            f'coupling.kind = "{coupling.kind}" renders contact, and with object.kind = "{given.kind}" a client knows none; '
            'set object.kind to "wall", "faces" or "scene", or coupling.kind = "wave"'
        )
    if coupling.traits.one_object and (why := _unfit_one(settings)):
        return f'coupling.kind = "{coupling.kind}" {why}'
    if kind_of(given.kind).plain:
        return ""
    scene, step = given.traits.scene, coupling.server_step
    grips = any(user.grips for user in settings.users)
    axes = GRIP_AXES if grips else given.axes
    proxy = PLACES if local and axes == POSE_AXES else 0  # in the room of as many waves (SPEC.md 3.6)
    refused = [
        (scene and not given.file, 'object.file = "" names no scene', 'give an MJCF or URDF file, such as "lift.xml"'),
        (
            scene and given.axes not in (PLACES, POSE_AXES),
            f"object.axes = {given.axes}, but a scene has 3 (places) or 6 (poses)",
            "set one of them",
        ),
        (
            PLACES < given.axes < POSE_AXES,
            f"object.axes = {given.axes}, but a world has 1 to 3 (places) or 6 (poses)",
            "set one of them",
        ),
        (
            given.axes == PLACES and any(user.orientation == "driven" for user in settings.users),
            'orientation = "driven" needs a hand that turns',
            "set object.axes = 6",
        ),
        (
            grips and given.axes != PLACES,
            f'object.axes = {given.axes}, but tool = "{PINCH}" moves in places alone',
            "set object.axes = 3",
        ),
        (
            grips and not coupling.traits.any_world,
            f'coupling.kind = "{coupling.kind}" has no gripper',
            f'set coupling.kind = "wave", or take another tool than "{PINCH}"',
        ),
        (
            axes * settings.playout.redundancy + proxy > MOST_WAVES,
            f"playout.redundancy = {settings.playout.redundancy} of {axes} axes is more than a datagram holds",
            f"set it to at most {(MOST_WAVES - proxy) // axes}",
        ),
        (
            scene and given.axes == POSE_AXES and not coupling.traits.poses,
            f'coupling.kind = "{coupling.kind}" has no poses',
            'set coupling.kind = "wave", "local" or "partner", or object.axes = 3',
        ),
        (
            given.axes == POSE_AXES
            and coupling.traits.gated
            and any(user.orientation not in ("", "driven") for user in settings.users),
            f'coupling.kind = "{coupling.kind}" has poses of all hands or of none',
            'set orientation = "driven" for each, or coupling.kind = "wave"',
        ),
        (
            not scene and not coupling.traits.any_world,
            f'coupling.kind = "{coupling.kind}" does not fit it',
            'set coupling.kind = "wave"',
        ),
        (
            step != "passive",
            f'coupling.server_step = "{step}" does not fit it',
            'set coupling.server_step = "passive"',
        ),
        (
            bool(compensated),
            f"coupling.compensate = true ({', '.join(compensated)}), but it has no spring to stiffen",
            "set it to false",
        ),
    ]
    for found, what, cure in refused:
        if found:
            return f'object.kind = "{given.kind}": {what}; {cure}'
    return ""


def _unfit_one(settings: Settings) -> str:
    """Return why a room is none of one free object that few hold from all sides, "" where it is; of a scene its file says."""
    given = settings.object
    if not (given.traits.held or given.traits.scene) or any(user.grips for user in settings.users):
        return (
            "is for one free object that is held from all sides, without grippers; "
            'set object.kind = "cube" or "scene", or coupling.kind = "wave"'
        )
    if given.script:
        return 'has no scripts of scenes, which its clients do not run; leave object.script out, or set coupling.kind = "wave"'
    if len(settings.users) > MOST_PARTNERS + 1:
        people = len(settings.users)
        return f'has room for {MOST_PARTNERS + 1} people, and there are {people}; set coupling.kind = "wave"'
    return ""
