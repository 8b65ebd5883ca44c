"""`dev.py bench soak`: people at a server through a relay, for a long time; who was lost, and what has grown."""

import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec
from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from cogrip.cli.runs.run_folder import new_run_folder
from cogrip.cli.runs.summary_table import terminal_summary
from cogrip.cli.session.children import end_all, how_ended, listening_at, start_child
from cogrip.cli.settings.settings_file import load
from cogrip.cli.settings.shipped_settings import shipped
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.machine.stop import Stop, on_signals
from cogrip.protocol.settings.link_profile import Link
from cogrip.protocol.settings.sections import Settings
from cogrip.results.reading.folder import SETTINGS, SUMMARY, client_log, write_settings

from tests.bench import machine
from tests.bench.loads.process_memory import Growth, family_of, memory_kb

HOST = "127.0.0.1"
LOOK_EVERY_S = 5.0
MARGIN_S = 120.0  # the server and the relay outlast the people by so much at most
MOST_GROWTH_KB_PER_H = 4096.0  # of any process, over the second half
BAD_EVENTS = ("lost", "kicked", "refused", "trouble")
HARMLESS = (
    "cookie sent",
    "not authentic",
    "handshake after its end",
    "said goodbye",
)  # of the drops: every handshake, every leaving makes some


def bench_soak(
    *,
    minutes: float = 30.0,
    config: Path | None = None,
    profile: str = "wifi",
    overrides: Annotated[tuple[str, ...], Parameter(name="--set", negative="")] = ("playout.frames=auto",),
    runs: Path = Path("runs"),
    json: Json = None,
) -> int:
    """Run a server, a relay and one client a person for a long time. Exit code 0 if nobody was lost and nothing has grown.

    Parameters
    ----------
    minutes
        How long.
    config
        Settings file, or a name (`cogrip configs`); three-users if not given. Its [link] is left out: the relay is the network.
    profile
        What the relay does to each direction.
    overrides
        Override a setting: section.key=value. Repeatable.
    runs
        Folder in which the run's own folder is made.
    """
    if sys.platform != "linux":
        raise BadInput("bench soak reads /proc, which only Linux has")
    if not 0.05 <= minutes <= 24 * 60:
        raise BadInput(f"--minutes {minutes:g}: from 0.05 to 1440")
    settings = load(config or shipped("three-users"), overrides)
    settings = msgspec.structs.replace(settings, link=Link(), seconds=minutes * 60.0)
    console = make_console(soft_wrap=True)
    folder = new_run_folder(runs, f"soak-{settings.name}")
    write_settings(folder, settings)
    stop = Stop()
    with on_signals(stop):
        growths, failed = _run(settings, folder, profile, stop, console)
    return _judge(settings, folder, growths, failed, stop, console, json)


def _run(
    settings: Settings, folder: Path, profile: str, stop: Stop, console: Console
) -> tuple[dict[str, Growth], list[str]]:
    """Everyone until they end. Returns the memory of each process over time, and who failed."""
    file, long = str(folder / SETTINGS), str(settings.seconds + MARGIN_S)
    logs = {"server": folder / "server.log", "relay": folder / "relay.log"}
    serve = ["serve", file, "--port", "0", "--seconds", long, "--log", "json", "--into", str(folder)]
    children: dict[str, subprocess.Popen[bytes]] = {"server": start_child(logs["server"], serve)}
    growths: dict[str, Growth] = {}
    failed: list[str] = []
    try:
        port = listening_at("server", children["server"], logs["server"], stop)
        relay = ["relay", "--listen", f"{HOST}:0", "--to", f"{HOST}:{port}", "--profile", profile]
        relay += ["--seed", str(settings.seed), "--seconds", long, "--json", str(folder / "relay.json")]
        children["relay"] = start_child(logs["relay"], relay)
        port = listening_at("relay", children["relay"], logs["relay"], stop)
        for user in settings.users:
            join = ["join", f"{HOST}:{port}", "--config", file, "--name", user.name]
            join += ["--seconds", str(settings.seconds), "--into", str(folder)]
            children[user.name] = start_child(folder / client_log(user.name), join)
        console.print(f"{len(settings.users)} people, {settings.seconds / 60:g} minutes; run folder {folder}")
        people = [children[user.name] for user in settings.users]
        _watch(children, people, growths, stop, console)
        if stop.reason:
            for person in people:
                if person.poll() is None:
                    person.send_signal(signal.SIGINT)
            for person in people:
                person.wait(MARGIN_S)
    finally:
        bad = end_all(children, [name for name in ("server", "relay") if name in children])
        failed = [f"{name}: {how_ended(children[name], logs.get(name) or folder / client_log(name))}" for name in bad]
    return growths, failed


