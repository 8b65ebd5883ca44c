"""Authenticator of an encrypted server, by the tokens of a file and the wall clock. No tick waits for a disk.

What a tick changes (a one-time token is used, a kicked one revoked) holds here at once; a thread writes it to the file.
Of a file that has changed only the changed tokens are decoded, and of many only some between two ticks: the book before holds
meanwhile, for those who are here, and hellos are left unanswered, which come again.
"""

import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Literal, NamedTuple

from cogrip.machine.addition import add_integers
from cogrip.protocol.wire.messages import Hello
from cogrip.server.admission.admission import Denied, Grant
from cogrip.server.admission.signed_tokens import SignedTokens
from cogrip.server.admission.tokens import SPENT_S, BookReading, TokenBook, TokenError, is_jti
from cogrip.server.events import ServerEvent
from cogrip.server.io.state_folder import StateError
from cogrip.server.io.token_file import Stamp, TokenFile

READING = "many tokens have changed, and are read between the ticks; then sessions of revoked ones end"
CLOSE_LIMIT_S = 10.0
WATCH_S = 0.5  # time between two looks at the file
PAUSE_S = 0.001  # pause of a reading thread between two slices: one that only computes keeps the interpreter for 5 ms
TOO_MANY = "signed tokens come faster than signatures are checked; hellos with others are not answered, and come again"
AGAIN_S = 5.0  # time after which what could not be written is tried again


class TokenChange(NamedTuple):
    """One change of one token."""

    what: Literal["use", "revoke", "close"]
    id: str  # public id of the token; name of the room that is closed
    at_s: float
    until_s: float = 0.0  # when a signed token has expired anyway

    def on(self, book: TokenBook) -> TokenBook:
        """Return the book with this change; unchanged where the token was removed, or the book takes no more."""
        try:
            if self.what == "close":
                return book.close_room(self.id, self.at_s)
            if is_jti(self.id):
                return book.spend(self.id, self.what, self.until_s, self.at_s)
            return (book.use if self.what == "use" else book.revoke)(self.id, self.at_s)
        except TokenError:
            return book


