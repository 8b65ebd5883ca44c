"""When to open another way to a server that has fallen silent, and which way to use. Sans-IO: what a way is, its driver knows.

seated       one way
resuming     dialled anew at once, and again: after AGAIN_NS while nothing answers, after REFUSED_NS where nobody listens;
             hellos go by the newest way, and the one before stays in use
a welcome    by whichever way: that one is used from now on, the others are closed
heard again  by the old way: the newer one is listened to for SPARE_NS, since a welcome may still come by it
"""

from typing import Generic, TypeVar

AGAIN_NS = (500_000_000, 1_000_000_000, 2_000_000_000)  # the last for all that follow, and once a way is open
REFUSED_NS = 250_000_000
SPARE_NS = 2_000_000_000

W = TypeVar("W")


class PathMigration(Generic[W]):
    """`path` is in use; `newer` has been dialled since the server fell silent, None if nothing has."""

    def __init__(self, path: W) -> None:
        self.path = path
        self.newer: W | None = None
        self.dials = 0  # in all
        self._tries = 0  # in this silence
        self._since_ns = 0  # the newest way was dialled, or it opened
        self._open = False
        self._heard_ns: int | None = None

    @property
    def paths(self) -> tuple[W, ...]:
        """Where to listen."""
        return (self.path,) if self.newer is None else (self.path, self.newer)

    @property
    def asking(self) -> W:
        """The way for hellos."""
        return self.path if self.newer is None else self.newer

    def due(self, now_ns: int, resuming: bool, ready: bool, refused: bool) -> bool:
        """Whether to dial now. ready, refused: of the newest way, whether messages can be sent, and whether nobody listens."""
        if not resuming:
            self._tries = 0
            return False
        self._heard_ns = None
        if not self._tries:
            return True
        if refused:
            return now_ns - self._since_ns >= REFUSED_NS
        ready = ready and self.newer is not None
        if ready and not self._open:
            self._open, self._since_ns = True, now_ns
        wait_ns = AGAIN_NS[-1] if ready else AGAIN_NS[min(self._tries, len(AGAIN_NS)) - 1]
        return now_ns - self._since_ns >= wait_ns

    def dialled(self, path: W | None, now_ns: int) -> W | None:
        """A new way is there, or None could be opened. Returns the one to be closed for it."""
        self.dials += 1
        self._tries += 1
        self._since_ns, self._open = now_ns, False
        if path is None:
            return None
        before, self.newer = self.newer, path
        return before

    def adopt(self, path: W) -> list[W]:
        """A welcome came by this way. Returns the ways to be closed."""
        others = [each for each in self.paths if each is not path]
        self.path, self.newer = path, None
        return others

    def spare(self, now_ns: int, resuming: bool) -> W | None:
        """The newer way, once it is not needed any more; it is to be closed."""
        if self.newer is None or resuming:
            return None
        if self._heard_ns is None:
            self._heard_ns = now_ns
        if now_ns - self._heard_ns < SPARE_NS:
            return None
        self._heard_ns = None
        newer, self.newer = self.newer, None
        return newer
