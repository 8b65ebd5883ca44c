"""Commands of the client side, run by Windows' Python under Wine, beside the same on this system."""

import csv
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.free_ports import free_port

LIMIT_S = 240.0  # longest time of one command: a first one under Wine takes tens of seconds
START_S = 60.0
LINK = re.compile(r"cogrip://\S+?(?=')")
BY_MACHINE = {"speed", "seconds_taken", "form", "software"}  # keys of a summary that are of the machine
STUDY = """name = "wine"
seed = 3
participants = [["P01"]]
[session]
seconds = 1.0
[[session.users]]
name = "anna"
hand = "reach"
[conditions.near]
link.delay_ms = 0
[conditions.far]
link.delay_ms = 40
[[blocks]]
name = "all"
"""


class CheckError(AssertionError):
    """A command that did not do what it does on Linux. The text says what."""


@dataclass(frozen=True)
class Wine:
    """Windows' Python, a folder to work in, and the Wine prefix."""

    python: Path
    folder: Path
    prefix: Path

    @property
    def environ(self) -> Mapping[str, str]:
        own = {"WINEPREFIX": str(self.prefix), "WINEDEBUG": "-all", "PYTHONUTF8": "1", "COLUMNS": "120"}
        return {**os.environ, **own}

    def ran(self, *words: str, code: int = 0, limit_s: float = LIMIT_S) -> str:
        """Return what `cogrip WORDS` printed. Raises CheckError where its exit code is another one."""
        command = ["wine", str(self.python), "-m", "cogrip.cli.main", *words]
        return _ran(command, self.folder, self.environ, code, limit_s)

    def here(self, *words: str) -> str:
        """Return what the same printed on this system."""
        return _ran([sys.executable, "-P", "-m", "cogrip.cli", *words], self.folder, dict(os.environ), 0, LIMIT_S)


def _ran(command: list[str], folder: Path, environ: Mapping[str, str], code: int, limit_s: float) -> str:
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env=environ,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=limit_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise CheckError(f"it did not end within {limit_s:g} s") from None
    told = done.stdout.decode("utf-8", "replace")
    if done.returncode != code:
        said = (told + done.stderr.decode("utf-8", "replace")).strip().splitlines()
        raise CheckError(f"exit code {done.returncode}: {' / '.join(said[-3:])}")
    return told


def _lab(wine: Wine) -> str:
    """Compare a session in virtual time with this system's, in every value of its summary."""
    words = ("lab", "demo", "--set", "seconds=3", "--json", "-")
    _compare(*(json.loads(told) for told in (wine.ran(*words), wine.here(*words))))
    return "the summary is this system's in every value"


def _compare(theirs: object, ours: object) -> None:
    """Raise CheckError where two summaries differ."""
    if unlike := sorted(_unlike(theirs, ours, "")):
        raise CheckError(f"{len(unlike)} values differ: {', '.join(unlike[:3])}")


def _unlike(theirs: object, ours: object, key: str) -> Iterator[str]:
    if isinstance(theirs, dict) and isinstance(ours, dict):
        for name in {*theirs, *ours} - BY_MACHINE:
            yield from _unlike(theirs.get(name), ours.get(name), f"{key}.{name}")
    elif isinstance(theirs, list) and isinstance(ours, list) and len(theirs) == len(ours):
        for number, (one, other) in enumerate(zip(theirs, ours, strict=True)):
            yield from _unlike(one, other, f"{key}.{number}")
    elif theirs != ours:
        yield f"{key.removeprefix('.')} = {theirs} and {ours}"


def _recordings(wine: Wine) -> str:
    """Play a recording of each system again on the other one, bit for bit."""
    for side, ran in (("theirs", wine.ran), ("ours", wine.here)):
        ran("lab", "demo", "--set", "seconds=2", "--runs", "made")
        (made,) = (wine.folder / "made").iterdir()
        made.rename(wine.folder / side)
    for told in (wine.ran("replay", "ours", "--verify"), wine.here("replay", "theirs", "--verify")):
        if told.count("equal, bit for bit") != 3:
            raise CheckError(f"not equal: {told.strip()}")
    return "each system plays the other's again, bit for bit"


def _tables(wine: Wine) -> str:
    """Compare the exported tables of one recording, number by number."""
    wine.ran("export", "theirs", "--to", "csv", "--out", "tables-theirs")
    wine.here("export", "theirs", "--to", "csv", "--out", "tables-ours")
    names = sorted(path.name for path in (wine.folder / "tables-ours").iterdir())
    for name in names:
        rows = [
            list(csv.reader((wine.folder / side / name).open(newline=""))) for side in ("tables-theirs", "tables-ours")
        ]
        if rows[0] != rows[1]:
            raise CheckError(f"{name} differs")
    return f"{len(names)} tables are equal"


