"""Guard of a room's process: in a silence of the directory it looks whether another process claims the room."""

import threading
import time
from contextlib import suppress
from typing import Literal

from cogrip.server.hosting.cluster.announcement import Announcement, AnnouncementFile, State
from cogrip.server.io.state_folder import StateError, StateFolder

LOOK_S = 0.1
CLAIM_S = 1.5  # longest time that the process before may take to end


class Guard:
    """Announcement of one process of a room. claimed: "hand over" once another process waits, "lost" once one serves."""

    def __init__(self, folder: StateFolder, room: str, number: int) -> None:
        self._file = AnnouncementFile(folder, room)
        found = self._file.read()
        self.number = number if found is None else max(number, found.number + 1)
        self.claimed: Literal["", "hand over", "lost"] = ""
        self._place = ""
        self._claimer: Announcement | None = None
        self._alone, self._closing = threading.Event(), False
        self._thread: threading.Thread | None = None

    def claim(self) -> None:
        """Claim the room from a process that nobody answers; return once that has ended, or has had the time to."""
        found = self._file.read()
        if found is None or found.state != "alone" or found.number >= self.number:
            return
        with suppress(StateError):
            self._file.write(self.number, found.place, "claimed")
        until_s = time.monotonic() + CLAIM_S
        while time.monotonic() < until_s:
            found = self._file.read()
            if found is not None and found.state == "ended":
                return
            time.sleep(LOOK_S / 4)

    def serve(self, place: str) -> None:
        """Announce that the room is served here. Nothing waits for a disk."""
        self._place = place
        self._thread = threading.Thread(target=self._run, name="announcement", daemon=True)
        self._thread.start()

    def note_directory(self, answers: bool) -> None:
        """Note whether the directory answers."""
        (self._alone.clear if answers else self._alone.set)()

    @property
    def alone(self) -> bool:
        """Return whether nobody answers."""
        return self._alone.is_set()

    def ended(self) -> None:
        """Announce that this process has ended, and its checkpoint is there."""
        claimer = self._claimer
        with suppress(StateError):  # the next process waits for it for a moment
            self._file.write(claimer.number if claimer else self.number, self._place, "ended")

    def close(self, remove: bool) -> None:
        """Look no more. remove: nobody resumes."""
        self._closing = True
        if self._thread is not None:
            self._thread.join()
        if remove:
            with suppress(OSError):
                self._file.remove()

    def _run(self) -> None:
        told: State | None = None
        while not self._closing and not self.claimed:
            state: State = "alone" if self._alone.is_set() else "served"
            found: Announcement | None = None
            if state != told:
                with suppress(StateError):  # it is tried again
                    found, told = self._file.write(self.number, self._place, state), state
            elif state == "alone":
                found = self._file.read()
            if found is not None and found.number > self.number:
                self._claimer = found
                self.claimed = "hand over" if found.state == "claimed" else "lost"
            time.sleep(LOOK_S)
