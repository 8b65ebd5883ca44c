"""`cogrip join`: one person, one device, one server; or one who looks on."""

import re
import secrets
import sys
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from cogrip.cli.runs.new_run import live_run_folder
from cogrip.cli.runs.run_files import leave_files
from cogrip.cli.session.before_run import ALLOW, HELD_BY_NOBODY, AllowUnstable, refuse_hardware, tell_implausible
from cogrip.cli.session.live_screen import LiveScreen, may_draw
from cogrip.cli.session.live_views import JoinView
from cogrip.cli.session.observe import look_on
from cogrip.cli.session.settings_file import load
from cogrip.cli.terminal.console import make_console
from cogrip.cli.terminal.flag_errors import above_zero
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.client.io.paths import JoinError, Paths, RefusedError, Server, find
from cogrip.client.loop import Ended, LiveClient
from cogrip.client.rendered_damper import OverloadError
from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.device import Capability, Device, DeviceError
from cogrip.devices.for_user import address_of, make_for
from cogrip.devices.registry import axes_of, make, record_of
from cogrip.devices.replayed.device import ReplayedDevice
from cogrip.protocol.channel import Channel, UnencryptedChannel
from cogrip.protocol.io.stop import Stop, on_signals
from cogrip.protocol.join_link import DEFAULT_PORT, LinkError, is_link, is_secret, parse_link, split_place, unwrapped
from cogrip.protocol.line.delays import expected_frames, one_way
from cogrip.protocol.messages import Hello
from cogrip.protocol.session import IN_ORDER, SECONDS_OVER, ClientSession, make_hello
from cogrip.protocol.settings import SeatSettings, Settings, digest
from cogrip.protocol.version import VERSION
from cogrip.sim.analysis.advice import advise_seat
from cogrip.sim.analysis.plausible import hand_findings
from cogrip.sim.runs.folder import client_recording, write_account
from cogrip.sim.runs.summary import of_client
from cogrip.sim.runs.verdict import succeeded, why_not
from cogrip.sim.session.link import LinkEmulator

DEFAULT_DEVICE = "sim:phantom?hand=reach"
# The settings are the server's, and the model's work goes with the cube of the frames under way: a join must not hang on it.
MOST_ADVISED_FRAMES = {"wave": 96, "coupling": 40, "tdpa": 512}  # of both ways together; each takes about 2 s
MOST_ADVISED_TICKS = 256  # in a frame
USUAL_HZ, LOOKED_AHEAD_S = 1024, 60.0  # how a hand is looked at before a server has said its rate and length
NO_NAME = "this is for looking on: --name has no effect"


