"""The C twin of a server (`twin.c`)."""

import subprocess

from tests.bench.loads.compiled import compiled


def start_twin(core: int | None) -> subprocess.Popen[bytes]:
    """Start it on this processor. Raises Problem where it cannot be compiled."""
    place = [] if core is None else [str(core)]
    return subprocess.Popen([str(compiled("twin")), *place], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
