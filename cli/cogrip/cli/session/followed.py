"""Recordings of one run folder, followed as they grow; whoever writes them is never slowed."""

from collections.abc import Sequence
from pathlib import Path
from struct import error
from typing import TypeVar

import msgspec
import zstandard

from cogrip.protocol.recording.reader import Follower, RecordingError
from cogrip.protocol.recording.records import Record, Row, Step, Tick
from cogrip.server.recorder import step_topic
from cogrip.sim.runs.folder import SERVER_RECORDING, client_recording

R = TypeVar("R", bound=Record)

AXES = "xyz"


class FollowedRun:
    """The newest messages of the recordings in a run folder; None where there is none yet."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._followers: dict[str, Follower] = {}

    def tick(self, name: str) -> Tick | None:
        """Return the newest tick of a person's client."""
        return self._newest(client_recording(name), f"/{name}/tick", Tick)

    def step(self, room: str) -> Step | None:
        """Return the newest step of a room."""
        return self._newest(SERVER_RECORDING, step_topic(room), Step)

    def _newest(self, file: str, topic: str, kind: type[R]) -> R | None:
        follower = self._followers.get(file)
        try:
            if follower is None:
                follower = self._followers[file] = Follower(self._folder / file)
            message = follower.look().get(topic)
        except (OSError, RecordingError):  # not there yet, not whole yet, or gone
            return None
        except (ValueError, IndexError, zstandard.ZstdError, error):  # a damaged chunk: what came before it stands
            message = follower.newest.get(topic) if follower else None
        return msgspec.json.decode(message.payload, type=kind) if message else None


def components(values: Row | None, scale: float, form: str, names: Sequence[str] = ("",) * 3) -> list[str]:
    """A text an axis, with its sign, behind the axis's name if there are names."""
    return [
        f"{name}{' ' if name else ''}{format(value * scale, form)}"
        for name, value in zip(names, values or (), strict=False)
        if value is not None
    ]
