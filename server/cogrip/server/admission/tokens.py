"""Access tokens, kept as hashes, and the book that admits a hello by them; keys of signed tokens, and which of these are void.

A book is a value: a change returns a new one. Dates are Unix seconds, handed in.
"""

import difflib
import functools
import hashlib
import hmac
import re
from base64 import urlsafe_b64encode
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Annotated, Any, Literal, get_args

import msgspec
from msgspec.structs import replace

from cogrip.machine.addition import add_integers
from cogrip.protocol.wire.messages import DEVICE_BYTES, Role
from cogrip.server.admission.admission import Denied, Grant
from cogrip.server.admission.token_keys import MOST_KEYS, TokenKey

VERSION: Literal[1] = 1
MOST_TOKENS = 400  # most tokens of a room, and most of those for any room. The oldest void ones are dropped first
MOST_IN_BOOK = 2000
MOST_SPENT = 2000  # most signed tokens that are kept as used or revoked, until each has expired
MOST_ONCE = 1800  # most of them before no one-time token is taken any more: the rest is for revocations
# Time for which a signed token stays revoked: by then it has expired (signed_tokens.MOST_LIFE_S, LEEWAY_S).
SPENT_S = 86_400 + 60
MOST_CLOSED = 500  # most closed rooms on demand that are kept, for as long; those that were closed first are dropped
READ_AT_ONCE = 64  # number of tokens that are decoded at once where a tick may be due: some 13 us each
START_NOTE = "printed at start"
_USED = "was used already: it is good for one time"
_JTI = re.compile(r"[A-Za-z0-9_-]{10,40}\Z")
_NAME_OR_ANY = r"^([A-Za-z0-9][A-Za-z0-9 ._-]*)?\Z"

Id = Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{8}\Z")]
Jti = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]{10,40}\Z")]
"""Public id of a signed token: longer than that of any stored one, so that no id is both."""
Hash = Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{64}\Z")]
NameOrAny = Annotated[str, msgspec.Meta(max_length=40, pattern=_NAME_OR_ANY)]
DeviceOrAny = Annotated[str, msgspec.Meta(max_length=DEVICE_BYTES, pattern=r"^[ -~]*\Z")]
Note = Annotated[str, msgspec.Meta(max_length=200, pattern=r"^[^\x00-\x1f\x7f-\x9f]*\Z")]
"""Note on a token, without control characters: it is printed on terminals."""
UnixSeconds = Annotated[int, msgspec.Meta(ge=0, le=253_402_300_799)]  # seconds since 1970, to the end of the year 9999
ClockSeconds = Annotated[int, msgspec.Meta(ge=-62_135_596_800, le=253_402_300_799)]
"""Seconds since 1970 of a clock that may be wrong."""
TokenState = Literal["good", "used", "expired", "revoked"]


class TokenError(ValueError):
    """A token or a book of them is not as it must be."""


class UnknownTokenError(TokenError):
    """No token has this id."""


