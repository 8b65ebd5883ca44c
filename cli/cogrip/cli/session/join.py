"""`cogrip join`: one person, one device, one server; or one observer."""

import sys
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from cogrip.cli.devices.tried_response import try_before_seat
from cogrip.cli.runs.run_folder import leave_files, live_run_folder
from cogrip.cli.session.front_ends import FoxgloveOrigins
from cogrip.cli.session.join_target import target_of, typed
from cogrip.cli.session.joined_device import (
    DEFAULT_DEVICE,
    check_hand,
    judge_seat,
    make_joined,
    played_out,
    refusal,
    with_hand,
    with_playback,
)  # fmt: skip
from cogrip.cli.session.live_views import JoinView, drawing
from cogrip.cli.session.network_rate import RateChoices, stated
from cogrip.cli.session.observe import counted, observe_room
from cogrip.cli.session.two_arms import as_flags, check_two, join_two
from cogrip.cli.session.view_child import GivenLink, PageOptions, ViewChild, given_link, is_web, open_view
from cogrip.cli.settings.before_run import AllowUnstable, refuse_hardware
from cogrip.cli.settings.settings_file import load
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.parameters import Quiet, Record, Report, Runs
from cogrip.cli.terminal.problem import BadInput, Problem, above_zero
from cogrip.cli.terminal.screen import LiveScreen, may_draw
from cogrip.client.io.paths import JoinError, RefusedError
from cogrip.client.loop import LiveClient, SessionEnded
from cogrip.client.safety.rendered_damper import OverloadError
from cogrip.devices.device import DeviceError
from cogrip.devices.family.web import public
from cogrip.devices.simulated.simulated_device import SimulatedDevice
from cogrip.machine.stop import Stop, on_signals
from cogrip.protocol.settings.digest import digest
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.wire.session import IN_ORDER, SECONDS_OVER, ClientSession
from cogrip.results.reading.folder import client_recording, write_account, write_warnings
from cogrip.results.verdict.verdict import succeeded, why_not
from cogrip.results.writing.summary import of_client
from cogrip.sim.link import LinkEmulator

LACKING = ("recording stopped",)  # counts of what a recording lacks that are its disk's fault
NO_NAME = "an observer has no seat: --name has no effect"


