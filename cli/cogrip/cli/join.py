"""`cogrip join`: one person, one device, one server."""

import secrets
import sys
from contextlib import suppress
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from cogrip.cli.leave_files import leave_files
from cogrip.cli.new_run import live_run_folder
from cogrip.cli.problem import BadInput, Problem
from cogrip.cli.serve import DEFAULT_PORT
from cogrip.cli.settings_file import load
from cogrip.client.loop import Ended, JoinError, LiveClient
from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.device import Capability, Device, DeviceError
from cogrip.devices.for_user import address_of, make_for
from cogrip.devices.registry import axes_of, make
from cogrip.protocol.io.stop import Stop, on_signals
from cogrip.protocol.session import make_hello
from cogrip.protocol.settings import SeatSettings, Settings, digest
from cogrip.protocol.version import VERSION
from cogrip.sim.analysis.advice import advise_seat
from cogrip.sim.analysis.linear_session import ModelError
from cogrip.sim.link import LinkEmulator
from cogrip.sim.run_folder import client_recording, write_account
from cogrip.sim.summary import of_client

DEFAULT_DEVICE = "sim:phantom?hand=reach"


def join(
    server: str,
    /,
    *,
    device: str | None = None,
    name: str = "",
    room: str = "",
    config: Path | None = None,
    overrides: Annotated[tuple[str, ...], Parameter(name="--set", negative="")] = (),
    axes: int | None = None,
    speed: float | None = None,
    loop: bool | None = None,
    start_s: float | None = None,
    stop_s: float | None = None,
    seconds: float | None = None,
    runs: Path = Path("runs"),
    into: Path | None = None,
    report: bool = True,
    record: bool = True,
    rearm: bool | None = None,
) -> int:
    """Take a seat and hold the object until Ctrl-C, SIGTERM, --seconds, or the server's goodbye.

    Exit code 0 when the session ended as it should and was passive; 1 when it was refused, lost or broke off.

    Parameters
    ----------
    server
        HOST:PORT, or HOST for the usual port.
    device
        Device address (`cogrip devices`), with its keys: sim:phantom?hand=reach&amplitude_m=0.02.
    name
        Which seat to take; the first free one if not given.
    room
        Which room to enter; any with a free seat if not given.
    config
        Settings file of the session: the join is refused unless the server's settings are the same. The user called
        --name in it (else the first) says which device and hand.
    overrides
        Override a setting of --config.
    axes
        How many axes to move on; else what --config says, else 3 (the room uses the first ones it needs).
    speed
        Of a `replay:` device: how fast it plays back. As its key speed=.
    loop
        Of a `replay:` device: play again from the start. As its key loop=1.
    start_s
        Of a `replay:` device: where in the recording to begin. As its key start_s=.
    stop_s
        Of a `replay:` device: where in the recording to end. As its key stop_s=.
    seconds
        Leave by yourself after so long.
    runs
        Folder in which the run folder is made.
    into
        Write into this existing folder instead, and leave its report to its owner.
    report
        Write report.html and plots at the end.
    record
        Record the session; every replay, report and verification needs it.
    rearm
        Stay after a fault, without force, until `r` and Enter, or SIGUSR1, re-arms; else a fault ends the session. Yes at a
        terminal, no elsewhere.
    """
    console = Console(highlight=False, soft_wrap=True)
    settings = load(config, overrides) if config else None
    if overrides and not config:
        raise BadInput("--set changes the settings of --config; without one they are the server's")
    where = _address(server)
    device = _play_back(device, speed=speed, loop=loop, start_s=start_s, stop_s=stop_s)
    arm, address = _device(settings, name, device, axes)
    hello = make_hello(
        software=VERSION, nonce=secrets.randbelow(2**62) + 1, room=room or (settings.name if settings else ""),
        name=name, digest=digest(settings) if settings else "", device=address, axes=arm.capability.axes,
        rate_hz=float(arm.capability.rate_hz),
    )  # fmt: skip
    folder: Path | None = into

    def record_at(seat: SeatSettings) -> Path | None:
        nonlocal folder
        _warn(seat, arm.capability, console)
        folder = folder or live_run_folder(runs, f"{seat.room}-{seat.user}", console.print)
        return folder / client_recording(seat.user) if folder and record else None

    stop = Stop()
    rearms = (bool(sys.stdin) and sys.stdin.isatty()) if rearm is None else rearm
    client = LiveClient(arm, hello, where, stop, console.print, LinkEmulator, record_at, seconds, rearms)
    with on_signals(stop):
        try:
            ended = client.run()
        except (JoinError, DeviceError) as error:
            raise Problem(str(error)) from None
        return _finish(ended, folder, console, alone=into is None, report=report)


