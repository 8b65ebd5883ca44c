"""`cogrip demo`: a server and its clients as processes of this machine, shown until they end."""

import subprocess
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import msgspec
from cyclopts import Parameter
from rich.console import Console
from rich.live import Live

from cogrip.cli.runs.run_folder import new_run_folder
from cogrip.cli.runs.summary_table import terminal_summary
from cogrip.cli.session.children import end_all, how_ended, listening_at, start_child, stated_reason
from cogrip.cli.session.live_views import LiveTable
from cogrip.cli.session.network_rate import RateChoices, measured, write_choice
from cogrip.cli.session.python_worlds import PythonWorlds, allow_python_worlds
from cogrip.cli.session.view_child import open_view
from cogrip.cli.settings.before_run import AllowUnstable, check_settings, refuse_hardware, tell_scene
from cogrip.cli.settings.settings_file import load, try_hands, with_people
from cogrip.cli.settings.shipped_settings import shipped
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.parameters import Devices, Hands, Overrides, Runs
from cogrip.cli.terminal.problem import BadInput, above_zero
from cogrip.machine.platform import system
from cogrip.machine.stop import Stop, on_signals
from cogrip.protocol.settings.object_kinds import kind_of
from cogrip.protocol.settings.sections import Settings
from cogrip.results.reading.folder import (
    SETTINGS,
    SUMMARY,
    client_log,
    read_accounts,
    told_in_log,
    write_settings,
    write_summary,
)
from cogrip.results.reading.summary_values import task_of
from cogrip.results.report.page import write_report
from cogrip.results.verdict.gates import judge_gates
from cogrip.results.verdict.verdict import succeeded
from cogrip.results.writing.summary import of_accounts

MOVED_M = 0.005  # least travel of an object that counts as moved
WATCH_EVERY_S = 0.1


def demo(
    session: Path | None = None,
    /,
    *,
    config: Path | None = None,
    overrides: Overrides = (),
    hands: Hands = (),
    device: Devices = (),
    seconds: float | None = None,
    view: Annotated[bool, Parameter(negative="")] = False,
    allow_unstable: AllowUnstable = False,
    trial: bool = True,
    python_worlds: PythonWorlds = (),
    runs: Runs = Path("runs"),
) -> int:
    """Two simulated people hold one cube, or what the settings name, over UDP on this machine; ends with a report.

    A server, one client a person, UDP on loopback, an emulated link. Exit code 0 only if the run was passive and stable,
    devices included, nothing broke off, and the object really moved; of a scene, if its task was reached.

    Parameters
    ----------
    session
        Settings file, or the name of one that comes with cogrip (`cogrip configs`): `cogrip demo lift`; demo if not given.
    config
        The same, as an option.
    seconds
        How long; as the settings say if not given.
    view
        Show it in the browser as well.
    trial
        Try the motors of devices that are not simulated before each seat is taken, as `cogrip join` does.
    """
    above_zero("--seconds", seconds)
    if session and config:
        raise BadInput(f"{session} and --config {config}: give one of them")
    allow_python_worlds(python_worlds)
    path = session or config or shipped("demo")
    changes = [*overrides, *([f"seconds={seconds}"] if seconds is not None else [])]
    rates = RateChoices(measured)
    settings = load(path, changes, rate=rates, flags={} if seconds is None else {"seconds": "--seconds"})
    settings = with_people(settings, hands, device)
    if allow_unstable:
        refuse_hardware([user.device for user in settings.users])
    try_hands(settings)
    check_settings(settings, allow_unstable)
    tell_scene(settings)
    console = make_console(soft_wrap=True)
    folder = new_run_folder(runs, settings.name)
    write_choice(folder, rates.found.get(settings.name))
    for text in rates.lines():
        console.print(text, highlight=False)
    stop = Stop()
    with on_signals(stop):
        flags = [*(["--allow-unstable"] if allow_unstable else []), *([] if trial else ["--no-trial"])]
        failed = _watch(settings, folder, stop, console, flags, view=view)
    return _conclude(settings, folder, failed, stop, console)