def join(
    server: Annotated[str, Parameter(allow_leading_hyphen=True)],
    /,
    *more: Annotated[str, Parameter(show=False)],
    devices: Annotated[tuple[str, ...], Parameter(name="--device", negative="")] = (),
    observe: Annotated[bool, Parameter(negative="")] = False,
    hand: str = "",
    view: Annotated[bool, Parameter(negative="")] = False,
    browser: bool = True,
    port: int = 0,
    foxglove: Annotated[bool, Parameter(negative="")] = False,
    foxglove_origin: FoxgloveOrigins = (),
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
    resume_s: float | None = None,
    runs: Runs = Path("runs"),
    into: Path | None = None,
    report: Report = True,
    record: Record = True,
    rearm: bool | None = None,
    clutched: Annotated[bool, Parameter(negative="")] = False,
    quiet: Quiet = False,
    allow_unstable: AllowUnstable = False,
    trial: bool = True,
) -> int:
    """Take a seat and hold the object until Ctrl-C, SIGTERM, --seconds, the end of a replay, or the server's goodbye.

    A link is all that is needed. An observer's shows the room and needs no device. To a server that falls silent the
    connection is attempted again for 10 s, without force.
    Exit code 0 when the session ended as it should, passive and stable, with its files; 1 when it was refused, lost or broke
    off, the server ended it, or the disk did not take what it leaves.

    Parameters
    ----------
    server
        The join link that the server printed, in quotes: 'cogrip://...'. Or HOST:PORT, or HOST for the usual port, of a
        server without encryption. - reads it from standard input, where no other user of this machine sees it.
    devices
        Device address (`cogrip devices`), with its keys: sim:phantom?hand=reach&amplitude_m=0.02. web: the pointer of a page
        that is opened in the browser. Twice for two arms of one person, who then has two seats: NAME.1 and NAME.2, else the
        first two free ones.
    hand
        Simulated hand that holds a simulated device, with its keys: reach&amplitude_m=0.02, as the key hand= of --device.
    observe
        Observe: see the object and the hands, hold nothing.
    view
        Show the session in the browser as well.
    browser
        Open the page of --view or of a web: device in the browser; its address is printed in any case.
    port
        Port of that page on 127.0.0.1; a free one if not given.
    foxglove
        Offer the session to Foxglove and Lichtblick, too, from that page: as of `cogrip view`.
    insecure
        Use a HOST:PORT that is not this machine without encryption: everyone on the path can read it, and move your hand.
    name
        Seat to take; the first free one if not given.
    room
        Room to enter; any with a free seat if not given.
    config
        Settings file of the session: the join is refused unless the server's settings are the same. The user called
        --name in it (else the first) gives device and hand.
    overrides
        Override a setting of --config.
    axes
        Count of axes to move on; else as --config says, else 3 (the room uses the first ones it needs).
    speed
        Rate of playback of a `replay:` device, as its key speed=.
    loop
        Repeat the playback of a `replay:` device, as its key loop=1.
    start_s
        Begin of the playback of a `replay:` device in its recording, as its key start_s=.
    stop_s
        End of the playback, and with it of this session, as its key stop_s=.
    seconds
        Leave after this time. A simulated hand that waits for everybody (task.together of --config) counts from when all hold
        on, or from 30 s.
    resume_s
        Give up after so long a silence of the server, 10 s if not given; longer where a server that restarts asks for it.
    into
        Write into this existing folder instead, and leave its report to its owner.
    rearm
        Stay after a fault, without force, until `r` and Enter, or SIGUSR1, re-arms; else a fault ends the session. Yes at a
        terminal, no elsewhere.
    clutched
        Begin with the clutch held: hand and tool move nothing until `c` and Enter engages.
    trial
        Try the motors before the seat is taken, with a few per cent of the peak force for 1.2 s; a wrong sign, swapped axes, a
        gain that is too large and samples that are too late are refused. The recording tells where it is left out.
    """
    above_zero("--seconds", seconds)
    above_zero("--resume-s", resume_s)
    console = make_console(soft_wrap=True)
    rates = RateChoices(stated)
    settings = load(config, overrides, world=False, rate=rates) if config else None
    if overrides and not config:
        raise BadInput("--set changes the settings of --config; without one they are the server's")
    devices = with_hand(devices, hand, settings, name)
    room = room or (settings.name if settings else "")
    typed_target = typed(server, more)
    target = target_of(typed_target, room, insecure, name, _compared(settings, rates, console))
    page = PageOptions(browser, port, foxglove, foxglove_origin)
    page.check(shown=view or (len(devices) == 1 and is_web(devices[0])))
    stop = Stop()
    if observe:
        if devices:
            raise BadInput("--observe needs no --device and no --hand: leave one of them out")
        with on_signals(stop), closing(target.paths(insecure)) as paths, ExitStack() as shown:
            open_view(shown, typed_target, console.print, room, insecure, wanted=view, page=page)
            if name:
                console.print(NO_NAME)
            return observe_room(ClientSession(target.observer()), paths, stop, seconds, console)
    rearms = _at_terminal() if rearm is None else rearm
    if len(devices) > 1:
        check_two(devices, settings, axes, speed, loop, start_s, stop_s)
        flags = as_flags(
            room=room, config=config, set=overrides, axes=axes, runs=runs, into=into, report=report, record=record,
            resume_s=resume_s, rearm=rearms, insecure=insecure, allow_unstable=allow_unstable, browser=browser,
            trial=trial,
        )  # fmt: skip
        shown_by = ["--view", *replace(page, browser=True).flags()] if view else []
        return join_two(typed_target, devices, flags, name, clutched, shown_by, seconds, stop, console)
    device = next(iter(devices), None)
    with ExitStack() as shown:
        named = device is not None
        pointed = is_web(device)
        child = open_view(shown, typed_target, console.print, room, insecure, wanted=view, hand=pointed, page=page)
        device = child.linked(device) if child else device
        device = with_playback(device, speed=speed, loop=loop, start_s=start_s, stop_s=stop_s)
        _refuse_hardware(allow_unstable, settings, name, device)
        arm, held = make_joined(settings, name, device, axes)
        address = public(held)
        warnings = check_hand(lambda: make_joined(settings, name, device, axes), address, name, seconds)
        tried = try_before_seat(held, console.print, wanted=trial)
        with (
            on_signals(stop),
            closing(target.paths(insecure)) as paths,
            LiveScreen(console.print) as screen,
        ):
            say = screen.say

            files = _Files(
                runs,
                into,
                record,
                screen,
                drawn=not quiet and may_draw(console),
                page=child or given_link(device),
                warnings=warnings,
            )
            client = LiveClient(
                arm, target.player(arm.capability, address), paths, stop, say, LinkEmulator, files.record_at, seconds, rearms,
                partial(judge_seat, address, allow_unstable, files.warn), partial(played_out, arm), allow_unstable, clutched,
                None, arm if settings and settings.task.together and isinstance(arm, SimulatedDevice) else None, resume_s,
                tried,
            )  # fmt: skip
            try:
                ended = client.run()
            except OverloadError as error:
                raise BadInput(refusal(str(error), address)) from None
            except RefusedError as error:
                raise BadInput(str(error)) from None
            except (JoinError, DeviceError) as error:
                raise Problem(str(error)) from None
            screen.close()
            if isinstance(ended, ClientSession):
                if named:
                    say(f"this link is for observing: {address} is not used")
                if name:
                    say(NO_NAME)
                return observe_room(ended, paths, stop, seconds, console)
            return _finish(ended, files.folder, warnings, console, alone=into is None, report=report)


