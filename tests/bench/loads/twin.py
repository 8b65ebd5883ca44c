"""Servers that are not written in Python: the C twin (`twin.c`), and one of VRPN's library (`vrpn.cpp`)."""

import subprocess
from pathlib import Path

from cogrip.cli.terminal.problem import BadInput

from tests.bench.loads.compiled import compiled

VRPN_VARIABLE = "VRPN_SOURCE"  # of the environment: a folder with its source
SELECT_MOST = 1024  # descriptors, of glibc's fd_set
OWN_DESCRIPTORS = 16
VRPN_SOURCES = (
    "vrpn_Connection.C",
    "vrpn_EndpointContainer.C",
    "vrpn_FileConnection.C",
    "vrpn_Shared.C",
    "vrpn_Thread.C",
)


def start_twin(core: int | None) -> subprocess.Popen[bytes]:
    """Start the C twin on this processor. Raises Problem where it cannot be compiled."""
    return _start(compiled("twin.c"), core)


def start_vrpn(source: Path, people: int, per_room: int, core: int | None) -> subprocess.Popen[bytes]:
    """Start VRPN on this processor, made with its own source. Raises what `check_vrpn` does."""
    return _start(check_vrpn(source, people, per_room), core, people, per_room)


def check_vrpn(source: Path, people: int, per_room: int) -> Path:
    """Return the server made with VRPN's source, of this folder.

    Raises BadInput where the source is not there or VRPN cannot serve so many, as it waits with `select` on three sockets a
    person and two a connection; Problem where it cannot be compiled.
    """
    if 3 * people + 2 * -(-people // per_room) + OWN_DESCRIPTORS > SELECT_MOST:
        raise BadInput(
            f"--vrpn: {people} people need more than {SELECT_MOST} sockets, which VRPN cannot wait for; ask for fewer"
        )
    files = [str(source / name) for name in VRPN_SOURCES]
    for path in files:
        if not Path(path).is_file():
            raise BadInput(f"--vrpn: {path} is not there; name a folder with VRPN's source (github.com/vrpn/vrpn)")
    return compiled("vrpn.cpp", ("-I", str(source), *files, "-pthread", "-w"))


def _start(program: Path, core: int | None, *words: int) -> subprocess.Popen[bytes]:
    command = [str(program), *map(str, words), *([] if core is None else [str(core)])]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
