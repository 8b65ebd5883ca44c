"""Columns of one run on one clock, as measures take them: the object and what people do with it, a row a frame or a tick.

symbols: n frames of the room, N ticks of one person, a axes (at most three: places)
Time 0 is the first tick of the last person who came: from then on everybody is there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cogrip.protocol.axes import PLACES
from cogrip.protocol.recording.reader import RecordingError
from cogrip.protocol.settings.object_kinds import kind_of
from cogrip.results.measures.goal import NO_GOAL, Goal, GoalWatch, course
from cogrip.results.reading.records import End, RunRecords, open_run
from cogrip.server.recorder import step_topic

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PersonColumns:
    """One person: hand and force on it, a row a tick, shapes (N,) and (N, a); and their pull on the object, (n, a) [N].

    start_m: place of the hand at the run's beginning, (a,); None of columns that begin there.
    """

    name: str
    rate_hz: int
    time_s: Array
    position_m: Array
    force_n: Array
    pull_n: Array
    start_m: Array | None = None


@dataclass(frozen=True)
class RunColumns:
    """A whole run. object_m (n, a): from where it starts. wall_m (a,): place of an object that is fixed, None of another.

    springs: whether a spring stands between each hand and the object; task_s: when the task of a scene was reached, None if it
    was not. markers: time [s] and text of each.
    """

    rate_hz: int
    time_s: Array
    object_m: Array
    people: Sequence[PersonColumns]
    goal: Goal = NO_GOAL
    task_s: float | None = None
    wall_m: Array | None = None
    springs: bool = True
    markers: Sequence[tuple[float, str]] = ()

    @cached_property
    def reached_s(self) -> float | None:
        """Return when the goal was reached, or without one the task; None if neither was."""
        if not self.goal.stated:
            return self.task_s
        watch = GoalWatch(self.goal)
        next(
            (None for time_s, place in zip(self.time_s, self.object_m, strict=True) if watch.look(time_s, place)), None
        )
        return watch.reached_s

    @cached_property
    def course_m(self) -> Array | None:
        """Return where the object is to be, (n, a), None where no course is given."""
        if not self.goal.track:
            return None
        return np.array(course(self.goal.track, self.object_m.shape[1], self.time_s.tolist()))

    def part(self, begin_s: float, end_s: float) -> "RunColumns":
        """Return what was from begin_s on and before end_s, on the same clock; without the run's goal, but for its course."""
        kept = _between(self.time_s, begin_s, end_s)
        people = [
            replace(
                each,
                **{name: getattr(each, name)[ticks] for name in ("time_s", "position_m", "force_n")},
                pull_n=each.pull_n[kept],
                start_m=each.position_m[0] if each.start_m is None else each.start_m,
            )
            for each in self.people
            for ticks in [_between(each.time_s, begin_s, end_s)]
        ]
        return replace(
            self, time_s=self.time_s[kept], object_m=self.object_m[kept], people=people, task_s=None,
            goal=Goal(track=self.goal.track),
        )  # fmt: skip


def _between(time_s: Array, begin_s: float, end_s: float) -> NDArray[np.bool_]:
    kept: NDArray[np.bool_] = (time_s >= begin_s - 1e-9) & (time_s < end_s - 1e-9)
    return kept


def read_columns(
    folder: Any, goal: Goal = NO_GOAL, task_s: float | None = None, marker: str = "", until: str = ""
) -> RunColumns:
    """Return the columns of a run folder. marker: at which time 0 is, "" for the usual one.

    until: marker with which they end, where there is one: clients leave a live session some tenths of a second later.
    Raises RecordingError, or FileNotFoundError, where a part of it is missing.
    """
    run: RunRecords = open_run(folder)
    if run.server is None:
        raise RecordingError(f"{folder} holds no recording of the server; measures of a study need it")
    names = run.names()
    missing = [name for name in names if name not in run.clients]
    if missing:
        raise RecordingError(f"{folder} holds no recording of {', '.join(missing)}; measures need everybody's")
    pulls = [f"{number}.force_n" for number in range(len(names))]
    steps = _numbered(run.server, step_topic(run.room()), ("object_m", *pulls))
    ticks = {name: run.clients[name].columns("tick", "tick", "position_m", "force_n") for name in names}
    if absent := [name for name in names if not len(ticks[name]["time_s"])]:
        raise RecordingError(f"{folder} has no tick of {', '.join(absent)}, who did not hold on; leave its trial out")
    begin_s = max(float(each["time_s"][0]) for each in ticks.values())
    markers = run.markers()
    if marker:
        marked_s = next((time_s for time_s, text in markers if text == marker), None)
        if marked_s is None:
            raise RecordingError(f"{folder} has no marker {marker!r}, with which its trial began; leave its trial out")
        begin_s = max(begin_s, marked_s)
    end_s = next((time_s for time_s, text in markers if until and text == until and time_s > begin_s), inf)
    from_s = _between(steps["time_s"], begin_s, end_s)
    if not from_s.any():
        raise RecordingError(f"{folder} has no moment at which everybody was there; leave its trial out")
    objects = steps["object_m"][from_s][:, :PLACES]
    people = [
        _person(run.clients[name], ticks[name], steps[f"{number}.force_n"][from_s], begin_s, end_s)
        for number, name in enumerate(names)
    ]
    settings = run.settings()
    kind = kind_of(settings.object.kind) if settings else None
    return RunColumns(
        run.server.rate_hz, steps["time_s"][from_s] - begin_s, objects - objects[0], people, goal, task_s,
        objects[0] if kind and kind.fixed else None, bool(kind and kind.plain),
        [(time_s - begin_s, text) for time_s, text in markers],
    )  # fmt: skip


def _numbered(end: End, topic: str, names: Sequence[str]) -> dict[str, Array]:
    parts = list(end.parts(topic, *names, numbered=True))
    if not parts:
        raise RecordingError(f"{end.path} has no step of the room; leave its trial out")
    return {name: np.concatenate([part[name] for part in parts]) for name in ("time_s", *names)}


def _person(end: End, ticks: dict[str, Array], pull: Array, begin_s: float, end_s: float = inf) -> PersonColumns:
    """Return one person's columns: a row for each tick that was due, from the first sample to the last one before the end.

    A tick may not have been run, recorded, or have had a sample; left out, a hand that moves on would jump there. Places are
    interpolated, and the force is held as the device held it.
    """
    mine = _between(ticks["time_s"], begin_s, end_s)
    number, position = ticks["tick"][mine], ticks["position_m"][mine][:, :PLACES]
    known = np.isfinite(position).all(axis=1)
    if not known.any():
        raise RecordingError(f"{end.path} has no sample of {end.who}'s hand; leave its trial out")
    due = np.arange(number[known][0], number[known][-1] + 1)
    place = np.stack([np.interp(due, number[known], column[known]) for column in position.T], axis=1)
    force = np.nan_to_num(ticks["force_n"][mine][:, :PLACES])[np.searchsorted(number, due, "right") - 1]
    time_s = np.interp(due, number, ticks["time_s"][mine] - begin_s)
    return PersonColumns(end.who, end.rate_hz, time_s, place, force, np.nan_to_num(pull[:, :PLACES]))