class Token(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One token as it is kept. No field has a default: one that is missing in a file must not widen what it allows."""

    id: Id  # public id: the beginning of the hash
    hash: Hash  # SHA-256 of the token
    role: Role  # role of the holder; a player's lets one observe too
    room: NameOrAny  # name of the room; "" any
    user: NameOrAny  # name of the person whose seat may be taken; "" any
    device: DeviceOrAny  # beginning of the device address that may be claimed; "" any
    once: bool
    start: bool  # derived from the server's key, and printed when it starts
    expires: UnixSeconds | None
    created: ClockSeconds
    used: ClockSeconds | None  # time at which a one-time token was used
    revoked: ClockSeconds | None
    note: Note

    def expired(self, now_s: float) -> bool:
        """Return whether its time is over."""
        return self.expires is not None and now_s >= self.expires

    def state(self, now_s: float) -> TokenState:
        """Return whether it admits anyone, else why not."""
        if self.revoked is not None:
            return "revoked"
        if self.once and self.used is not None:
            return "used"
        return "expired" if self.expired(now_s) else "good"


class SpentToken(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Signed token that admits nobody any more."""

    jti: Jti
    until: UnixSeconds  # when it has expired anyway
    used: ClockSeconds | None
    revoked: ClockSeconds | None


class ClosedRoom(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Room on demand that was closed: signed tokens made for it before are void, also once its name is given again."""

    room: NameOrAny
    at: ClockSeconds


class StartLink(msgspec.Struct, frozen=True):
    """Standing token that the server prints when it starts."""

    role: Role
    room: str
    id: str
    token: str

    def __repr__(self) -> str:
        return f"StartLink(role={self.role!r}, room={self.room!r}, id={self.id!r})"

    def __rich_repr__(self) -> list[tuple[str, Any]]:
        return [("room", self.room), ("id", self.id)]


class TokenBook(msgspec.Struct, frozen=True, forbid_unknown_fields=True, dict=True):
    """All tokens of one server; see `encode_book` and `decode_book`.

    keys   of signed tokens
    spent  signed tokens that were used up or revoked, until they expire
    closed  rooms on demand that were closed, until the signed tokens for them have expired
    """

    version: Literal[1] = VERSION
    tokens: tuple[Token, ...] = ()
    keys: tuple[TokenKey, ...] = ()
    spent: tuple[SpentToken, ...] = ()
    closed: tuple[ClosedRoom, ...] = ()

    def new(
        self,
        token: str,
        now_s: float,
        *,
        role: Role = "player",
        room: str = "",
        user: str = "",
        device: str = "",
        once: bool = False,
        expires: int | None = None,
        note: str = "",
        start: bool = False,
    ) -> tuple["TokenBook", Token]:
        """Return the book with a new token, and that. `token` is random. Raises TokenError for fields that do not fit."""
        hashed = token_hash(token)
        if any(known.id == hashed[:8] for known in self.tokens):
            raise TokenError(f"the id {hashed[:8]} is taken; draw another token")
        if role == "observer" and (user or device):
            raise TokenError("an observer has neither seat nor device: leave them open, or make the token a player's")
        made = Token(
            id=hashed[:8], hash=hashed, role=role, room=room, user=user, device=device, once=once, start=start,
            expires=expires, created=int(now_s), used=None, revoked=None, note=note,
        )  # fmt: skip
        try:
            made = msgspec.convert(msgspec.to_builtins(made), Token)
        except msgspec.ValidationError as error:
            raise TokenError(f"a token cannot be so: {_readable(error)}") from None
        return replace(self, tokens=(*self._room_for_one(room, now_s), made)), made

    def find(self, ident: str) -> Token:
        """Return the token with this id. Raises UnknownTokenError, which names the nearest."""
        for token in self.tokens:
            if token.id == ident:
                return token
        near = difflib.get_close_matches(ident, [token.id for token in self.tokens], n=1, cutoff=0.5)
        cure = f"did you mean {near[0]}?" if near else "`cogrip token list` shows those there are"
        raise UnknownTokenError(f"no token has the id {ident}; {cure}")

    def revoke(self, ident: str, now_s: float) -> "TokenBook":
        """Return the book with this token revoked; an earlier date stays. Raises UnknownTokenError."""
        token = self.find(ident)
        return self if token.revoked is not None else self._with(replace(token, revoked=int(now_s)))

    def use(self, ident: str, now_s: float) -> "TokenBook":
        """Return the book after an admission by this token: a one-time token is used up. Raises UnknownTokenError."""
        token = self.find(ident)
        kept = not token.once or token.used is not None
        return self if kept else self._with(replace(token, used=int(now_s)))

    def admit(self, token: str, role: Role, room: str, now_s: float) -> Grant | Denied:
        """Answer a hello with this token; an observer's token admits observers only."""
        found = self._known(token)
        if found is None:
            words = "this token is unknown here" if token else "this server lets in only who has a token"
            return Denied("token", f"{words}; ask for a new link")
        if reason := why_not(found, now_s):
            return Denied("token", f"this token {reason}; ask for a new link")
        return granted(role, room, found.role, found.id, found.room, found.user, found.device)

    def shown(self, token: str, now_s: float) -> str | None:
        """Return the id of this token, used or not; None where it is unknown, revoked or expired."""
        found = self._known(token)
        return None if found is None or found.revoked is not None or found.expired(now_s) else found.id

    @functools.cached_property
    def _by_hash(self) -> dict[str, Token]:
        return {token.hash: token for token in self.tokens}

    def _known(self, token: str) -> Token | None:
        """Look a token up by its hash: the time that takes tells of hashes alone, whose tokens nobody can guess."""
        return self._by_hash.get(token_hash(token))

    def key(self, kid: str) -> TokenKey | None:
        """Return the key of signed tokens with this name, None for none."""
        return next((key for key in self.keys if key.kid == kid), None)

    def add_key(self, key: TokenKey) -> "TokenBook":
        """Return the book with a key more. Raises TokenError."""
        if self.key(key.kid) is not None:
            raise TokenError(
                f"there is a key {key.kid} already; give the new one another name, or remove that one first"
            )
        if len(self.keys) >= MOST_KEYS:
            raise TokenError(f"there are {len(self.keys)} keys, and at most {MOST_KEYS} are kept; remove some first")
        return replace(self, keys=(*self.keys, key))

    def remove_key(self, kid: str) -> "TokenBook":
        """Return the book without a key. Raises UnknownTokenError."""
        if self.key(kid) is None:
            there = ", ".join(key.kid for key in self.keys)
            raise UnknownTokenError(f"there is no key {kid}; there is: {there or 'none'}")
        return replace(self, keys=tuple(key for key in self.keys if key.kid != kid))

    def spend(self, jti: str, what: Literal["use", "revoke"], until: float, now_s: float) -> "TokenBook":
        """Return the book with a signed token used up or revoked; an earlier date stays. Raises TokenError if it is full.

        until: when it has expired anyway; those of which that has come are forgotten
        """
        before, at_s = self.spent_of(jti), int(now_s)
        used = before.used if before else None
        revoked = before.revoked if before else None
        if what == "use" and used is None:
            used = at_s
        elif what == "revoke" and revoked is None:
            revoked = at_s
        else:
            return self
        until = max(int(until) + 1, before.until if before else 0)
        kept = tuple(each for each in self.spent if each.until > now_s and each.jti != jti)
        if len(kept) >= MOST_SPENT:
            raise TokenError(
                f"{len(kept)} signed tokens are kept as used or revoked, and no more can be before one has expired; "
                "remove the key that they are signed by (cogrip token keys remove)"
            )
        return replace(self, spent=(*kept, SpentToken(jti=jti, until=until, used=used, revoked=revoked)))

    def spent_of(self, jti: str) -> SpentToken | None:
        """Return what is kept of a signed token, None for nothing."""
        return self._by_jti.get(jti)

    def why_spent(self, jti: str, now_s: float, *, once: bool) -> str:
        """Return why a signed token is void, "" if it is good. once: it is good for one time."""
        spent = self.spent_of(jti)
        if spent is not None and spent.revoked is not None:
            return f"was revoked at {date_text(spent.revoked)}"
        if spent is not None and spent.used is not None:
            return _USED
        full = once and len(self.spent) >= MOST_ONCE <= add_integers(each.until > now_s for each in self.spent)
        return "is good for one time, and no more of those can be remembered here before others expire" if full else ""

    def close_room(self, room: str, now_s: float) -> "TokenBook":
        """Return the book in which signed tokens that were made for this room until now are void."""
        before = self.closed_at(room)
        if before is not None and before >= int(now_s):
            return self
        kept = [each for each in self.closed if each.at > now_s - SPENT_S and each.room != room]
        return replace(self, closed=(*kept[-MOST_CLOSED + 1 :], ClosedRoom(room=room, at=int(now_s))))

    def closed_at(self, room: str) -> int | None:
        """Return when this room was closed last; None where that is not known, or longer ago than any token lasts."""
        return next((each.at for each in self.closed if each.room == room), None)

    @functools.cached_property
    def _by_jti(self) -> dict[str, SpentToken]:
        return {each.jti: each for each in self.spent}

    def standing(self, secret: bytes, rooms: Sequence[str], now_s: float) -> tuple["TokenBook", list[StartLink]]:
        """Return the book with the tokens that a start prints, one for each role and room, and these tokens.

        They are derived from `secret`, so that every start prints the same ones and only hashes are kept; where one was
        revoked its successor takes its place.
        """
        book, links = self, []
        for room in rooms:
            for role in get_args(Role):
                book, link = book._start_link(secret, role, room, now_s)
                links.append(link)
        return book, links

    def _start_link(self, secret: bytes, role: Role, room: str, now_s: float) -> tuple["TokenBook", StartLink]:
        generation = 0
        while True:
            token = derived_token(secret, role, room, generation)
            hashed = token_hash(token)
            known = next((known for known in self.tokens if known.id == hashed[:8]), None)
            if known is None:
                book, _ = self.new(token, now_s, role=role, room=room, note=START_NOTE, start=True)
                return book, StartLink(role, room, hashed[:8], token)
            if known.revoked is None and known.start and hmac.compare_digest(known.hash, hashed):
                return self, StartLink(role, room, known.id, token)
            generation += 1

    def _with(self, changed: Token) -> "TokenBook":
        return replace(self, tokens=tuple(changed if token.id == changed.id else token for token in self.tokens))

    def _room_for_one(self, room: str, now_s: float) -> tuple[Token, ...]:
        """Return the tokens, without the oldest void ones if there are too many; revoked start links stay void."""
        tokens = self.tokens
        for whose, most in ((room, MOST_TOKENS), (None, MOST_IN_BOOK)):
            there = [token for token in tokens if whose is None or token.room == whose]
            excess = len(there) + 1 - most
            if excess <= 0:
                continue
            dead = [token.id for token in there if not token.start and token.state(now_s) != "good"][:excess]
            if len(dead) < excess:
                of = "in all" if whose is None else f"for room {whose}" if whose else "for any room"
                raise TokenError(f"there are {len(there)} tokens {of}, and at most {most} are kept; revoke some first")
            void = frozenset(dead)
            tokens = tuple(token for token in tokens if token.id not in void)
        return tokens


def granted(role: Role, asked: str, for_role: Role, ident: str, room: str, user: str, device: str) -> Grant | Denied:
    """Return what a good token grants whoever asks as `role` for the room `asked`. for_role to device: what the token is for"""
    if room and asked not in ("", room):
        return Denied("room", f"this token is for room {room!r}, not {asked!r}; use the link as it is")
    if "observer" in (role, for_role):  # holds nothing, so that seat and device do not matter
        return Grant("observer", ident, room)
    return Grant(role, ident, room, user, device)


def is_jti(ident: str) -> bool:
    """Return whether a public id is that of a signed token."""
    return bool(_JTI.match(ident))


def why_not(token: Token, now_s: float) -> str:
    """Return why a token is void, "" if it is good."""
    state = token.state(now_s)
    if state == "revoked":
        return f"was revoked at {date_text(token.revoked or 0)}"
    if state == "used":
        return _USED
    return f"has expired, at {date_text(token.expires or 0)}" if state == "expired" else ""


def token_hash(token: str) -> str:
    """Return what is kept of a token. It has 128 random bits, so one round is enough."""
    return hashlib.sha256(token.encode("utf-8", "surrogatepass")).hexdigest()


def derived_token(secret: bytes, role: Role, room: str, generation: int) -> str:
    """Return the standing token of a role and room: HMAC-SHA256, cut to 128 bits, in base64url."""
    message = b"cogrip start link " + msgspec.json.encode([role, room, generation])
    return urlsafe_b64encode(hmac.digest(secret, message, "sha256")[:16]).decode().rstrip("=")


def date_text(unix_s: float) -> str:
    """Return a date such as 2026-12-24 18:00 UTC."""
    return f"{datetime.fromtimestamp(unix_s, UTC):%Y-%m-%d %H:%M} UTC"


class _Versioned(msgspec.Struct):
    version: Any = None


class _Texts(msgspec.Struct, forbid_unknown_fields=True):
    """A book whose tokens are not decoded yet."""

    version: Any = VERSION
    tokens: list[msgspec.Raw] = []
    keys: Annotated[tuple[TokenKey, ...], msgspec.Meta(max_length=MOST_KEYS)] = ()
    spent: list[msgspec.Raw] = []
    closed: Annotated[tuple[ClosedRoom, ...], msgspec.Meta(max_length=MOST_CLOSED)] = ()


_token_of = msgspec.json.Decoder(Token).decode
_spent_of = msgspec.json.Decoder(SpentToken).decode


class BookReading:
    """Reading of the JSON text of a book, some tokens at a time. Raises TokenError, and nothing else, for any other text.

    known: tokens by their text, as an earlier reading has them in `texts`: those that are there again are not decoded again
    """

    def __init__(self, data: bytes, known: Mapping[bytes, Token | SpentToken] | None = None) -> None:
        try:
            version = msgspec.json.decode(data, type=_Versioned).version
            if version != VERSION or isinstance(version, bool):
                raise TokenError(f"version = {repr(version)[:20]}, and this cogrip knows {VERSION}")
            read = msgspec.json.decode(data, type=_Texts)
            self._texts = [bytes(text) for text in (*read.tokens, *read.spent)]
            self._keys, self._closed, self._tokens = read.keys, read.closed, len(read.tokens)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise TokenError(_readable(error)) from None
        known = known or {}
        self.texts = {text: known[text] for text in self._texts if text in known}
        self._left = [number for number, text in enumerate(self._texts) if text not in known]
        self._left.reverse()

    @property
    def left(self) -> int:
        """Return how many tokens are still to be decoded."""
        return len(self._left)

    def read(self, most: int) -> None:
        """Decode some tokens more."""
        for _ in range(min(most, self.left)):
            number = self._left.pop()
            stored = number < self._tokens
            place = f"tokens[{number}]" if stored else f"spent[{number - self._tokens}]"
            try:
                token = (_token_of if stored else _spent_of)(self._texts[number])
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
                raise TokenError(_readable(error, place)) from None
            if isinstance(token, Token) and token.id != token.hash[:8]:
                raise TokenError(f"token {token.id}: its id is not the beginning of its hash")
            self.texts[self._texts[number]] = token

    def book(self) -> TokenBook:
        """Return the book, once nothing is left. Raises TokenError where a token stands twice."""
        seen: set[str] = set()
        whole = [self.texts[text] for text in self._texts]
        tokens = tuple(each for each in whole[: self._tokens] if isinstance(each, Token))
        spent = tuple(each for each in whole[self._tokens :] if isinstance(each, SpentToken))
        if len(tokens) + len(spent) < len(whole):
            raise TokenError("a token stands where another kind of token must")
        for name in (
            *(each.id for each in tokens),
            *(each.jti for each in spent),
            *(f"key {key.kid}" for key in self._keys),
        ):
            if name in seen:
                raise TokenError(f"token {name} stands twice")
            seen.add(name)
        return TokenBook(tokens=tokens, keys=self._keys, spent=spent, closed=self._closed)


def encode_book(book: TokenBook) -> bytes:
    """Return the book as JSON text, a token a line; keys and spent tokens where there are any."""
    parts = [b'"%b":[\n%b\n]' % (name, b",\n".join(map(msgspec.json.encode, rows))) for name, rows in (
        (b"tokens", book.tokens), (b"keys", book.keys), (b"spent", book.spent), (b"closed", book.closed)
    ) if rows or name == b"tokens"]  # fmt: skip
    return b'{"version":%d,%b}\n' % (book.version, b",".join(parts))


def decode_book(data: bytes) -> TokenBook:
    """Return the book in JSON text. Raises TokenError, and nothing else, for anything that is not exactly one."""
    reading = BookReading(data)
    reading.read(reading.left)
    return reading.book()


def _readable(error: Exception, place: str = "") -> str:
    """Return msgspec's text, the path first. place: where in the book the text is that is wrong"""
    text, _, where = str(error).partition(" - at `$")
    path = f"{place}{where.rstrip('`')}".removeprefix(".")
    return f"{path}: {text}" if path else text
