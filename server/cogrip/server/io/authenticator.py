"""The doorkeeper of a sealed server: tokens of a file, the wall clock, and nothing that makes a tick wait for a disk.

What a tick changes (a one-time token is used, a kicked one revoked) holds at once here, and a thread writes it down.
"""

import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Literal, NamedTuple

from cogrip.protocol.messages import Hello
from cogrip.server.admission import Denied, Grant
from cogrip.server.events import ServerEvent
from cogrip.server.io.state_folder import StateError
from cogrip.server.io.token_file import Stamp, TokenFile
from cogrip.server.tokens import TokenBook, UnknownTokenError

CLOSE_LIMIT_S = 10.0


class Mark(NamedTuple):
    """One change of one token."""

    what: Literal["use", "revoke"]
    id: str
    at_s: float

    def on(self, book: TokenBook) -> TokenBook:
        """The book with it. Someone may have removed the token: then there is nothing to change."""
        change = book.use if self.what == "use" else book.revoke
        try:
            return change(self.id, self.at_s)
        except UnknownTokenError:
            return book


class TokenAuthenticator:
    """A `Authenticator` by tokens. Make it with a file that can be read: raises StateError.

    say: is told of troubles and reloads, in the thread that calls. Call `close` at the end.
    """

    def __init__(
        self, file: TokenFile, say: Callable[[ServerEvent], None], wall_s: Callable[[], float] = time.time
    ) -> None:
        self._file = file
        self._say = say
        self._wall_s = wall_s
        self._stamp: Stamp | None = file.stamp()  # of what was read
        self._tried = self._stamp
        self._book = file.load()
        self._marks: list[Mark] = []  # not seen in the file yet
        self._told_revoked: set[str] = set()
        self._trouble = ""
        self._writer = _Writer(file)

    def admit(self, hello: Hello) -> Grant | Denied:
        """See `Authenticator`. A book that cannot be read is said once, and the last good one holds on."""
        self._look()
        return self._book.admit(hello.token, hello.role, hello.room, self._wall_s())

    def admitted(self, grant: Grant) -> None:
        """See `Authenticator`."""
        self._mark(Mark("use", grant.token, self._wall_s()))

    def revoke(self, ident: str) -> None:
        """From now on this token lets nobody in. An id that there is none of is passed over."""
        self._mark(Mark("revoke", ident, self._wall_s()))

    def revoked(self) -> set[str]:
        """Ids of tokens that were revoked since the last look; at the first look all of them.

        Who sits by one of these must rise: a place may have been restored that was taken before.
        """
        self._tell_failures()
        revoked = {token.id for token in self._book.tokens if token.revoked is not None}
        news = revoked - self._told_revoked
        self._told_revoked = revoked
        return news

    def reload(self) -> bool:
        """Read the file again, as SIGHUP and `cogrip token revoke` ask; say how it went."""
        self._tell_failures()
        good = self._read(forced=True)
        if good:
            now_s = self._wall_s()
            usable = sum(token.state(now_s) == "good" for token in self._book.tokens)
            self._say(ServerEvent("reloaded", f"tokens were read again: {usable} of {len(self._book.tokens)} are good"))
        return good

    def close(self) -> None:
        """Wait until everything is written down; say what is not."""
        self._writer.close()
        self._tell_failures()

    def _look(self) -> None:
        self._tell_failures()
        self._read(forced=False)

    def _read(self, *, forced: bool) -> bool:
        """Take in the file if it has changed. A broken one is tried again once it has changed again."""
        try:
            stamp = self._file.stamp()
            if stamp is None and self._stamp is not None:
                raise StateError(f"{self._file.path}: has gone; put it back, or start the server again to begin anew")
            if not forced and stamp == self._tried:
                return stamp == self._stamp
            self._tried = stamp
            book = self._file.load()
        except StateError as error:
            self._tell(f"tokens are not read anew, and stay as they were: {error}")
            return False
        self._marks = [mark for mark in self._marks if mark.on(book) != book]
        self._book, self._stamp, self._trouble = _all_on(self._marks, book), stamp, ""
        if self._marks:
            self._writer.write(self._marks)
        return True

    def _mark(self, mark: Mark) -> None:
        changed = mark.on(self._book)
        if changed != self._book:
            self._book = changed
            self._marks.append(mark)
            self._writer.write(self._marks)

    def _tell_failures(self) -> None:
        while self._writer.failures:
            failure = self._writer.failures.popleft()
            self._tell(f"a token's use or end is not written down, and holds until this server ends: {failure}")

    def _tell(self, text: str) -> None:
        if text != self._trouble:
            self._trouble = text
            self._say(ServerEvent("trouble", text))


class _Writer:
    """A thread that writes marks into the file. What it fails to write comes again with the next mark or reading."""

    def __init__(self, file: TokenFile) -> None:
        self.failures: deque[str] = deque(maxlen=8)
        self._file = file
        self._orders: queue.SimpleQueue[tuple[Mark, ...] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="tokens", daemon=True)
        self._thread.start()

    def write(self, marks: list[Mark]) -> None:
        self._orders.put(tuple(marks))

    def close(self) -> None:
        self._orders.put(None)
        self._thread.join(CLOSE_LIMIT_S)
        if self._thread.is_alive():
            self.failures.append(f"the disk did not answer within {CLOSE_LIMIT_S:g} s")

    def _run(self) -> None:
        while (marks := self._orders.get()) is not None:
            try:
                self._file.change(partial(_written, marks))
            except StateError as error:
                self.failures.append(str(error))


def _written(marks: Sequence[Mark], book: TokenBook) -> tuple[TokenBook, None]:
    return _all_on(marks, book), None


def _all_on(marks: Sequence[Mark], book: TokenBook) -> TokenBook:
    for mark in marks:
        book = mark.on(book)
    return book
