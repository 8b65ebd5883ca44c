"""Settings of a task: what people are to do with a body of a scene."""

from typing import Annotated, Literal

import msgspec

Goal = Annotated[float, msgspec.Meta(ge=0.0, le=1e4)]
Place = Annotated[float, msgspec.Meta(ge=-1e3, le=1e3)]
EVERYBODY = "everybody holds on"
"""Marker with which a task that people begin together begins: simulated hands wait for it."""


class Task(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[task]: what people are to do with a body of a scene. The server's own; goals that are None are none.

    Reached at the first moment from which all goals are met for `dwell_s`: once lifted and turned far enough, and in its place
    now. What is so from the start is nobody's doing: it counts once it has been lost and is met again, or is kept until `by_s`.
    dwell_s = 0: at the first moment at which all are met, also where that is the start.
    """

    body: str = ""  # body that the task is about; "" the object
    lifted_m: Goal | None = None  # least height above where it starts, at some time
    turned_rad: Goal | None = None  # least angle of turning about `axis` of the world, either way
    axis: Literal["x", "y", "z"] = "z"
    place_m: tuple[Place, Place, Place] = (0.0, 0.0, 0.0)  # place to reach, from where it starts
    within_m: Goal | None = None  # largest distance from `place_m`
    tilt_rad: Goal | None = None  # largest tilt of its upright axis, at all times before
    # time limit, from the beginning of the task; None: until the end
    by_s: Annotated[float, msgspec.Meta(gt=0.0, le=1e6)] | None = None
    # time for which all is met before the task is reached
    dwell_s: Annotated[float, msgspec.Meta(ge=0.0, le=1e4)] = 0.5
    together: bool = False  # the task begins when every seat is held; else when somebody takes hold

    @property
    def stated(self) -> bool:
        """Return whether there is anything to be done."""
        return any(goal is not None for goal in (self.lifted_m, self.turned_rad, self.within_m))


def unfit(task: Task, scene: bool) -> str:
    """Return why a task does not fit a room, with or without a scene; "" if it does."""
    if task == Task() or (scene and task.stated):
        return ""
    what = "has no goal" if scene else 'is for object.kind = "scene"'
    return f"[task] {what}; set task.lifted_m, task.turned_rad or task.within_m in a scene, or leave it out"
