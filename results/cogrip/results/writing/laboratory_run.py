"""A laboratory session with its recordings in a run folder."""

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cogrip.client.recorder import RecordedClient, client_topics
from cogrip.devices.device import DeviceError
from cogrip.devices.registry import is_real
from cogrip.machine.stop import Stop
from cogrip.protocol.recording.header import Header, versions_here
from cogrip.protocol.recording.sink import Sink
from cogrip.protocol.recording.writer import RecordingWriter
from cogrip.protocol.settings.room import rates_of
from cogrip.protocol.settings.sections import Settings
from cogrip.results.reading.folder import SERVER_RECORDING, client_recording, write_settings, write_summary
from cogrip.results.verdict.gates import judge_gates
from cogrip.results.writing.summary import of_laboratory
from cogrip.server.recorder import WHO, RecordedServer
from cogrip.sim.laboratory import Laboratory, Record, unrecorded

BUFFER_BYTES = 2**20  # buffer of a recording: a laboratory's files need not be on the disk as they grow


@dataclass(frozen=True, slots=True)
class LaboratoryOutcome:
    """A run in virtual time: its summary, what was unstable, saturated or left, in words, and whether it was cut short."""

    summary: dict[str, Any]
    unstable: Sequence[str]
    saturated: Sequence[str]
    left: Sequence[str]
    interrupted: bool


def run_laboratory(
    settings: Settings,
    folder: Path | None = None,
    progress: Callable[[float, float], None] | None = None,
    stop: Stop | None = None,
    begins: Sequence[int] = (),
    over: Callable[[Laboratory], bool] | None = None,
    begin: Callable[[Laboratory], None] = lambda laboratory: None,
) -> LaboratoryOutcome:
    """Run to the end. With a folder, settings, recordings and summary are left there.

    progress: called with (seconds done, seconds in all) now and then. Once `stop` is set, or `over` returns True after a frame,
    the run ends; what was run is kept. begin: called before the first frame. begins: see Laboratory.
    Raises DeviceError for a device or hand that cannot be had.
    """
    for user in settings.users:
        if is_real(user.device):
            raise DeviceError(
                f"{user.name}: {user.device}: is hardware, which no virtual time can hold; take emulated: or sim:"
            )
    with ExitStack() as files:
        record = _recording(settings, folder, files) if folder else unrecorded
        files.enter_context(_uncollected())
        laboratory = Laboratory(settings, record, begins)
        begin(laboratory)
        every = max(1, laboratory.frames // 200)
        ended = False

        def each_frame(lab: Laboratory) -> None:
            nonlocal ended
            ended = over is not None and over(lab)
            if progress and lab.room.steps % every == 0:
                progress(lab.seconds, settings.seconds)

        laboratory.run(None, each_frame, lambda: ended or bool(stop and stop.reason))
        laboratory.close_ledger()
    summary = of_laboratory(laboratory)
    if folder:
        judge_gates(folder, summary)
        write_settings(folder, settings)
        write_summary(folder, summary)
    told = laboratory.unstable, laboratory.saturated, laboratory.left
    return LaboratoryOutcome(summary, *told, bool(stop and stop.reason))


@contextmanager
def _uncollected() -> Iterator[None]:
    """Switch the garbage collector off, as the live loops do: the cores leave no cycles behind, so it would find none."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _recording(settings: Settings, folder: Path, files: ExitStack) -> Record:
    """Return what records in `folder`, by the clock of the laboratory: one seed gives the same bytes every time."""
    device_hz = {user.name: rates_of(settings, user).device_hz for user in settings.users}

    def record(core: RecordedClient | RecordedServer, who: str) -> Sink:
        if isinstance(core, RecordedClient):
            path, role, rate_hz, topics = client_recording(who), "client", device_hz[who], client_topics(who)
        else:
            path, role, rate_hz, topics = (
                SERVER_RECORDING,
                "server",
                settings.rates.network_hz,
                core.topics,
            )
            who = WHO
        header = Header(role, who, core.start, rate_hz, settings.seed, 0, True, versions_here(), topics, settings.name)
        writer = RecordingWriter(files.enter_context((folder / path).open("xb", BUFFER_BYTES)), header, folder)
        files.callback(writer.finish)
        return writer

    return record
