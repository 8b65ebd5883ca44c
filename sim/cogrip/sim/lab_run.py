"""A laboratory session with its traces in a run folder."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cogrip.client import trace_row as client_row
from cogrip.protocol.io.stop import Stop
from cogrip.protocol.io.trace import TraceWriter
from cogrip.protocol.settings import Settings
from cogrip.server import trace_row as room_row
from cogrip.sim.laboratory import Laboratory
from cogrip.sim.run_folder import ROOM_TRACE, client_trace, write_settings, write_summary
from cogrip.sim.summary import of_laboratory


@dataclass(frozen=True, slots=True)
class Outcome:
    """A run in virtual time: its summary, why it diverged ("" if it did not), and whether it was cut short."""

    summary: dict[str, Any]
    diverged: str
    interrupted: bool


def run_laboratory(
    settings: Settings,
    folder: Path | None = None,
    progress: Callable[[float, float], None] | None = None,
    stop: Stop | None = None,
) -> Outcome:
    """Run to the end. With a folder, settings, traces and summary are left there.

    progress: called with (seconds done, seconds in all) now and then. Once `stop` is set the run ends; what was run is
    kept.
    Raises DeviceError for a device or hand that cannot be had.
    """
    laboratory = Laboratory(settings)
    each_tick, close = _tracing(laboratory, folder) if folder else (None, lambda: None)
    every = max(1, laboratory.frames // 200)

    def each_frame(lab: Laboratory) -> None:
        if progress and lab.room.steps % every == 0:
            progress(lab.seconds, settings.seconds)

    try:
        laboratory.run(each_tick, each_frame, lambda: bool(stop and stop.reason))
    finally:
        close()
    summary = of_laboratory(laboratory)
    if folder:
        write_settings(folder, settings)
        write_summary(folder, summary)
    return Outcome(summary, laboratory.diverged, bool(stop and stop.reason))


def _tracing(laboratory: Laboratory, folder: Path) -> tuple[Callable[[Laboratory], None], Callable[[], None]]:
    settings = laboratory.settings
    axes, seconds, device_hz = settings.object.axes, settings.seconds, settings.rates.device_hz
    clients = [
        TraceWriter(
            folder / client_trace(person.name), client_row.columns(axes), rate_hz=device_hz, seconds=seconds,
            who=person.name, start_ns=0,
        )
        for person in laboratory.people
    ]  # fmt: skip
    room = TraceWriter(
        folder / ROOM_TRACE, room_row.columns(axes, len(settings.users)), rate_hz=settings.rates.network_hz,
        seconds=seconds, who=settings.name, start_ns=0,
    )  # fmt: skip
    steps = 0

    def each_tick(lab: Laboratory) -> None:
        nonlocal steps
        time_s = lab.now_ns * 1e-9
        for writer, person in zip(clients, lab.people, strict=True):
            writer.append(client_row.row(person.core, time_s, 0.0, 0.0, 0))
        if lab.room.steps != steps:
            steps = lab.room.steps
            room.append(room_row.row(lab.room, time_s, 0.0, 0.0, 0))

    def close() -> None:
        for writer in (*clients, room):
            writer.close()

    return each_tick, close
