"""Book of tokens as a file of a state folder."""

import os
import secrets
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TypeVar

from cogrip.server.admission.tokens import (
    READ_AT_ONCE,
    BookReading,
    SpentToken,
    Token,
    TokenBook,
    TokenError,
    encode_book,
)
from cogrip.server.io.state_folder import StateError, StateFolder, locked, read_private, write_private

LOCK_LIMIT_S = 5.0
Stamp = tuple[int, int, int, int]  # mtime [ns], ctime [ns], size and inode of the file

_Result = TypeVar("_Result")


def draw_token() -> str:
    """Return 128 random bits in base64url: 22 characters."""
    return secrets.token_urlsafe(16)


class TokenFile:
    """File of the book. Changes, of whatever process, are made one after the other."""

    def __init__(self, folder: StateFolder) -> None:
        self._folder = folder
        self.path = folder.tokens
        self._known: Mapping[bytes, Token | SpentToken] = {}  # by text, as they were last read

    def stamp(self) -> Stamp | None:
        """Return what differs once the file was replaced; None where there is none. Raises StateError."""
        try:
            found = os.stat(self.path)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise StateError(f"{self.path}: cannot be read: {error.strerror}; run this as the server's user") from None
        return found.st_mtime_ns, found.st_ctime_ns, found.st_size, found.st_ino

    def load(self, pause: Callable[[], None] = lambda: None) -> TokenBook:
        """Return the book; an empty one before the first token. Raises StateError for a damaged file.

        pause: called after each `READ_AT_ONCE` tokens that are new; in a thread it is to let others go on, as decoding does not
        """
        reading = self.begin()
        while reading.left:
            self.go_on(reading)
            pause()
        return self.end(reading)

    def begin(self) -> BookReading:
        """Read the file, and return a reading of it for `go_on` and `end`. Raises StateError."""
        with self._damaged():
            try:
                return BookReading(read_private(self.path), self._known)
            except FileNotFoundError:
                return BookReading(encode_book(TokenBook()))

    def go_on(self, reading: BookReading) -> None:
        """Decode `READ_AT_ONCE` tokens. Raises StateError."""
        with self._damaged():
            reading.read(READ_AT_ONCE)
        self._known = {**self._known, **reading.texts}

    def end(self, reading: BookReading) -> TokenBook:
        """Return the book of a reading of which nothing is left. Raises StateError."""
        self._known = reading.texts
        with self._damaged():
            return reading.book()

    @contextmanager
    def _damaged(self) -> Iterator[None]:
        try:
            yield
        except TokenError as error:
            others = f"{self._folder.key.name} and {self._folder.certificate.name}"
            raise StateError(
                f"{self.path}: cannot be read as tokens ({error}); put back a good copy, or remove it together with "
                f"{others}: then all links are void, and the next start makes new ones"
            ) from None

    def change(
        self, edit: Callable[[TokenBook], tuple[TokenBook, _Result]], pause: Callable[[], None] = lambda: None
    ) -> _Result:
        """Replace the book by that of `edit`, and return its other result. Raises StateError, or as `edit` does.

        pause: see `load`
        """
        busy = f"{self.path}: another program has been changing it for {LOCK_LIMIT_S:g} s; end it, and try again"
        with locked(self._folder.tokens_lock, busy, LOCK_LIMIT_S):
            book = self.load(pause)
            changed, result = edit(book)
            if changed != book:
                write_private(self.path, encode_book(changed))
        return result