def _watch(
    children: Mapping[str, subprocess.Popen[bytes]],
    people: Sequence[subprocess.Popen[bytes]],
    growths: dict[str, Growth],
    stop: Stop,
    console: Console,
) -> None:
    """Note every process's memory until the people have ended."""
    began = reported = time.monotonic()
    while any(person.poll() is None for person in people) and not stop.reason:
        now = time.monotonic()
        for name, child in children.items():
            for process, role in family_of(child.pid):
                growths.setdefault(f"{name}{role}", Growth()).note(now - began, memory_kb(process))
        if now - reported >= 60.0:
            reported = now
            sizes = ", ".join(f"{name} {growth.last_kb / 1024:.0f}" for name, growth in growths.items())
            console.print(f"{(now - began) / 60:5.1f} min, load {machine.load():.1f}; MiB: {sizes}")
        time.sleep(LOOK_EVERY_S)


def _judge(
    settings: Settings,
    folder: Path,
    growths: Mapping[str, Growth],
    failed: Sequence[str],
    stop: Stop,
    console: Console,
    where: Json,
) -> int:
    if not (folder / SUMMARY).exists():
        raise Problem(
            f"the server left no summary in {folder}: {'; '.join(failed) or stop.reason or 'it gave no reason'}"
        )
    summary = json.loads((folder / SUMMARY).read_text())
    relay = json.loads((folder / "relay.json").read_text()) if (folder / "relay.json").exists() else {}
    events = _events(folder / "server.log")
    console.print(terminal_summary(summary))
    console.print(_memory_table(growths))
    words = {user.name: _dealt_with(folder / client_log(user.name)) for user in settings.users}
    for name, line in words.items():
        console.print(f"{name}: dealt with: {line}", markup=False)
    console.print(f"server dropped: {summary['server']['dropped'] or 'nothing'}; events: {events}", markup=False)
    unfit = {name: count for name, count in summary["server"]["dropped"].items() if name not in HARMLESS}
    reached = {
        "every process ended well": not failed,
        "nobody lost a seat": not any(events.get(event) for event in BAD_EVENTS),
        "nothing dropped": not unfit,
        "everything recorded": not any(
            "not recorded" in line or "recording stopped" in line for line in words.values()
        ),
        "every frame has a name": all(_adds_up(user["link"]) for user in summary["users"]),
        "passive, and not unstable": summary["passive"] and not summary["unstable"],
        "no process has grown": all(each.slope_kb_per_h <= MOST_GROWTH_KB_PER_H for each in growths.values()),
    }
    for how in failed:
        console.print(how, markup=False)
    for what, well in reached.items():
        console.print(f"{what}: {'yes' if well else 'NO'}")
    if where is not None:
        memory = {name: msgspec.to_builtins(growth.summary()) for name, growth in growths.items()}
        answer: dict[str, Any] = {"reached": reached, "memory": memory, "events": events, "relay": relay}
        write_json({**answer, "dealt_with": words, "summary": summary}, where)
    if stop.reason:
        return 130
    return 0 if all(reached.values()) else 1


def _adds_up(link: Mapping[str, Any]) -> bool:
    return bool(link["sent"] == link["applied"] + link["late"] + link["lost"])


def _memory_table(growths: Mapping[str, Growth]) -> Table:
    table = Table(
        "process", "at first MiB", "at half time", "at last", "second half KiB/h", title="memory", title_justify="left"
    )
    for name, growth in growths.items():
        found = growth.summary()
        sizes = [f"{size / 1024:.1f}" for size in (found.first_kb, found.middle_kb, found.last_kb)]
        table.add_row(name, *sizes, f"{found.slope_kb_per_h:+.0f}")
    return table


def _events(log: Path) -> dict[str, int]:
    """Count the server's log lines by event."""
    counts: dict[str, int] = {}
    for line in log.read_text().splitlines():
        try:
            event = str(json.loads(line)["event"])
        except (ValueError, KeyError, TypeError):
            event = "unreadable line"
        counts[event] = counts.get(event, 0) + 1
    return counts


def _dealt_with(log: Path) -> str:
    found = re.search(r": dealt with: (.*)", log.read_text())
    return found[1] if found else "nothing"
