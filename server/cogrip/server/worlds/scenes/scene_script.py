"""Script of a scene: a Python class of one's own that sets controls of actuators and moves mocap bodies, frame by frame.

Settings name it as `object.script = "python:FILE.py:CLASS"`. Its `frame` is called before each step of the room. A mocap body
goes from where it is to where the script puts it in equal parts, one a substep, at most MOST_MPS and MOST_RADPS fast: what is
beyond that it goes in later frames, if the script asks for it again. Its work on what it touches is, as that of actuators, none
of the hands': they get back no more than they put in (`energy_limiter`).
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from math import acos, hypot, isfinite
from pathlib import Path
from typing import Any, ClassVar

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from cogrip.machine.rows import Row
from cogrip.protocol.settings.object_kinds import PYTHON, shared_kind, split_python
from cogrip.protocol.texts import shown
from cogrip.server.worlds.guarded import called
from cogrip.server.worlds.registry import WorldKindError, class_in
from cogrip.server.worlds.scenes.scene_text import listed
from cogrip.server.worlds.world import WorldError, check_saved, dot

Array = NDArray[np.float64]
MOST_MPS = 2.5  # largest speed of a mocap body: at it no contact is found late
MOST_RADPS = 50.0  # largest rate at which a mocap body turns
MOST_KEPT = 10_000  # most numbers that a script keeps


class ScriptedScene:
    """The scene as a script sees and sets it. Bodies, actuators and sensors go by their names."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, sensors: Sequence[str], frame_s: float) -> None:
        self._model, self._data, self._frame_s = model, data, frame_s
        self._sensors = tuple(sensors)
        self.names = {
            "body": [model.body(each).name for each in range(model.nbody)],
            "actuator": [model.actuator(each).name or str(each) for each in range(model.nu)],
        }
        self.slowed = 0  # times that a mocap body was put farther than it may go in a frame
        self.from_place, self.from_turn = data.mocap_pos.copy(), data.mocap_quat.copy()
        self.to_place, self.to_turn = data.mocap_pos.copy(), data.mocap_quat.copy()

    @property
    def time_s(self) -> float:
        """Return the scene's time at the beginning of the frame; 0 where it starts, also anew."""
        return float(self._data.time)

    def place(self, body: str) -> Array:
        """Return where a body is in the world [m]."""
        return np.array(self._data.xpos[self._number("body", body)])

    def orientation(self, body: str) -> Array:
        """Return how a body is turned in the world: a unit quaternion w, x, y, z."""
        return np.array(self._data.xquat[self._number("body", body)])

    def sensor(self, name: str) -> float:
        """Return the newest value of a sensor of the scene; of one with several numbers each has its own name."""
        if name not in self._sensors:
            raise WorldError(f"there is no sensor {shown(name)!r}; there are: {listed(self._sensors) or 'none'}")
        return float(self._data.sensordata[self._sensors.index(name)])

    def set_control(self, actuator: str, value: float) -> None:
        """Set the control of an actuator, from now on. Its ctrlrange bounds it, where it has one."""
        number = self._number("actuator", actuator)
        if not isfinite(value):
            raise WorldError(f"the control of {shown(actuator)!r} is {value}; give a number")
        self._data.ctrl[number] = value

    def put(self, body: str, place_m: Sequence[float], orientation: Sequence[float] | None = None) -> None:
        """Let a mocap body be at a place of the world [m] at the end of the frame, turned so (w, x, y, z) or as it is."""
        number = int(self._model.body_mocapid[self._number("body", body)])
        if number < 0:
            raise WorldError(f'{shown(body)!r} is no mocap body, or a person holds it as a tool; give it mocap="true"')
        place = np.array(place_m, dtype=float)
        turn = np.array(self.from_turn[number] if orientation is None else orientation, dtype=float)
        size = hypot(*turn.tolist()) if turn.shape == (4,) else 0.0
        if place.shape != (3,) or not np.all(np.isfinite(place)) or not 0.5 < size < 2.0:
            raise WorldError(
                f"{shown(body)!r} is put at {place_m}, turned by {orientation}: give three places and a quaternion"
            )
        step, turn = place - self.from_place[number], turn / size
        if dot(turn, self.from_turn[number]) < 0.0:
            turn = -turn  # the shorter way
        distance, most = hypot(*step.tolist()), MOST_MPS * self._frame_s
        angle = 2.0 * acos(min(1.0, max(0.0, dot(turn, self.from_turn[number]))))
        if distance > most or angle > MOST_RADPS * self._frame_s:
            self.slowed += 1
            share = min(
                most / distance if distance > most else 1.0, MOST_RADPS * self._frame_s / angle if angle else 1.0
            )
            share = min(share, 1.0)
            step = share * step
            turn = (1.0 - share) * self.from_turn[number] + share * turn
            turn /= hypot(*turn.tolist())
        self.to_place[number], self.to_turn[number] = self.from_place[number] + step, turn

    def begin(self) -> None:
        """Take the present places of mocap bodies as those from which they go, and where they stay."""
        self.from_place, self.from_turn = self._data.mocap_pos.copy(), self._data.mocap_quat.copy()
        self.to_place, self.to_turn = self.from_place.copy(), self.from_turn.copy()

    def move(self, share: float) -> None:
        """Put mocap bodies this share of their way."""
        data = self._data
        data.mocap_pos[:] = self.from_place + share * (self.to_place - self.from_place)
        turned = self.from_turn + share * (self.to_turn - self.from_turn)
        data.mocap_quat[:] = turned / np.sqrt(np.add.reduce(turned * turned, axis=1))[:, None]

    def _number(self, kind: str, name: str) -> int:
        names = self.names[kind]
        if name not in names:
            raise WorldError(
                f"there is no {kind} {shown(name)!r}; there are: {listed([each for each in names if each])}"
            )
        return names.index(name)