def _watch(
    settings: Settings, folder: Path, stop: Stop, console: Console, flags: list[str], *, view: bool
) -> dict[str, str]:
    """Start everyone, show them until they end, end the server. Return how those ended that did not end well, by name."""
    write_settings(folder, settings)
    file = folder / SETTINGS
    common = ["--into", str(folder)]
    seconds = ["--seconds", str(settings.seconds + 60)]  # it stops by itself if we are killed
    server = start_child(folder / "server.log", ["serve", str(file), "--port", "0", *seconds, *common])
    clients: dict[str, subprocess.Popen[bytes]] = {}
    failed: dict[str, str] = {}
    shown = ExitStack()
    try:
        port = listening_at("server", server, folder / "server.log", stop)
        open_view(shown, f"127.0.0.1:{port}", console.print, settings.name, insecure=False, wanted=view)
        for user in settings.users:
            log = folder / client_log(user.name)
            who = ["--config", str(file), "--name", user.name]
            seconds = ["--seconds", str(settings.seconds)]
            clients[user.name] = start_child(log, ["join", f"127.0.0.1:{port}", *who, *seconds, *flags, *common])
        table = LiveTable(folder, settings.name, list(clients))
        interrupted = begun = False
        with Live(table.table(), console=console, refresh_per_second=10, transient=False) as live:
            while any(client.poll() is None for client in clients.values()):
                if stop.reason and not interrupted:
                    interrupted = True
                    for client in clients.values():
                        system.interrupt(client)
                if server.poll() is not None:
                    failed["server"] = how_ended(server, folder / "server.log")
                time.sleep(WATCH_EVERY_S)
                live.update(table.table())
                if not begun and table.everyone():
                    begun = True
                    live.console.print(f"everyone holds on, for {settings.seconds:g} s; Ctrl-C ends it; run folder:")
                    live.console.print(str(folder), soft_wrap=True)
        if not console.is_terminal:
            console.print()  # a live table ends its last line on terminals alone
    finally:
        shown.close()
        children = {"server": server, **clients}
        for name in end_all(children, ["server"]):
            failed.setdefault(name, how_ended(children[name], _log(folder, name)))
    return failed


def _log(folder: Path, name: str) -> Path:
    return folder / ("server.log" if name == "server" else client_log(name))


def _conclude(settings: Settings, folder: Path, failed: dict[str, str], stop: Stop, console: Console) -> int:
    summary_file = folder / SUMMARY
    if summary_file.exists():
        summary = msgspec.json.decode(summary_file.read_bytes())
    else:  # the server is gone: the clients' accounts are left
        summary = of_accounts(settings, read_accounts(folder, [user.name for user in settings.users]))
        write_summary(folder, summary)
    if judge_gates(folder, summary):
        write_summary(folder, summary)
    with console.status("writing the report"):
        report = write_report(folder)
    console.print(terminal_summary(summary))
    for user in settings.users:
        log = _log(folder, user.name)
        for line in told_in_log(log):
            console.print(line)
        early = "" if stop.reason or user.name in failed else stated_reason(log)
        if early:
            console.print(f"{user.name}: ended early: {early}")
    for name, how in failed.items():
        console.print(f"{name}: {how}; see {_log(folder, name)}")
    travel = summary["object"]["travel_m"]  # None where the server left no account of the object
    fixed = settings.object.traits.scene or kind_of(settings.object.kind).fixed
    moved = fixed or (travel is not None and travel > MOVED_M)
    reached = (task := task_of(summary)) is None or task.get("reached") is True
    if not moved and travel is not None:
        console.print(f"the object did not really move: {travel * 1e3:.2f} mm")
    console.print(f"report: {report}")
    if stop.reason:
        return 130
    return 0 if succeeded(summary) and moved and reached and not failed else 1