def join(
    server: Annotated[str, Parameter(allow_leading_hyphen=True)],
    /,
    *more: Annotated[str, Parameter(show=False)],
    device: str | None = None,
    observe: Annotated[bool, Parameter(negative="")] = False,
    insecure: Annotated[bool, Parameter(negative="")] = False,
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
    quiet: Annotated[bool, Parameter(negative="")] = False,
    allow_unstable: AllowUnstable = False,
) -> int:
    """Take a seat and hold the object until Ctrl-C, SIGTERM, --seconds, the end of a replay, or the server's goodbye.

    A link is all that is needed. An observer's shows the room and needs no device. A server that falls silent is sought
    again for 10 s, without force.
    Exit code 0 when the session ended as it should, passive and stable; 1 when it was refused, lost or broke off, or the
    server ended it.

    Parameters
    ----------
    server
        The join link that the server printed, in quotes: 'cogrip://...'. Or HOST:PORT, or HOST for the usual port, of a
        server that is not sealed. - reads it from standard input, where no other user of this machine sees it.
    device
        Device address (`cogrip devices`), with its keys: sim:phantom?hand=reach&amplitude_m=0.02.
    observe
        Look on: see the object and the hands, hold nothing.
    insecure
        Talk to a HOST:PORT that is not this machine without a seal: everyone on the way can read it, and move your hand.
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
        Of a `replay:` device: where in the recording to end, and with it this session. As its key stop_s=.
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
    quiet
        Show no live table at a terminal, only lines.
    """
    above_zero("--seconds", seconds)
    console = make_console(soft_wrap=True)
    settings = load(config, overrides) if config else None
    if overrides and not config:
        raise BadInput("--set changes the settings of --config; without one they are the server's")
    place = _place(_typed(server, more), room or (settings.name if settings else ""), insecure)
    wanted = Wanted(place, name, digest(settings) if settings else "")
    stop = Stop()
    if observe:
        if device is not None:
            raise BadInput("--observe needs no --device: leave one of them out")
        with on_signals(stop), closing(_calls(place, insecure)) as calls:
            if name:
                console.print(NO_NAME, markup=False)
            return look_on(ClientSession(wanted.to_look_on()), calls, stop, seconds, console)
    named = device is not None
    device = _play_back(device, speed=speed, loop=loop, start_s=start_s, stop_s=stop_s)
    if allow_unstable:
        named_here = [user for user in settings.users if name in ("", user.name)][:1] if settings else []
        refuse_hardware([device or (named_here[0].device if named_here else DEFAULT_DEVICE)])
    arm, address = _device(settings, name, device, axes)
    _check_hand(*_device(settings, name, device, axes), name, seconds)
    rearms = (bool(sys.stdin) and sys.stdin.isatty()) if rearm is None else rearm
    with (
        on_signals(stop),
        closing(_calls(place, insecure)) as calls,
        LiveScreen(partial(console.print, markup=False)) as screen,
    ):
        hello = wanted.to_hold(arm.capability, address)
        say = screen.say
        files = _Files(runs, into, record, screen, drawn=not quiet and may_draw(console))
        client = LiveClient(
            arm, hello, calls, stop, say, LinkEmulator, files.record_at, seconds, rearms,
            partial(_judge, address, allow_unstable, say), partial(_played_out, arm), allow_unstable,
        )  # fmt: skip
        try:
            ended = client.run()
        except OverloadError as error:
            raise BadInput(_refused(str(error), address)) from None
        except RefusedError as error:
            raise BadInput(str(error)) from None
        except (JoinError, DeviceError) as error:
            raise Problem(str(error)) from None
        screen.close()
        if isinstance(ended, ClientSession):
            if named:
                say(f"this link is for looking on: {address} is left alone")
            if name:
                say(NO_NAME)
            return look_on(ended, calls, stop, seconds, console)
        return _finish(ended, files.folder, console, alone=into is None, report=report)


@dataclass(slots=True)
class _Files:
    """Where a session is recorded, and what of it is shown meanwhile. folder: None until it is known, or if there is none."""

    runs: Path
    folder: Path | None
    record: bool
    screen: LiveScreen
    drawn: bool

    def record_at(self, seat: SeatSettings) -> Path | None:
        """Return the recording's file, None if there is to be none; begin to draw what it will hold."""
        say = self.screen.say
        self.folder = self.folder or live_run_folder(self.runs, f"{seat.room}-{seat.user}", say)
        recorded = self.folder is not None and self.record
        if self.drawn and recorded:
            self.screen.draw(JoinView(str(self.folder), seat.room, seat.user))
        elif self.drawn:
            say("no live table without a recording")
        return self.folder / client_recording(seat.user) if self.folder is not None and recorded else None


@dataclass(frozen=True, slots=True)
class Place:
    """What a link or an address says. fingerprint: of the server's certificate, "" where there is no seal."""

    host: str
    port: int
    room: str
    fingerprint: str = ""
    token: str = field(default="", repr=False)

    @property
    def channel(self) -> Callable[[], Channel]:
        if not self.fingerprint:
            return UnencryptedChannel
        from cogrip.protocol.io.dtls_client import DtlsClient  # OpenSSL takes a while

        return lambda: DtlsClient(self.fingerprint)


