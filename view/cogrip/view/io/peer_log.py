"""Log of a process that peers can reach: a bounded number of lines, whichever library writes them.

What a peer sends makes asyncio, websockets and ssl log, through loggers of their own. One handler at the root takes all of it.
"""

import logging
import sys
import time
from collections.abc import Callable

from cogrip.protocol.texts import shown
from cogrip.server.rate_limit import Buckets, Budget

LOG_LINES = Budget(1, 100)  # budget of log lines: a traceback has some forty


class PeerLog(logging.Handler):
    """Handler that writes lines to standard error within a budget, escaped. dropped: count of lines beyond it."""

    def __init__(self, budget: Budget = LOG_LINES, clock: Callable[[], int] = time.monotonic_ns) -> None:
        super().__init__(logging.WARNING)
        self._clock = clock
        self.dropped = 0
        self._lines = Buckets(1, budget)

    def take_dropped(self) -> int:
        """Return how many lines were dropped since the last call."""
        dropped, self.dropped = self.dropped, 0
        return dropped

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record, or what there is room for of it."""
        try:
            for line in self.format(record).splitlines():
                if self._lines.take(0, self._clock()):
                    sys.stderr.write(f"{shown(line)}\n")
                else:
                    self.dropped += 1
        except Exception:  # noqa: BLE001 - as logging asks: what cannot be logged ends nobody's session
            self.dropped += 1


PEER_LOG = PeerLog()


def bound_log() -> PeerLog:
    """Let all that this process logs go through one budget. Return the handler."""
    logging.getLogger().addHandler(PEER_LOG)
    return PEER_LOG
