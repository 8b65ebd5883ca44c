"""The trace of a session, recorded in memory while it runs.

Shapes: k ticks of the session, m frames, n people, a axes. Positions are relative to where each began.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cogrip.machine.addition import add_floats
from cogrip.sim.laboratory import Laboratory

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SessionTrace:
    """One session.

    force_n     (k, n, a)  force on each hand, held over the tick [N]
    position_m  (m, n, a)  each hand at the end of each frame [m]
    view_m      (m, n, a)  the object's position as last reported to each person [m]
    object_m    (m, a)     the object [m]
    work_j      (m,)       work of all hands against the forces on them so far: sum of F (x_{k+1} - x_k) [J]
    object_j    (m,)       energy that reached the object so far: kinetic, and what its own damping took; in a scene what all
                           bodies have got [J]
    sees_object            whether the object is what is reported: to virtual coupling in a scene it is each person's tool
    refilled_j             energy that couplings gave to hands at rest, beyond their credit [J]
    """

    frame_s: float
    force_n: Array
    position_m: Array
    view_m: Array
    object_m: Array
    work_j: Array
    object_j: Array
    sees_object: bool = True
    refilled_j: float = 0.0


_BUCKETS = 250


def sketch(force_n: Array) -> list[list[float]]:
    """Return each person's force on the first axis for a plot: minimum and maximum of each of _BUCKETS stretches; (k, n, a)."""
    if not len(force_n):
        return []
    starts = np.unique(np.linspace(0, len(force_n), _BUCKETS, endpoint=False).astype(np.intp))
    values = force_n[:, :, 0]
    pairs = np.stack((np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)), axis=1)
    rows: list[list[float]] = np.round(pairs.reshape(-1, values.shape[1]).T, 4).tolist()
    return rows


class TraceRecorder:
    """Recorder of a trace: hand `each_tick` and `each_frame` to `Laboratory.run`, then call `trace`."""

    def __init__(self, laboratory: Laboratory, starts_m: Sequence[Sequence[float]]) -> None:
        """starts_m: where each hand begins, shape (n, a)."""
        self._laboratory = laboratory
        self._people = len(laboratory.people)
        self._axes = laboratory.settings.object.axes
        self._forces, self._motion, self._work = array("d"), array("d"), array("d")
        self._gained = array("d")
        self._starts = np.array(starts_m)

    def each_tick(self, laboratory: Laboratory) -> None:
        """Record the forces of a tick."""
        for person in laboratory.people:
            self._forces.extend(person.core.force_n)

    def each_frame(self, laboratory: Laboratory) -> None:
        """Record positions and work at a frame's end."""
        work, axes = 0.0, self._axes
        for person in laboratory.people:
            core = person.core
            work += core.ledger.work_j
            self._motion.extend(core.position_m)
            self._motion.extend(core.coupling.object_state[:axes])
        self._motion.extend(laboratory.room.world.motion())
        self._work.append(work)
        self._gained.append(laboratory.room.world.gained_j)

    def trace(self) -> SessionTrace:
        """Return what was recorded."""
        people, axes, settings = self._people, self._axes, self._laboratory.settings
        world = self._laboratory.room.world
        both = 2 * people * axes
        rows = np.array(self._motion).reshape(-1, both + 2 * axes)
        each = rows[:, :both].reshape(-1, people, 2, axes)
        position, view = each[:, :, 0], each[:, :, 1]
        if settings.coupling.traits.own_frame:
            reported = view.any(axis=2, keepdims=True)  # before, they see it where it began
            view = np.where(reported, view - np.asarray(world.offset), view)
        place, speed = rows[:, both : both + axes], rows[:, both + axes :]
        frame_s = 1.0 / settings.rates.network_hz
        moved = np.diff(place, axis=0, prepend=np.zeros((1, axes)))
        kinetic = 0.5 * world.moving_kg * (speed * speed).sum(axis=1)
        damped = settings.object.damping_nspm / frame_s * np.cumsum((moved * moved).sum(axis=1))
        scene = settings.object.traits.scene
        return SessionTrace(
            frame_s,
            np.array(self._forces).reshape(-1, people, axes),
            position - self._starts,
            view,
            place,
            np.array(self._work),
            np.array(self._gained) if scene else kinetic + damped,
            not (scene and settings.coupling.traits.own_frame),
            add_floats(
                person.core.seated.coupling.refilled_j for person in self._laboratory.people if person.core.seated
            ),
        )
