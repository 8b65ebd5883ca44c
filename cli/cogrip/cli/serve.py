"""`cogrip serve`: the shared object, for whoever joins."""

from collections.abc import Sequence
from ipaddress import ip_address
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from cogrip.cli.leave_files import leave_files
from cogrip.cli.new_run import live_run_folder
from cogrip.cli.problem import BadInput, Problem
from cogrip.cli.settings_file import load
from cogrip.devices.device import DeviceError
from cogrip.protocol.channel import PlainChannel
from cogrip.protocol.io.stop import Stop, on_signals
from cogrip.protocol.settings import Settings
from cogrip.server.loop import LiveServer, ServeError
from cogrip.sim.analysis.advice import advise
from cogrip.sim.analysis.linear_session import ModelError
from cogrip.sim.run_folder import SERVER_RECORDING, write_settings
from cogrip.sim.summary import of_room

DEFAULT_PORT = 47800


def serve(
    *config: Path,
    host: str = "127.0.0.1",
    port: int = DEFAULT_PORT,
    overrides: Annotated[tuple[str, ...], Parameter(name="--set", negative="")] = (),
    seconds: float | None = None,
    runs: Path = Path("runs"),
    into: Path | None = None,
    report: bool = True,
    record: bool = True,
) -> int:
    """Serve until Ctrl-C or SIGTERM; then say goodbye to everyone and leave a run folder.

    Parameters
    ----------
    config
        Settings files, one for each room; a room is called by its `name`.
    host
        Address to listen on. Anything but loopback is open to whoever can reach it: sessions are not sealed yet.
    port
        UDP port; 0 takes a free one.
    overrides
        Override a setting in every file: section.key=value. Repeatable.
    seconds
        Stop by yourself after so long.
    runs
        Folder in which the run folder is made; of several rooms each has a folder in it.
    into
        Write into this existing folder instead, and leave its report to its owner (one room only).
    report
        Write report.html and plots at the end.
    record
        Record the session; every replay, report and verification needs it.
    """
    console = Console(highlight=False, soft_wrap=True)
    rooms = _rooms(config, overrides, port, into)
    names = [room.name for room in rooms]
    stop = Stop()
    server = LiveServer(
        rooms, host, port, stop, lambda happening: console.print(happening.text, markup=False),
        lambda core: PlainChannel(), seconds=seconds,
    )  # fmt: skip
    try:
        bound = server.listen()
    except ServeError as error:
        raise Problem(str(error)) from None
    folder = into or live_run_folder(runs, names[0] if len(names) == 1 else "rooms", console.print)
    folders: dict[str, Path] = {}
    if folder is not None:
        server.record_at = folder / SERVER_RECORDING if record else None
        folders = {name: folder if len(names) == 1 else folder / name for name in names}
        try:
            for settings in rooms:
                write_settings(folders[settings.name], settings)
        except OSError as error:  # the session goes on; whether it can be recorded is said on its own
            console.print(f"warning: {folder}: {error.strerror}; no settings are left there")
    with on_signals(stop):
        if not ip_address(bound[0]).is_loopback:
            console.print(
                f"warning: {bound[0]} is open to whoever can reach it, and sessions are not sealed: anyone may join"
            )
        for settings in rooms:
            _warn(settings, console)
        console.print(f"listening on {bound[0]}:{bound[1]}; rooms: {', '.join(names)}; Ctrl-C ends")
        server.run()
        console.print(f"stopped: {stop.reason}")
        passive = True
        for room in server.core.rooms:
            summary = of_room(room, server.elapsed_s, {**server.drops(), **server.losses()})
            passive = passive and bool(summary["passive"]) and not summary["diverged"]
            leave_files(folders.get(room.name), summary, console, shown=into is None, report=into is None and report)
    return 0 if passive else 1


def _rooms(config: Sequence[Path], overrides: Sequence[str], port: int, into: Path | None) -> list[Settings]:
    if not config:
        raise BadInput("serve: name at least one settings file, such as configs/demo.toml")
    if not 0 <= port <= 65535:
        raise BadInput(f"--port {port} is outside 0 to 65535")
    rooms = [load(path, overrides) for path in config]
    names = [room.name for room in rooms]
    for name in names:
        if names.count(name) > 1:
            raise BadInput(f"serve: two rooms are called {name!r}; give each file a `name` of its own")
    if into is not None and len(rooms) > 1:
        raise BadInput("serve: --into takes one room; leave it out to get a folder")
    return rooms


def _warn(settings: Settings, console: Console) -> None:
    """Say where a room lies outside what is stable, passive or fit for its devices, in the words of `cogrip advise`."""
    try:
        warnings = advise(settings).warnings
    except (ModelError, DeviceError) as error:
        warnings = (f"no advice: {error}",)
    for text in warnings:
        console.print(f"warning: room {settings.name}: {text}", markup=False)
