"""Announcement of a room in the shared folder: where it is, for fronts and for its next process where Ray is silent.

    served   a process serves the room, and the directory answers it
    alone    it serves and nobody answers it: it looks here whether another one claims the room
    claimed  the next process has begun; the one that is alone writes its last checkpoint, and ends
    ended    it has; the next one goes on

A process that the directory answers is asked to hand over by Ray, and never looks here.
"""

import os
from pathlib import Path
from typing import Literal

import msgspec

from cogrip.server.io.state_folder import StateError, StateFolder, locked, read_private, write_private

LOCK_S = 2.0
State = Literal["served", "alone", "claimed", "ended"]


class Announcement(msgspec.Struct, frozen=True):
    """State of a room. number: of its newest process; place: HOST:PORT of the one that serves; pid: on that host."""

    room: str
    number: int
    place: str
    state: State
    pid: int = 0


class AnnouncementFile:
    """File of one room."""

    def __init__(self, folder: StateFolder, room: str) -> None:
        self._room = room
        self.path: Path = folder.shared / f"room-{room}.json"

    def read(self) -> Announcement | None:
        """Return what is announced; None for nothing, or what cannot be read."""
        try:
            return msgspec.json.decode(read_private(self.path), type=Announcement)
        except (StateError, FileNotFoundError, msgspec.DecodeError, UnicodeDecodeError):
            return None

    def write(self, number: int, place: str, state: State) -> Announcement | None:
        """Announce, or return what a later process has announced. Raises StateError."""
        busy = f"{self.path}: another process has held it for {LOCK_S:g} s; look at its host"
        with locked(self.path.with_suffix(".lock"), busy, LOCK_S):
            found = self.read()
            if found is not None and found.number > number:
                return found
            write_private(self.path, msgspec.json.encode(Announcement(self._room, number, place, state, os.getpid())))
        return None

    def remove(self) -> None:
        """Announce nothing any more."""
        self.path.unlink(missing_ok=True)