def _at_terminal() -> bool:
    """Return whether somebody can type an order."""
    return bool(sys.stdin) and sys.stdin.isatty()


def _compared(settings: Settings | None, rates: RateChoices, console: Console) -> str:
    """Return the digest that the server's settings are to have, "" for any: a rate that the server chooses is not known."""
    if rates.found:
        console.print(
            'note: rates.network_hz = "auto" is the server\'s to choose: its settings are not compared with --config'
        )
    return digest(settings) if settings and not rates.found else ""


def _refuse_hardware(unstable: bool, settings: Settings | None, name: str, device: str | None) -> None:
    """Raise BadInput where the device that would be held is hardware, and may be `unstable`."""
    if not unstable:
        return
    users = [user for user in settings.users if name in ("", user.name)] if settings else []
    refuse_hardware([device or (users[0].device if users else DEFAULT_DEVICE)])


@dataclass(slots=True)
class _Files:
    """Recording of a session, its live table and its page. folder: None until it is known, or if there is none."""

    runs: Path
    folder: Path | None
    record: bool
    screen: LiveScreen
    drawn: bool
    page: ViewChild | GivenLink | None = None
    warnings: list[str] = field(default_factory=list)  # warnings for the report

    def warn(self, text: str) -> None:
        """Say a warning, and keep it."""
        self.warnings.append(text)
        self.screen.say(text)

    def record_at(self, seat: SeatSettings) -> Path | None:
        """Return the recording's file, None if there is to be none; start its live table."""
        say = self.screen.say
        if self.page is not None:
            self.page.seated(seat.seat)
        self.folder = self.folder or live_run_folder(self.runs, f"{seat.room}-{seat.user}", say)
        recorded = self.folder is not None and self.record
        if self.drawn and recorded:
            self.screen.draw(*drawing(JoinView(str(self.folder), seat.room, seat.user)))
        elif self.drawn:
            say("no live table without a recording")
        return self.folder / client_recording(seat.user) if self.folder is not None and recorded else None


def _finish(
    ended: SessionEnded, folder: Path | None, warnings: list[str], console: Console, *, alone: bool, report: bool
) -> int:
    """Leave account, summary and report, print how the session ended, and return the exit code.

    warnings: of before the session. A report has them, and what was dealt with; in a folder of another, by the log there.
    """
    left = folder is not None
    if folder is not None:
        with suppress(OSError):  # the server has it as well; where it has not, the missing part is named
            write_account(folder, ended.seat.user, ended.account)
    summary = of_client(ended.seat, ended.account, ended.farewell, ended.seconds, ended.counts, ended.trial)
    user, well = ended.seat.user, succeeded(summary)
    if counts := counted(ended.counts):
        warnings.append(f"{user}: dealt with: {counts}")
        console.print(warnings[-1])
    if folder is not None and alone:
        with suppress(OSError):
            write_warnings(folder, warnings, user)
    if ended.failed:
        console.print(f"{user}: the session broke off, no force is left: {ended.failed}")
    elif ended.ended:
        console.print(f"{user}: the session is over, no force is left: {ended.ended}")
    if not ended.failed and not well:
        console.print(f"{user}: not a good run: {why_not(summary)}")
    if alone:
        left &= leave_files(folder, summary, console, shown=report or folder is None, report=report)
    if lacking := [name for name in LACKING if ended.counts.get(name)]:
        console.print(f"{user}: the recording that was asked for is not whole: {', '.join(lacking)}")
    cut_short = ended.ended.startswith(IN_ORDER) and SECONDS_OVER not in ended.ended
    return 0 if well and left and not lacking and not ended.failed and not cut_short else 1