class TokenAuthenticator:
    """`Authenticator` by the tokens of a file. Raises StateError where it cannot be read. Call `close` at the end.

    say: reports troubles and reloads, in the thread that calls
    watch: read the file soon after another process has changed it; else at the next hello, or by `reload`
    fingerprint: of this server, for which signed tokens have to be
    """

    def __init__(
        self, file: TokenFile, say: Callable[[ServerEvent], None], wall_s: Callable[[], float] = time.time,
        watch: bool = False, fingerprint: str = "", clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:  # fmt: skip
        self._file = file
        self._say = say
        self._wall_s = wall_s
        self._stamp: Stamp | None = file.stamp()  # of the file as it was read
        self._tried = self._stamp
        self._reading: BookReading | None = None  # of the file as it was tried
        self._to_report = False  # the reading that goes on, to who asked for it
        self._book = file.load()
        self._signed = SignedTokens(fingerprint, clock_ns)
        self._pending: list[TokenChange] = []  # not in the file yet
        self._reported: dict[str, set[str]] = {}  # ids, by what has ended them
        self._trouble = ""
        self.not_written = ""  # why the file lacks what holds here; "" where it does not
        self._failed_s = 0.0
        self._writer = _Writer(file)
        self._watch = _Watch(file) if watch else None

    def admit(self, hello: Hello) -> Grant | Denied | None:
        """See `Authenticator`. A file that cannot be read is reported once, and the last good book holds."""
        self._report_failures()
        self._read(forced=False)
        if self._reading:
            return None
        if "." not in hello.token:
            return self._book.admit(hello.token, hello.role, hello.room, self._wall_s())
        verdict = self._signed.admit(hello.token, hello.role, hello.room, self._book, self._wall_s())
        if verdict is None:
            self._report(TOO_MANY)
        return verdict

    def shown(self, hello: Hello) -> str | None:
        """See `Authenticator`."""
        self._report_failures()
        self._read(forced=False)
        if "." in hello.token:
            return self._signed.shown(hello.token, self._book, self._wall_s())
        return self._book.shown(hello.token, self._wall_s())

    def admitted(self, grant: Grant) -> None:
        """See `Authenticator`."""
        now_s = self._wall_s()
        until_s = self._signed.used_until(grant.token, now_s) if is_jti(grant.token) else 0.0
        if until_s is not None:
            self._apply(TokenChange("use", grant.token, now_s, until_s))

    def revoke(self, ident: str) -> None:
        """Revoke a token. An unknown id of a stored one is ignored."""
        now_s = self._wall_s()
        self._apply(TokenChange("revoke", ident, now_s, now_s + SPENT_S))

    def revoke_room(self, room: str) -> None:
        """Revoke all tokens that are for this room alone, those that were made a moment ago too, and signed ones."""
        self._read(forced=True)
        for token in self._book.tokens:
            if token.room == room and token.revoked is None:
                self.revoke(token.id)
        if self._book.keys:
            self._apply(TokenChange("close", room, self._wall_s()))

    def revoked(self) -> set[str]:
        """Return the ids of tokens revoked since the last call; of all at the first, as restored seats may be of them."""
        self._report_failures()
        self._write_again()
        if self._watch is not None and self._watch.changed:
            self._watch.changed = False
            self._read(forced=False)
        stored = {token.id for token in self._book.tokens if token.revoked is not None}
        signed = {each.jti for each in self._book.spent if each.revoked is not None}
        return self._news("revoked", stored | signed | self._signed.void(self._book))

    def expired(self) -> set[str]:
        """Return the ids of tokens whose time has ended since the last call; of all at the first."""
        now_s = self._wall_s()
        return self._news("expired", {token.id for token in self._book.tokens if token.expired(now_s)})

    def _news(self, why: str, ids: set[str]) -> set[str]:
        before, self._reported[why] = self._reported.get(why, set()), ids
        return ids - before

    def reload(self) -> bool | None:
        """Read the file again (SIGHUP, `cogrip token revoke`), and report each time. False where it could not be read, None
        where much has changed: then it is begun, and `read_on` ends and reports it.
        """
        self._report_failures()
        good = self._read(forced=True)
        self._to_report = good
        self._report_reload()
        return None if self._reading else good

    def read_on(self) -> None:
        """Decode some more of a file in which much has changed. Called between two ticks."""
        if self._reading is not None:
            self._go_on(self._reading)
            self._report_reload()

    def _report_reload(self) -> None:
        if self._to_report and self._reading is None:
            self._to_report, now_s = False, self._wall_s()
            usable = add_integers(token.state(now_s) == "good" for token in self._book.tokens)
            keys = f"; {len(self._book.keys)} keys of signed ones" if self._book.keys else ""
            words = f"tokens were read again: {usable} of {len(self._book.tokens)} are good{keys}"
            self._say(ServerEvent("reloaded", words))

    def close(self) -> None:
        """Wait until every change is in the file; report those that are not."""
        self._writer.close()
        if self._watch is not None:
            self._watch.closing.set()
        self._report_failures()

    def _read(self, *, forced: bool) -> bool:
        """Read the file if it has changed. A broken one is tried again once it has changed again."""
        try:
            stamp = self._file.stamp()
            if stamp is None and self._stamp is not None:
                raise StateError(f"{self._file.path}: has gone; put it back, or start the server again to begin anew")
            if not forced and stamp == self._tried:
                return self._reading is not None or stamp == self._stamp
            self._tried = stamp
            reading = self._file.begin()
        except StateError as error:
            self._fail(error, asked=forced)
            return False
        return self._go_on(reading, asked=forced)

    def _go_on(self, reading: BookReading, *, asked: bool = False) -> bool:
        """Decode some of the file, and take its book once that is whole."""
        try:
            self._file.go_on(reading)
            if reading.left:
                self._reading = reading
                return True
            book = self._file.end(reading)
        except StateError as error:
            self._fail(error, asked=asked)
            return False
        self._reading = None
        self._pending = [change for change in self._pending if change.on(book) != book]
        if not self._pending:
            self.not_written = ""
        self._book, self._stamp, self._trouble = _all_on(self._pending, book), self._tried, ""
        if self._pending:
            self._writer.write(self._pending)
        return True

    def _fail(self, error: StateError, *, asked: bool) -> None:
        self._reading = None
        asked, self._to_report = asked or self._to_report, False
        self._report(f"tokens are not read anew, and stay as they were: {error}", asked=asked)

    def _apply(self, change: TokenChange) -> None:
        changed = change.on(self._book)
        if changed != self._book:
            self._book = changed
            self._pending.append(change)
            self._writer.write(self._pending)

    def _write_again(self) -> None:
        """Write what failed before; read the file once that has succeeded, so that nothing is pending any more."""
        if not self.not_written:
            return
        if self._wall_s() - self._failed_s >= AGAIN_S:
            self._failed_s = self._wall_s()
            self._writer.write(self._pending)
        self._read(forced=False)

    def _report_failures(self) -> None:
        while self._writer.failures:
            failure = self._writer.failures.popleft()
            self.not_written, self._failed_s = failure, self._wall_s()
            self._report(f"a token's use or end is not written down, and holds until this server ends: {failure}")

    def _report(self, text: str, *, asked: bool = False) -> None:
        """Report a trouble once, and again to whoever asks."""
        if asked or text != self._trouble:
            self._trouble = text
            self._say(ServerEvent("trouble", text))


class _Writer:
    """Thread that writes changes into the file. What fails is written with the next change or reading."""

    def __init__(self, file: TokenFile) -> None:
        self.failures: deque[str] = deque(maxlen=8)
        self._file = file
        self._orders: queue.SimpleQueue[tuple[TokenChange, ...] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="tokens", daemon=True)
        self._thread.start()

    def write(self, changes: list[TokenChange]) -> None:
        self._orders.put(tuple(changes))

    def close(self) -> None:
        self._orders.put(None)
        self._thread.join(CLOSE_LIMIT_S)
        if self._thread.is_alive():
            self.failures.append(f"the disk did not answer within {CLOSE_LIMIT_S:g} s")

    def _run(self) -> None:
        while (changes := self._orders.get()) is not None:
            try:
                self._file.change(partial(_written, changes), partial(time.sleep, PAUSE_S))
            except StateError as error:
                self.failures.append(str(error))


class _Watch:
    """Thread that looks whether the file was changed: a disk elsewhere may take its time. changed: since it was last reset."""

    def __init__(self, file: TokenFile) -> None:
        self.changed = False
        self.closing = threading.Event()
        self._file, self._stamp = file, file.stamp()
        threading.Thread(target=self._run, name="watch of tokens", daemon=True).start()

    def _run(self) -> None:
        while not self.closing.wait(WATCH_S):
            with suppress(StateError):
                stamp = self._file.stamp()
                self.changed, self._stamp = self.changed or stamp != self._stamp, stamp


def _written(changes: Sequence[TokenChange], book: TokenBook) -> tuple[TokenBook, None]:
    return _all_on(changes, book), None


def _all_on(changes: Sequence[TokenChange], book: TokenBook) -> TokenBook:
    for change in changes:
        book = change.on(book)
    return book
