"""Lines that rooms say, on their path to the fronts: numbered where they arise, kept until they were taken, bounded."""

from collections import deque
from collections.abc import Sequence

from cogrip.server.events import ServerEvent

MOST_LINES = 512  # most lines that are kept


class Lines:
    """Newest lines of one source. They are numbered from 0; whoever reads says which it has."""

    def __init__(self, most: int = MOST_LINES) -> None:
        self._lines: deque[ServerEvent] = deque(maxlen=most)
        self.end = 0  # number of the next line

    def add(self, line: ServerEvent) -> None:
        """Keep a line, in place of the oldest where there are too many."""
        self._lines.append(line)
        self.end += 1

    def since(self, number: int) -> tuple[int, list[ServerEvent]]:
        """Return the lines from this number on that are still kept, and the number of the first of them."""
        first = max(number, self.end - len(self._lines))
        return first, list(self._lines)[first - self.end :] if first < self.end else []


class GatheredLines:
    """Lines of several sources as one. Each line counts once, also where a source repeats it, not knowing that it was taken."""

    def __init__(self) -> None:
        self.all = Lines()
        self._ends: dict[str, int] = {}

    def take(self, source: str, first: int, lines: Sequence[ServerEvent]) -> int:
        """Take in lines of a source. Returns the number of the one that it is to send next."""
        known = self._ends.get(source, first)
        if first + len(lines) < known:  # it was started again
            known = first
        for line in lines[max(known - first, 0) :]:
            self.all.add(line)
        self._ends[source] = max(known, first + len(lines))
        return self._ends[source]
