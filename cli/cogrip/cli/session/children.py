"""Child processes that run cogrip commands on this machine: start, stated reason of the end, end."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import IO

from cogrip.cli.terminal.problem import Problem
from cogrip.machine.platform import system
from cogrip.machine.stop import TETHERED, Stop

START_LIMIT_S = 30.0
END_LIMIT_S = 15.0
_POLL_EVERY_S = 0.02
_STATED = re.compile(
    r"^(?:cogrip: (?P<problem>.+)"
    r"|[^:]+: (?:(?:the session|observing) (?:broke off|is over)(?:, no force is left)?|not a good run): (?P<end>.+)"
    r"|(?P<stopped>stopped \(.+\))|ended: (?P<ended>.+)"
    r"|(?P<defect>[\w.]+(?:Error|Exception|Interrupt)(?:: .+)?))$"
)
"""A line in which a command says why it ended; after a defect it is the last line of the traceback."""


def start_child(log: Path, arguments: Sequence[str], *handles: int) -> subprocess.Popen[bytes]:
    """Start a child in a session of its own: Ctrl-C reaches it through us, so that its last lines are not lost.

    It ends when this process does, however that ends: its standard input is our pipe. handles: that it is to have.
    """
    with log.open("wb") as out:
        return start_tethered(out, arguments, *handles)


def start_tethered(
    out: int | IO[bytes], arguments: Sequence[str], *handles: int, **environ: str
) -> subprocess.Popen[bytes]:
    """Start a child as `start_child` does, with what it says going to `out`, as Popen takes it."""
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "cogrip.cli", *arguments],
        stdin=subprocess.PIPE,
        stdout=out,
        stderr=subprocess.STDOUT,
        env={**os.environ, **environ, TETHERED: "yes"},
        **system.own_session(*handles),
    )


def stated_reason(log: Path) -> str:
    """Return the reason that a child gave for its end, "" where it gave none."""
    return reason_in(log.read_text(encoding="utf-8", errors="replace").splitlines() if log.exists() else [])


def reason_in(lines: Sequence[str]) -> str:
    """Return the last reason for an end in what a command printed, "" where there is none."""
    for line in reversed(lines):
        if line.startswith("{"):  # a server that logs for programs
            try:
                line = str(json.loads(line)["text"])
            except (ValueError, KeyError, TypeError):
                continue
        if found := _STATED.match(line):
            return next(reason for reason in found.groups() if reason)
    return ""


def how_ended(child: subprocess.Popen[bytes], log: Path) -> str:
    """Return the signal that killed a child, or its own reason and exit code."""
    code = child.returncode
    if code < 0:
        try:
            return f"was killed by {signal.Signals(-code).name}"
        except ValueError:
            return f"was killed by signal {-code}"
    reason = stated_reason(log)
    if code == 0:
        return reason or "ended in order"
    return f"{reason or 'gave no reason'} (exit code {code})"


def listening_at(name: str, child: subprocess.Popen[bytes], log: Path, stop: Stop) -> int:
    """Return the port on which a server or relay listens, by its log. Raises Problem where it does not start."""
    until = time.monotonic() + START_LIMIT_S
    while time.monotonic() < until and child.poll() is None and not stop.reason:
        found = re.search(
            r"(?:listening on|relaying from) \S+:(\d+)", log.read_text(encoding="utf-8", errors="replace")
        )
        if found:
            return int(found[1])
        time.sleep(_POLL_EVERY_S)
    if stop.reason:
        raise Problem(f"{stop.reason} before the {name} was up")
    why = f"it is not up after {START_LIMIT_S:g} s" if child.poll() is None else how_ended(child, log)
    raise Problem(f"the {name} did not start: {why} (see {log})")


def end_all(children: Mapping[str, subprocess.Popen[bytes]], terminated: Collection[str]) -> list[str]:
    """Wait for the end of all; ask those in `terminated` to. Return the names of those that did not end well."""
    for name in terminated:
        if children[name].poll() is None:
            system.end(children[name])
    failed = []
    for name, child in children.items():
        try:
            code = child.wait(END_LIMIT_S)
        except subprocess.TimeoutExpired:
            child.kill()
            code = child.wait()
        if child.stdin:
            child.stdin.close()
        if code != 0:
            failed.append(name)
    return failed
