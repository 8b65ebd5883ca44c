"""What a running session looks like from outside: its recordings followed ten times a second, as a table."""

from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import msgspec
from rich.box import SIMPLE_HEAD
from rich.table import Table

from cogrip.cli.shown_reserves import HEADING_NOW, reserves_now
from cogrip.protocol.recording.reader import Follower, RecordingError
from cogrip.protocol.recording.records import Record, Row, Step, Tick
from cogrip.server.recorded import step_topic
from cogrip.sim.run_folder import SERVER_RECORDING, client_recording

R = TypeVar("R", bound=Record)

_HEADINGS = (
    "person",
    "state",
    "hand\nmm",
    "force\nN",
    "round trip\nms",
    "up, down\nms",
    "lost\nframes",
    "late\nticks",
    HEADING_NOW,
)


class LiveTable:
    """Reads the recordings of one run folder as they grow; never slows those who write them."""

    def __init__(self, folder: Path, room: str, people: Sequence[str]) -> None:
        self._folder = folder
        self._room = room
        self._people = people
        self._followers: dict[str, Follower] = {}

    def _newest(self, file: str, topic: str, kind: type[R]) -> R | None:
        follower = self._followers.get(file)
        try:
            if follower is None:
                follower = self._followers[file] = Follower(self._folder / file)
            message = follower.look().get(topic)
        except (OSError, RecordingError):  # not there yet, not whole yet, or gone
            return None
        return msgspec.json.decode(message.payload, type=kind) if message else None

    def _tick(self, name: str) -> Tick | None:
        return self._newest(client_recording(name), f"/{name}/tick", Tick)

    def everyone(self) -> bool:
        """True once every person's client has begun."""
        return all(self._tick(name) for name in self._people)

    def table(self) -> Table:
        """One row a person."""
        step = self._newest(SERVER_RECORDING, step_topic(self._room), Step)
        place = _vector(step.object_m, 1e3, "+6.1f") if step else ""
        table = Table(title=f"object at {place or 'rest'} mm", title_justify="left", box=SIMPLE_HEAD)
        for heading in _HEADINGS:
            table.add_column(heading, justify="left" if heading in ("person", "state") else "right")
        for number, name in enumerate(self._people):
            tick = self._tick(name)
            if tick is None:
                table.add_row(name, "joining", *[""] * 7)
                continue
            seat = step.seats[number] if step else None
            lost = tick.lost + (seat.lost if seat else 0)
            table.add_row(
                name,
                tick.state,
                _vector(tick.position_m or (), 1e3, "+6.1f"),
                _vector(tick.force_n, 1.0, "+5.2f"),
                "" if tick.rtt_ms is None else f"{tick.rtt_ms:.1f}",
                " ".join(f"{way:.1f}" for way in (tick.up_ms, tick.down_ms) if way is not None),
                f"{lost}",
                f"{tick.skipped}",
                reserves_now(tick, seat),
            )
        return table


def _vector(values: Row, scale: float, form: str) -> str:
    return " ".join(format(value * scale, form) for value in values if value is not None)