def _page(wine: Wine) -> str:
    wine.ran("view", "theirs", "--out", "page.html")
    wine.ran("report", "theirs")
    if (size := (wine.folder / "page.html").stat().st_size) < 100_000:
        raise CheckError(f"page.html has {size} bytes")
    return f"a page of {1e-6 * size:.1f} MB, and the report"


def _devices(wine: Wine) -> str:
    told = wine.ran("devices", "conform", "sim:phantom")
    wine.ran("devices", "list")
    wine.ran("devices", "commission", "emulated:pantograph", "--by", "Wine", "--yes")
    return told.strip().splitlines()[-1]


def _looks(wine: Wine) -> str:
    told = wine.ran("runs", "--runs", ".")
    wine.ran("configs")
    wine.ran("advise", "demo", "--no-laboratory")
    if "theirs" not in told:
        raise CheckError(f"the run is not listed: {told.strip()}")
    return "runs, configs, advise"


def _study(wine: Wine) -> str:
    (wine.folder / "study.toml").write_text(STUDY, "utf-8")
    for side, ran in (("theirs", wine.ran), ("ours", wine.here)):
        ran("study", "study.toml", "--out", f"study-{side}")
    ours = sorted((wine.folder / "study-ours" / "runs").glob("*/summary.json"))
    for path in ours:
        theirs = wine.folder / "study-theirs" / "runs" / path.parent.name / path.name
        _compare(*(json.loads(each.read_text("utf-8")) for each in (theirs, path)))
    return f"{len(ours)} trials in virtual time, each summary is this system's in every value"


def _refused(wine: Wine) -> str:
    """See that what needs another system is refused in one line."""
    wine.ran("who", code=1)
    return "who: refused in one line"


def _see_passive(told: str) -> None:
    """Raise CheckError where a command does not say that its session was passive."""
    if "✓ Passive" not in told:
        raise CheckError(f"not said to be passive: {told.strip()[-200:]}")


def _demo(wine: Wine) -> str:
    _see_passive(wine.ran("demo", "--seconds", "3", "--runs", "live"))
    return "two people and a server, live: passive"


def _join(wine: Wine) -> str:
    """Take a seat at this system's server, encrypted."""
    with _server(wine) as link:
        told = wine.ran("join", link, "--device", "sim:phantom?hand=reach", "--seconds", "3", "--runs", "joined")
    _see_passive(told)
    return "seated over DTLS at this system's server, passive"


@contextmanager
def _server(wine: Wine) -> Iterator[str]:
    """Give the join link of a server that goes on meanwhile."""
    port = free_port()
    words = ("serve", "lan", "--encrypted", "--state", "state", "--port", str(port), "--into", "served")
    log = wine.folder / "server.log"
    with log.open("wb") as out:
        server = subprocess.Popen(
            [sys.executable, "-P", "-m", "cogrip.cli", *words], cwd=wine.folder, stdin=subprocess.DEVNULL, stdout=out,
            stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            until_s = time.monotonic() + START_S
            while not (found := LINK.findall(told := log.read_text("utf-8", "replace"))) or "listening" not in told:
                if server.poll() is not None or time.monotonic() > until_s:
                    raise CheckError(f"this system's server did not start: {told.strip()}")
                time.sleep(0.1)
            yield found[0]
        finally:
            server.terminate()
            server.wait(30.0)


def _doctor(wine: Wine) -> str:
    wine.ran("doctor")
    return "measured"


CHECKS: Mapping[str, Callable[[Wine], str]] = {
    "lab": _lab,
    "replay": _recordings,
    "export": _tables,
    "view, report": _page,
    "runs, configs, advise": _looks,
    "devices": _devices,
    "study": _study,
    "who": _refused,
    "demo": _demo,
    "join": _join,
    "doctor": _doctor,
}
"""Checks by name, in an order in which later ones use what earlier ones left."""


def run_checks(wine: Wine, say: Callable[[str], None], wanted: frozenset[str]) -> int:
    """Run checks, all where none is wanted by name; return the number of those that failed."""
    failed = 0
    shutil.rmtree(wine.folder, ignore_errors=True)
    wine.folder.mkdir(parents=True)
    for name, check in CHECKS.items():
        if wanted and name not in wanted and name != "replay":  # whose recordings the others read
            continue
        begun_s = time.monotonic()
        try:
            mark, found = "✓", check(wine)
        except CheckError as error:
            failed, mark, found = failed + 1, "✗", str(error)
        say(f"{mark} {name}: {found} ({time.monotonic() - begun_s:.0f} s)")
    return failed