@dataclass(frozen=True, slots=True)
class Wanted:
    """What to ask the server for."""

    place: Place
    name: str
    digest: str

    def to_hold(self, record: Capability, address: str) -> Hello:
        return make_hello(
            software=VERSION, nonce=_nonce(), room=self.place.room, name=self.name, digest=self.digest, device=address,
            axes=record.axes, rate_hz=float(record.rate_hz), force_n=record.peak_force_n, speed_mps=record.speed_mps,
            token=self.place.token,
        )  # fmt: skip

    def to_look_on(self) -> Hello:
        return make_hello(
            software=VERSION, nonce=_nonce(), room=self.place.room, name=self.name, digest=self.digest, device="none",
            axes=1, rate_hz=1.0, role="observer", token=self.place.token,
        )  # fmt: skip


def _nonce() -> int:
    return secrets.randbelow(2**62) + 1


def _typed(server: str, more: tuple[str, ...]) -> str:
    """What stands for the server, alone; of - the first line of standard input. Raises BadInput, which shows no link."""
    if server.startswith("-") and server != "-":
        option = f" {server}" if re.fullmatch(r"--[a-z]+(-[a-z]+)?", server) and len(server) < 20 else ""
        raise BadInput(f"join: unknown option{option} before the server; `cogrip join --help` lists them")
    if more and (server, more[0]) == ("cogrip", "join"):  # copied with the command before it
        server, *rest = more[1:] or ("",)
        more = tuple(rest)
    if more:
        raise BadInput(
            f"join: one link or HOST:PORT is needed, and {len(more) + 1} words stand there: put the link in quotes"
        )
    if server == "-":
        if not (text := unwrapped(sys.stdin.readline() if sys.stdin else "")):
            raise BadInput(
                "standard input has no join link in its first line; write the link there, or give it for the -"
            )
        return text
    return unwrapped(server)


def _place(server: str, room: str, insecure: bool) -> Place:
    """Where `server` is: a link, or HOST:PORT. Raises BadInput, which shows nothing of what may be secret."""
    link_meant = is_link(server)
    if not link_meant and is_secret(server):
        raise BadInput("server: this is the end of a join link: paste it whole, from cogrip:// on")
    try:
        if link_meant:
            link = parse_link(server)
            if insecure:
                raise BadInput("--insecure is for HOST:PORT; with a link everything is sealed: leave it out")
            if room and link.room and room != link.room:
                raise BadInput(f"room {room!r} is asked for, and the link is for {link.room!r}: leave one of them out")
            return Place(link.host, link.port, room or link.room, link.fingerprint, link.token)
        host, port = split_place(server)
    except LinkError as error:
        words = str(error)
        if link_meant:
            raise BadInput(words) from None
        raise BadInput(
            f"server {words}; write HOST:PORT, such as 127.0.0.1:{DEFAULT_PORT}, or the server's join link"
        ) from None
    return Place(host, DEFAULT_PORT if port is None else port, room)


def _calls(place: Place, insecure: bool) -> Paths:
    """Raises Problem where the server's name is not known, or it would be spoken to in the open."""
    try:
        found: Server = find(place.host, place.port)
    except JoinError as error:
        raise Problem(str(error)) from None
    if not place.fingerprint and not insecure and not found.loopback:
        raise Problem(
            f"{place.host} is not this machine, and without a seal everyone on the way could read the session and move your "
            "hand: use the join link that the server printed (cogrip://...); --insecure does without it"
        )
    return Paths(found, place.channel)