def _finish(ended: Ended, folder: Path | None, console: Console, *, alone: bool, report: bool) -> int:
    if folder is not None:
        with suppress(OSError):  # the server has heard the same; where it has not, the missing part is named
            write_account(folder, ended.seat.user, ended.account)
    summary = of_client(ended.seat, ended.account, ended.farewell, ended.seconds, ended.counts)
    counts = ", ".join(f"{name} {count}" for name, count in sorted(ended.counts.items()) if count)
    if counts:
        console.print(f"{ended.seat.user}: dealt with: {counts}", markup=False)
    if ended.failed:
        console.print(f"{ended.seat.user}: the session broke off, no force is left: {ended.failed}")
    if alone:
        leave_files(folder, summary, console, shown=report or folder is None, report=report)
    return 0 if not ended.failed and summary["passive"] and not summary["diverged"] else 1


def _warn(seat: SeatSettings, record: Capability, console: Console) -> None:
    """Say where this seat lies outside what is stable, passive or fit for its device, in the words of `cogrip advise`."""
    try:
        warnings = advise_seat(seat, record).warnings
    except ModelError as error:
        warnings = (f"no advice: {error}",)
    for text in warnings:
        console.print(f"warning: {text}", markup=False)


def _address(text: str) -> tuple[str, int]:
    host, colon, port = text.rpartition(":")
    if not colon:
        return text, DEFAULT_PORT
    if not port.isdigit() or not 0 < int(port) < 65536 or not host:
        raise BadInput(
            f"server {text!r}: write HOST:PORT with a port from 1 to 65535, such as 127.0.0.1:{DEFAULT_PORT}"
        )
    return host.strip("[]"), int(port)


def _play_back(device: str | None, **options: float | None) -> str | None:
    """A replay's address with the options in it."""
    keys = "&".join(f"{key}={value:g}" for key, value in options.items() if value is not None)
    if not keys:
        return device
    if device is None or not device.startswith("replay:"):
        raise BadInput(f"{keys.partition('=')[0]}: is for a replay; name one, such as --device 'replay:RUN#user=0'")
    return f"{device}{'&' if '#' in device or '?' in device else '#'}{keys}"


def _device(settings: Settings | None, name: str, address: str | None, axes: int | None) -> tuple[Device, str]:
    try:
        if settings is None:
            return _ready(make(address or DEFAULT_DEVICE, axes=axes or axes_of(address or DEFAULT_DEVICE))), (
                address or DEFAULT_DEVICE
            )
        users = [user for user in settings.users if name in ("", user.name)]
        if not users:
            known = ", ".join(user.name for user in settings.users)
            raise BadInput(f"--name {name!r}: no such user in the settings; there is: {known}")
        axes = axes or settings.object.axes
        if address:
            return _ready(make(address, axes=axes)), address
        return _ready(make_for(users[0], axes)), address_of(users[0])
    except DeviceError as error:
        raise BadInput(str(error)) from None


def _ready(device: Device) -> Device:
    """`device` once its record is known to be there, and that it may give force. Raises DeviceError."""
    _ = device.capability
    if isinstance(device, ArmDevice) and device.reads_only:
        raise DeviceError(
            "pose=none opens an arm to read only, so nobody would feel anything: calibrate it, and leave the key out"
        )
    return device
