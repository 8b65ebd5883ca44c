"""One client of the view's socket: what waits to be sent to it. A slow one gets the newest frame, never a queue of old ones."""

from collections import deque
from collections.abc import Callable

MOST_TEXTS = 64


class Tab:
    """Outgoing messages of a client. `wake` is called when there is something to take.

    replaced  frames that a newer one replaced before they were taken
    dropped   texts that did not fit any more, the oldest first
    own_seat  of the hand that it moves, None without one
    note      sentence for its user in place of the scene's, ""
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self.replaced = self.dropped = 0
        self.own_seat: int | None = None
        self.note = ""
        self._wake = wake
        self._texts: deque[str | bytes] = deque()
        self._newest: dict[int, bytes] = {}  # kind -> newest message of it

    def say(self, text: str | bytes) -> None:
        """Queue a message of which none may be left out, as far as there is room."""
        if len(self._texts) >= MOST_TEXTS:
            self._texts.popleft()
            self.dropped += 1
        self._texts.append(text)
        self._wake()

    def show(self, message: bytes) -> None:
        """Put a binary message in the place of an older one of its kind, its first byte."""
        self.replaced += message[0] in self._newest
        self._newest[message[0]] = message
        self._wake()

    def take(self) -> list[str | bytes]:
        """Return what is to be sent now, texts first."""
        waiting = [*self._texts, *self._newest.values()]
        self._texts.clear()
        self._newest.clear()
        return waiting
