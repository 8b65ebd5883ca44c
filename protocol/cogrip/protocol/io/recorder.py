"""Recorder of a live loop: the loop puts messages into a ring, a process of its own writes them.

The writer outlives a killed loop long enough to write what is in the ring. Whatever happens to it, to the disk or to
the folder, the loop goes on; `trouble` says what is wrong, once, and `lost` counts what is not in the file.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from cogrip.machine.platform import system
from cogrip.machine.ring import Ring, make_ring
from cogrip.protocol.recording.header import Header

RING_BYTES = 8 * 2**20
"""Several seconds of a client at RING_HZ, or of a room of many; a faster loop gets as many times more, up to MOST_RINGS."""
RING_HZ, MOST_RINGS = 1024, 4
END_LIMIT_S = 20.0
_CHECK_EVERY = 64  # messages between two checks of the writer's report
_POLL_EVERY = 512  # messages between two questions to the system whether the writer runs, which take longer


def is_being_written(path: Path) -> bool:
    """Return whether some process is writing `path`. Raises OSError."""
    with path.open("rb") as file:
        try:
            system.lock(file.fileno())
        except BlockingIOError:
            return True
    return False


class Recorder:
    """A `Sink` of one loop: `process` writes what it puts into `ring`. Make it with `open_recorder`."""

    __slots__ = ("_count", "_reported", "_say", "_unsaved", "path", "process", "ring", "trouble")

    def __init__(self, path: Path, ring: Ring, process: subprocess.Popen[bytes], say: Callable[[str], None]) -> None:
        self.path = path
        self.trouble = ""
        self.ring = ring
        self.process = process
        self._say = say
        self._count = 0
        self._reported = False
        self._unsaved: int | None = None

    @property
    def lost(self) -> int:
        """Messages that did not fit into the ring; after `close`, all that are not in the file, whatever the reason."""
        return self.ring.lost if self._unsaved is None else self._unsaved

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        """Put a message into the ring (`Sink.put`)."""
        self.ring.put(topic, time_ns, payload)
        self._count += 1
        if self._count % _CHECK_EVERY == 0:
            self._check_writer(self._count % _POLL_EVERY == 0)

    def look(self) -> str:
        """Return `trouble` as of now, said if it is new: a loop that has nothing to put looks by this."""
        self._check_writer(True)
        return self.trouble

    def _check_writer(self, polls: bool) -> None:
        if not self.trouble:
            self.trouble = self.ring.said
            if not self.trouble and polls and self.process.poll():
                self.trouble = "its writer was ended from outside; what it had written can be recovered"
            if self.trouble:
                self._say(f"recording of {self.path.name} has stopped: {self.trouble}")
        if self.ring.lost and not self._reported:
            self._reported = True
            if not self.trouble:
                self._say(f"recording of {self.path.name} is too slow: messages are left out, and counted")

    def close(self) -> None:
        """Wait until everything is written."""
        self.ring.finish()
        assert self.process.stdin is not None
        self.process.stdin.close()
        try:
            self.process.wait(END_LIMIT_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._check_writer(True)
        self._unsaved = self._count - self.ring.saved
        self.ring.close()


def ring_for(rate_hz: int) -> int:
    """Return the size of the ring of a loop at `rate_hz` [bytes]."""
    return RING_BYTES * min(MOST_RINGS, max(1, -(-rate_hz // RING_HZ)))


def open_recorder(
    path: Path, header: Header, say: Callable[[str], None], ring_bytes: int | None = None, floor_bytes: int = 0
) -> Recorder | None:
    """Begin a recording in a new file at `path`; where that fails, say why and return None: the session goes on without.

    floor_bytes: it stops, its file whole, where less than that is free on its disk

    Call it before the loop takes real-time priority: the writer would inherit it.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        out = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o644)
    except OSError as error:
        exists = isinstance(error, FileExistsError) and path.exists()
        why = (
            " exists, and no recording is overwritten"
            if exists
            else f": {error.strerror}; choose another folder with --runs"
        )
        say(f"this session is not recorded: {path}{why}")
        return None
    if system.LOCKS_ARE_INHERITED:
        with suppress(OSError):
            system.lock(out)
    try:
        ring = make_ring(ring_for(header.rate_hz) if ring_bytes is None else ring_bytes)
        handles = [system.handle_of(fd) for fd in (ring.fd, out)]
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "cogrip.protocol.io.recording_process", *map(str, handles)],
            stdin=subprocess.PIPE, **system.own_session(*handles),
        )  # fmt: skip
        assert process.stdin is not None
        process.stdin.write(
            json.dumps({"path": str(path.absolute()), "header": header.metadata(), "floor_bytes": floor_bytes}).encode()
            + b"\n"
        )
        process.stdin.flush()
    except OSError as error:
        say(f"this session is not recorded: {error.strerror or error}")
        return None
    finally:
        os.close(out)
    return Recorder(path, ring, process, say)