def _finish(ended: Ended, folder: Path | None, console: Console, *, alone: bool, report: bool) -> int:
    if folder is not None:
        with suppress(OSError):  # the server has heard the same; where it has not, the missing part is named
            write_account(folder, ended.seat.user, ended.account)
    summary = of_client(ended.seat, ended.account, ended.farewell, ended.seconds, ended.counts)
    counts = ", ".join(f"{name} {count}" for name, count in sorted(ended.counts.items()) if count)
    if counts:
        console.print(f"{ended.seat.user}: dealt with: {counts}", markup=False)
    user, well = ended.seat.user, succeeded(summary)
    if alone:
        leave_files(folder, summary, console, shown=report or folder is None, report=report)
    if ended.failed:
        console.print(f"{user}: the session broke off, no force is left: {ended.failed}", markup=False)
    elif ended.ended:
        console.print(f"{user}: the session is over, no force is left: {ended.ended}", markup=False)
    if not ended.failed and not well:
        console.print(f"{user}: not a good run: {why_not(summary)}", markup=False)
    cut_short = ended.ended.startswith(IN_ORDER) and SECONDS_OVER not in ended.ended
    return 0 if well and not ended.failed and not cut_short else 1


def _judge(
    address: str, allow_unstable: bool, say: Callable[[str], None], seat: SeatSettings, record: Capability
) -> str:
    """Say where this seat lies outside what is stable, passive or fit for its device, in the words of `cogrip advise`.

    Returns why it is refused, "" if it is not.
    """
    frames = sum(
        one_way(direction.delay_ms, expected_frames(seat.playout, direction, seat.rates), seat.rates).frames
        for direction in (seat.up, seat.down)
    )
    refused: tuple[str, ...] = ()
    if frames > MOST_ADVISED_FRAMES[seat.coupling.kind] or seat.rates.ticks_per_frame > MOST_ADVISED_TICKS:
        warnings: tuple[str, ...] = ("no advice: the delays are too long for the model",)
    else:
        try:
            advice = advise_seat(seat, record)
            warnings, refused = advice.warnings, () if allow_unstable else advice.refusals
        except (ArithmeticError, ValueError) as error:  # ModelError and LinAlgError are ValueErrors
            warnings = (f"no advice: {error}",)
    for text in warnings:
        if text not in refused:
            say(f"warning: {text}")
    return _refused("; ".join(refused), address) if refused else ""


def _played_out(device: Device) -> str:
    """Say that a replay has come to its end, "" while it plays; other devices have none."""
    return "the replay has run out" if isinstance(device, ReplayedDevice) and device.played_out else ""


def _refused(words: str, address: str) -> str:
    """With what the person at the device can do about settings that are the server's."""
    return f"refused: {words}; the settings are the server's{ALLOW if address.startswith(HELD_BY_NOBODY) else ''}"


def _check_hand(device: Device, address: str, name: str, seconds: float | None) -> None:
    """Raises BadInput for a simulated or recorded hand that cannot be meant or played; warns of an unlikely one."""
    if not address.startswith(HELD_BY_NOBODY):
        return
    try:
        rate_hz = min(device.capability.rate_hz, USUAL_HZ)
        found = hand_findings(name or "this hand", address, device, rate_hz, seconds or LOOKED_AHEAD_S)
    except DeviceError as error:
        if isinstance(device, ReplayedDevice):  # at any rate: nothing is in its span, or the recording is damaged
            raise BadInput(str(error)) from None
        return  # the seat's rate may be the one that fits; the session says what is wrong
    tell_implausible(found)


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
            address = address or DEFAULT_DEVICE
            return _ready(make(address, axes=axes or axes_of(address)), address), address
        users = [user for user in settings.users if name in ("", user.name)]
        if not users:
            known = ", ".join(user.name for user in settings.users)
            raise BadInput(f"--name {name!r}: no such user in the settings; there is: {known}")
        axes = axes or settings.object.axes
        if address:
            return _ready(make(address, axes=axes), address), address
        return _ready(make_for(users[0], axes), address_of(users[0])), address_of(users[0])
    except DeviceError as error:
        raise BadInput(str(error)) from None


def _ready(device: Device, address: str) -> Device:
    """`device` once its record is known to be there, and that it may give force. Raises DeviceError."""
    record_of(device, address)
    if isinstance(device, ArmDevice) and device.reads_only:
        raise DeviceError(
            "pose=none opens an arm to read only, so nobody would feel anything: calibrate it, and leave the key out"
        )
    return device