class SceneScript(ABC):
    """Base of a script. kept: names of its attributes, numbers or arrays of one shape, that hold what changes."""

    kept: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def frame(self, scene: ScriptedScene) -> None:
        """Set controls and places for the next frame. The same inputs give the same bits: no clock, no unseeded chance."""


class RunningScript:
    """A script at work in a scene. name: as in the settings, for errors; time_limit: as that of a guarded world."""

    def __init__(self, make: Callable[[], SceneScript], name: str) -> None:
        self._name = name
        self.time_limit: Callable[[], AbstractContextManager[None]] = nullcontext
        with called(name, "its constructor", self.time_limit):
            self._script = make()
            self._start = self.save()

    def frame(self, scene: ScriptedScene) -> None:
        """Call the script. Raises WorldError, whatever it raises."""
        scene.begin()
        with called(self._name, "frame", self.time_limit):
            self._script.frame(scene)
            self.save()

    def save(self) -> Row:
        """Return the numbers that the script keeps."""
        parts = [np.ravel(np.asarray(value, dtype=float)).tolist() for value in self._values().values()]
        row = tuple(each for part in parts for each in part)
        if len(row) > MOST_KEPT or not all(map(isfinite, row)):
            raise WorldError(f"keeps {len(row)} numbers, at most {MOST_KEPT} and finite ones are saved")
        return row

    @property
    def numbers(self) -> int:
        return len(self._start)

    def restore(self, saved: Row) -> None:
        """Go on from saved numbers."""
        check_saved(saved, len(self._start))
        left = list(saved)
        for name, value in self._values().items():
            size = int(np.size(value))
            part, left = left[:size], left[size:]
            shape = np.shape(value)
            setattr(self._script, name, np.array(part).reshape(shape) if shape else type(value)(part[0]))

    def reset(self) -> None:
        """Begin anew."""
        self.restore(self._start)

    def _values(self) -> dict[str, Any]:
        return {name: getattr(self._script, name) for name in type(self._script).kept}


def script_of(name: str) -> tuple[RunningScript, str]:
    """Return the script of a scene, ready to run, and what says which code it is. Raises WorldKindError, WorldError."""
    file, class_name = split_python(name)
    if not (name.startswith(PYTHON) and file.endswith(".py") and class_name.isidentifier()):
        raise WorldKindError(f'object.script = "{name}": write "{PYTHON}FILE.py:CLASS"')
    found, digest = class_in(Path(file), class_name, "object.script")
    if not (isinstance(found, type) and issubclass(found, SceneScript)):
        raise WorldKindError(
            f"object.script: {name} is no script; derive it from cogrip.server.worlds.scenes.scene_script.SceneScript"
        )
    return RunningScript(found, shared_kind(name)), digest
