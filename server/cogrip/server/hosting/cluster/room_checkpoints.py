"""Checkpoints of a room of a cluster: in the shared folder, or in the memory of two hosts, by the link to their actor.

A process that nobody answers writes into the folder, whatever the settings say: nobody else takes what it has.
"""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from cogrip.server.checkpoint import CheckpointError, decode
from cogrip.server.hosting.link import Link, Saved
from cogrip.server.io import checkpoint_file
from cogrip.server.io.checkpoint_file import CheckpointWriter
from cogrip.server.io.state_folder import StateError


class RoomCheckpoints:
    """`Checkpoints` of one room. given: the one that the room begins from, if the folder has no newer one.

    in_memory: send them by the link
    """

    def __init__(self, path: Path, say: Callable[[str], None], link: Link, given: bytes, in_memory: bool) -> None:
        self._file = CheckpointWriter(path, say, whole_every=1)
        self._link, self._given, self._say = link, given, say
        self.path = path
        self.in_memory = in_memory
        self._not_sent = 0
        self._refused = ""

    @property
    def trouble(self) -> str:
        """Why nobody has the newest one; "" where somebody has."""
        return self._refused if self.in_memory else self._file.trouble

    @property
    def failures(self) -> int:
        """Number of checkpoints that nobody has."""
        return self._file.failures + self._not_sent

    def put(self, data: bytes) -> None:
        """See `CheckpointWriter`."""
        if not self.in_memory:
            self._file.put(data)
        elif self._link.send(Saved(data)):
            self._refused = ""
        else:
            self._refused = f"{len(data)} bytes were not taken by the link"
            self._not_sent += 1
            if self._not_sent == 1:
                self._say(
                    f"a checkpoint of {len(data)} bytes was not taken: another host will not find the object as it is"
                )

    def read(self) -> bytes | None:
        """Return the newest, None for none. Raises StateError where there is the file's alone, which cannot be read."""
        try:
            kept = checkpoint_file.read(self.path)
        except StateError:
            if not self._given:
                raise
            kept = None
        return newest(self._given or None, kept)

    def remove(self) -> None:
        """Leave none: nobody resumes. Raises OSError."""
        checkpoint_file.remove(self.path)
        self._link.send(Saved(b""))

    def close(self) -> None:
        """See `CheckpointWriter`."""
        self._file.close()


def newest(*found: bytes | None) -> bytes | None:
    """Return the checkpoint of the later step; one that cannot be read where there is no other."""
    best, best_steps = None, -2
    for data in found:
        if data is None:
            continue
        steps = -1
        with suppress(CheckpointError):
            steps = decode(data).steps
        if steps > best_steps:
            best, best_steps = data, steps
    return best
