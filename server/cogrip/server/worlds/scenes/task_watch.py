"""Progress of a task: how far a body has been lifted, turned, carried and tilted since its start (`Task` of the settings)."""

from collections.abc import Sequence
from math import acos, dist
from typing import Any

from cogrip.protocol.laws.rotations import between, inverse, product, turned
from cogrip.protocol.settings.task import EVERYBODY, Task

_AXES = "xyz"
_ROUNDING_S = 1e-9
ADDED = 2  # count of numbers at the end of `save` that earlier versions lack


class TaskWatch:
    """Watches one body, a step a frame, from when somebody has taken hold, or everybody where the task is begun together.

    It is reached once all that is asked for has been met for `dwell_s` on end. What is met at the start is nobody's doing: it
    counts once it has been lost and is met again, or is kept until `by_s`. With dwell_s = 0 the first moment counts, whichever
    it is. Once the task is reached, all stands still.

    lifted_m, tilted_rad  most so far
    turned_rad            about the task's axis so far, whole turns counted
                          (turned and tilted where the task asks for it)
    off_m                 distance from the task's place now
    at_s                  when the task was reached, the first moment from which all was met; None if it is not
    """

    def __init__(self, task: Task, frame_s: float, place_m: Sequence[float], quaternion: Sequence[float]) -> None:
        self.task = task
        self._frame_s = frame_s
        self._start, self._upright = tuple(place_m), tuple(quaternion)
        self._goal = [at + by for at, by in zip(place_m, task.place_m, strict=True)]
        self._orientation: Sequence[float] = self._upright
        self._frames = 0
        self._everybody = False
        self.lifted_m = self.turned_rad = self.tilted_rad = 0.0
        self.off_m = dist(place_m, self._goal)
        self.at_s: float | None = None
        self._met = 0  # frames on end in which all was met
        self._kept = self._all_met()  # since the start

    def frame(self, place_m: Sequence[float], quaternion: Sequence[float], holding: Sequence[bool]) -> list[str]:
        """Enter a frame. holding: who holds a tool. Return what has happened: markers for everybody."""
        before, self._everybody = self._everybody, all(holding)
        happened = [EVERYBODY] if self.task.together and self._everybody and not before else []
        if self.step(place_m, quaternion, self._everybody or (any(holding) and not self.task.together)):
            happened.append("the task is reached")
        return happened

    def step(self, place_m: Sequence[float], quaternion: Sequence[float], held: bool = True) -> bool:
        """Enter where the body is after a frame, and how it is turned; held: the task may begin. True as it is reached."""
        if self.at_s is not None or not (held or self._frames):
            return False
        task = self.task
        self._frames += 1
        self.lifted_m = max(self.lifted_m, place_m[2] - self._start[2])
        self.off_m = dist(place_m, self._goal)
        if task.turned_rad is not None:
            self.turned_rad += between(self._orientation, quaternion)[_AXES.index(task.axis)]
            self._orientation = quaternion
        if task.tilt_rad is not None:
            up = turned(product(quaternion, inverse(self._upright)), (0.0, 0.0, 1.0))
            self.tilted_rad = max(self.tilted_rad, acos(max(-1.0, min(1.0, up[2]))))
        self.at_s = self._judge()
        return self.at_s is not None

    def _judge(self) -> float | None:
        """Return when the task was reached, now that this frame is entered; None if it is not."""
        if not self._all_met():
            self._met, self._kept = 0, False
            return None
        self._met += 1
        task, now_s = self.task, self._frames * self._frame_s
        if self._kept and task.dwell_s:
            return task.by_s if task.by_s is not None and now_s >= task.by_s - _ROUNDING_S else None
        since_s = (self._frames - self._met + 1) * self._frame_s
        in_time = task.by_s is None or since_s <= task.by_s
        return since_s if in_time and now_s - since_s >= task.dwell_s - _ROUNDING_S else None

    def put_back(self) -> None:
        """Begin to judge anew, as the body has been put where it started: what is met there is nobody's doing."""
        self._met, self._kept = 0, True

    def _all_met(self) -> bool:
        return all(met for _, _, met in self._goals().values())

    def _goals(self) -> dict[str, tuple[float, float, bool]]:
        """Return what is asked for, what is there, and whether that will do, by the setting's name."""
        task = self.task
        least = {"lifted_m": (task.lifted_m, self.lifted_m), "turned_rad": (task.turned_rad, abs(self.turned_rad))}
        most = {"within_m": (task.within_m, self.off_m), "tilt_rad": (task.tilt_rad, self.tilted_rad)}
        found = {key: (asked, value, value >= asked) for key, (asked, value) in least.items() if asked is not None}
        return found | {
            key: (asked, value, value <= asked) for key, (asked, value) in most.items() if asked is not None
        }

    def save(self) -> tuple[float, ...]:
        """Return the progress so far."""
        reached_s = -1.0 if self.at_s is None else self.at_s
        judged = float(self._met), float(self._kept)
        return float(self._frames), self.lifted_m, self.turned_rad, self.tilted_rad, self.off_m, reached_s, *judged

    def restore(self, saved: Sequence[float], quaternion: Sequence[float]) -> None:
        """Go on from there, the body being turned so."""
        frames, self.lifted_m, self.turned_rad, self.tilted_rad, self.off_m, reached_s, *judged = saved
        if judged:
            self._met, self._kept = int(judged[0]), bool(judged[1])
        self._frames, self.at_s = int(frames), None if reached_s < 0.0 else reached_s
        self._orientation = quaternion

    def account(self) -> dict[str, Any]:
        """Return the result, as `summary.json` has it."""
        goals = {
            key: {"asked": asked, "value": value, "met": met} for key, (asked, value, met) in self._goals().items()
        }
        return {
            "body": self.task.body or "object",
            "reached": self.at_s is not None,
            "at_s": self.at_s,
            "by_s": self.task.by_s,
            "dwell_s": self.task.dwell_s,
            "goals": goals,
        }
