"""Versions of the program that is installed now, as a server that hands its seats over asks for them before it lets go.

The next server is of what stands on the disk, which an upgrade may have changed under the running one. Run as a program this
module says its own versions.
"""

import json
import subprocess
import sys
import time

from cogrip.protocol.version import VERSION
from cogrip.protocol.wire.messages import PROTOCOL_VERSION
from cogrip.server.checkpoint import VERSION as CHECKPOINT_VERSION

ASK_LIMIT_S = 10.0
PARTS = {"protocol": PROTOCOL_VERSION, "checkpoint": CHECKPOINT_VERSION}
PROGRAM = """
import os, runpy
if hasattr(os, "sched_setscheduler"):  # not in the way of the loop that asks
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
runpy.run_module("cogrip.server.io.next_server", run_name="__main__")
"""


class NextServer:
    """Question to the program that is installed now. It is asked at once, and nobody waits."""

    def __init__(self) -> None:
        self._until_s = time.monotonic() + ASK_LIMIT_S
        try:
            self._process: subprocess.Popen[bytes] | None = subprocess.Popen(
                [sys.executable, "-P", "-c", PROGRAM], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
            )
        except OSError:
            self._process = None

    def misfit(self) -> str | None:
        """Return why the seats cannot go on there, "" where they can; None while it has not said."""
        process = self._process
        if process is not None and process.poll() is None:
            if time.monotonic() < self._until_s:
                return None
            process.kill()
            process.wait()
        try:
            assert process is not None
            assert process.stdout is not None
            found = json.loads(process.stdout.read())
            parts = [f"{name} {found[name]}, not {number}" for name, number in PARTS.items() if found[name] != number]
        except (AssertionError, OSError, ValueError, LookupError, TypeError):
            return "the program that is installed now does not say its versions"
        return f"cogrip {found.get('software')}, which is installed now, has {', '.join(parts)}" if parts else ""


if __name__ == "__main__":
    print(json.dumps({**PARTS, "software": VERSION}))
