"""State that a server publishes at its start: written once it starts, then again, as a proof that the folder takes anything.

A folder that takes nothing ends no server: it is said once, shown by `trouble`, and tried again.
"""

from collections.abc import Callable

from cogrip.server.io.checkpoint_file import WriterThread
from cogrip.server.io.state_folder import StateError

AGAIN_NS = 5_000_000_000  # time to the next try after a failure
PROVE_EVERY_NS = 60_000_000_000


class PublishedState:
    """Writes the same state again and again; `write` raises StateError. Between two ticks call `chore`, which never waits.

    name     by which health names it
    trouble  why it is not written; "" where it is
    """

    def __init__(self, name: str, write: Callable[[], None], say: Callable[[str], None]) -> None:
        self.name, self.trouble = name, ""
        self._write_state, self._say = write, say
        self._told = False
        self._next_ns = 0
        self._thread = WriterThread()

    def write(self) -> None:
        """Write it now. Called in a thread of its own once the server runs."""
        try:
            self._write_state()
        except StateError as error:
            self.trouble = str(error)
        else:
            self.trouble = ""

    def report(self) -> None:
        """Say the first trouble of several in a row."""
        if (trouble := self.trouble) and not self._told:
            self._say(f"the server goes on, and tries again every {AGAIN_NS // 10**9} s: {trouble}")
        self._told = bool(trouble)

    def begin(self) -> None:
        """Start the thread, before the loop takes real-time priority."""
        self._thread.begin()

    def chore(self, now_ns: int) -> None:
        """Let the state be written where that is due."""
        self.report()
        if now_ns >= self._next_ns:
            if self._next_ns:
                self._thread.call(self.write)
            self._next_ns = now_ns + (AGAIN_NS if self.trouble else PROVE_EVERY_NS)

    def close(self) -> None:
        """End the thread."""
        self._thread.close()
