"""Path migration: when to open another path to a server that has fallen silent, and which path to use.

seated          one path
resuming        another path is opened at once, and again: after AGAIN_NS while nothing answers, after REFUSED_NS where nobody
                listens; hellos go by the newest path, and the one before stays in use
a welcome       by the newer path: that one is used from now on, the old one is closed
session resumed by the old path, with a welcome or without: the newer one stays open for SPARE_NS, since the server may bind
                the seat to it as soon as it comes to the hello that went there, and its welcome comes there
"""

from typing import Any

AGAIN_NS = (500_000_000, 1_000_000_000, 2_000_000_000)
"""Waits before another path is opened; the last one is for all further tries, and once a path is open."""
REFUSED_NS = 250_000_000
SPARE_NS = 2_000_000_000


class PathMigration:
    """`path` is in use; `newer` was opened since the server fell silent, None if none was. `attempts` in all.

    A path is whatever the driver sends by: a socket and its channel, an address.
    """

    def __init__(self, path: Any) -> None:
        self.path = path
        self.newer: Any = None
        self.attempts = 0
        self._tries = 0  # in this silence
        self._since_ns = 0  # the newest path was tried, or it was ready
        self._ready = False
        self._resumed_ns: int | None = None

    @property
    def paths(self) -> tuple[Any, ...]:
        """Paths to receive from."""
        return (self.path,) if self.newer is None else (self.path, self.newer)

    @property
    def newest(self) -> Any:
        """Path for hellos."""
        return self.path if self.newer is None else self.newer

    def due(self, now_ns: int, resuming: bool, ready: bool, refused: bool) -> bool:
        """Return True where another path is to be tried now.

        ready    whether messages can be sent by the newest path
        refused  whether nobody listens at its end
        """
        if not resuming:
            self._tries = 0
            return False
        self._resumed_ns = None
        if not self._tries:
            return True
        if refused:
            return now_ns - self._since_ns >= REFUSED_NS
        ready = ready and self.newer is not None
        if ready and not self._ready:
            self._ready, self._since_ns = True, now_ns
        wait_ns = AGAIN_NS[-1] if ready else AGAIN_NS[min(self._tries, len(AGAIN_NS)) - 1]
        return now_ns - self._since_ns >= wait_ns

    def tried(self, path: Any, now_ns: int) -> Any:
        """Go on with a new path, None if it could not be opened. Returns the path to be closed for it."""
        self.attempts += 1
        self._tries += 1
        self._since_ns, self._ready = now_ns, False
        if path is None:
            return None
        before, self.newer = self.newer, path
        return before

    def adopt(self, path: Any, asked: bool = True) -> list[Any]:
        """Use the path by which a welcome came. Returns the paths to be closed. asked: the newest can have carried a hello."""
        if path == self.path and asked:
            return []
        others = [each for each in self.paths if each != path]
        self.path, self.newer = path, None
        return others

    def spare(self, now_ns: int, resuming: bool) -> Any:
        """Return the newer path once it is not needed any more; it is to be closed."""
        if self.newer is None or resuming:
            return None
        if self._resumed_ns is None:
            self._resumed_ns = now_ns
        if now_ns - self._resumed_ns < SPARE_NS:
            return None
        self._resumed_ns = None
        newer, self.newer = self.newer, None
        return newer
