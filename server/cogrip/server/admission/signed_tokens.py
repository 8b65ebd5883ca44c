"""Signed tokens: JSON Web Tokens (RFC 7519) that others mint, such as the login of a university (`SPEC.md` section 12.1).

What one allows stands in it. Its key says by which algorithm it is signed. Dates are Unix seconds, handed in.
"""

import hashlib
import re
from collections import OrderedDict
from collections.abc import Callable
from typing import Annotated

import msgspec
from jwt import PyJWK, PyJWS
from jwt.algorithms import OKPAlgorithm
from jwt.exceptions import PyJWTError
from msgspec.structs import replace

from cogrip.protocol.wire.messages import MOST_TOKEN, Bound, Role
from cogrip.server.admission.admission import Denied, Grant
from cogrip.server.admission.token_keys import KID_PATTERN, Algorithm, TokenKey, from_base64url
from cogrip.server.admission.tokens import (
    SPENT_S,
    DeviceOrAny,
    Jti,
    NameOrAny,
    TokenBook,
    UnixSeconds,
    date_text,
    granted,
)
from cogrip.server.rate_limit import SIGNATURES, Buckets

LEEWAY_S = 30  # seconds by which the clocks of the mint and of the server may differ
MOST_LIFE_S = 86_400  # longest time from `iat` to `exp`
MOST_KNOWN = 4096  # most tokens that are remembered as checked; those that were shown longest ago are forgotten first
_ALGORITHM = re.compile(r"[A-Za-z0-9-]{1,20}\Z")
_NAMES: dict[Algorithm, tuple[str, ...]] = {"EdDSA": ("EdDSA", "Ed25519"), "HS256": ("HS256",)}
"""Names that a header may give a key's algorithm: RFC 9864 calls EdDSA by its curve."""
_jws = PyJWS(algorithms=["EdDSA", "HS256"])
_jws.register_algorithm("Ed25519", OKPAlgorithm())


class SignedTokenError(ValueError):
    """A signed token admits nobody. The text says why, and continues "this token"."""


class Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Header of a token. Others, such as `crit` and `jwk`, are refused."""

    alg: str
    kid: str
    typ: str = ""


class Claims(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Claims of a token. One that is not known may be meant to narrow what it allows, and is refused."""

    # the server's fingerprint, or the audience of the key
    aud: Annotated[str, msgspec.Meta(min_length=1, max_length=100)]
    exp: UnixSeconds
    iat: UnixSeconds
    nbf: UnixSeconds = 0
    jti: Jti  # public id of the token
    room: NameOrAny  # name of the room; "" any
    role: Role
    seat: NameOrAny = ""  # name of the seat; "" any
    device: DeviceOrAny = ""  # beginning of the device address that may be claimed; "" any
    force_n: Bound = 0.0  # most force and speed that the device record may claim; 0 the room's own bounds
    speed_mps: Bound = 0.0
    once: bool = False
    iss: Annotated[str, msgspec.Meta(max_length=200)] = ""  # for whoever mints: not looked at
    sub: Annotated[str, msgspec.Meta(max_length=200)] = ""


class Signed(msgspec.Struct, frozen=True):
    """Token whose signature is right: what it claims, and the key."""

    key: TokenKey
    claims: Claims


_claims_of = msgspec.json.Decoder(Claims).decode
_header_of = msgspec.json.Decoder(Header).decode


def check_signature(token: str, book: TokenBook) -> Signed:
    """Return the claims of a token whose signature is right. Raises SignedTokenError. It takes some 0.16 ms with Ed25519."""
    if len(token) > MOST_TOKEN:
        raise SignedTokenError(f"has {len(token)} characters, and at most {MOST_TOKEN} fit a hello")
    parts = token.split(".")
    if len(parts) != 3:
        raise SignedTokenError(f"has {len(parts)} parts, and a signed one has three")
    try:
        header = _header_of(from_base64url(parts[0]))
    except (ValueError, RecursionError):
        raise SignedTokenError("has another header than alg, kid and typ, in JSON") from None
    if not re.match(KID_PATTERN, header.kid) or (key := book.key(header.kid)) is None:
        named = repr(header.kid) if re.match(KID_PATTERN, header.kid) else "of a name that no key has"
        raise SignedTokenError(f"is signed by a key that this server does not know ({named})")
    if header.alg not in _NAMES[key.algorithm]:
        said = header.alg if _ALGORITHM.match(header.alg) else "something else"
        raise SignedTokenError(f"says that it is signed by {said}, and the key {key.kid!r} is for {key.algorithm}")
    jwk = {"kty": "OKP", "crv": "Ed25519", "x": key.key} if key.algorithm == "EdDSA" else {"kty": "oct", "k": key.key}
    try:
        payload = _jws.decode(token, PyJWK(jwk, key.algorithm).key, algorithms=[header.alg])
    except (PyJWTError, ValueError):
        raise SignedTokenError(f"has no signature by the key {key.kid!r}") from None
    try:
        return Signed(key, _claims_of(payload))
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        text, _, where = str(error).partition(" - at `$")
        raise SignedTokenError(f"has claims that cannot be: {where.strip('.`') or 'claims'}: {text}") from None


def check_claims(signed: Signed, audience: str, now_s: float, book: TokenBook) -> None:
    """Check a token against place, date and rooms that were closed. Raises SignedTokenError.

    audience: fingerprint of this server
    """
    claims = signed.claims
    if claims.aud not in {audience, signed.key.audience} - {""}:
        raise SignedTokenError("is for another server (aud)")
    if claims.exp - claims.iat > MOST_LIFE_S:
        raise SignedTokenError(f"is good for {claims.exp - claims.iat} s, and at most {MOST_LIFE_S} s are allowed")
    begins = max(claims.iat, claims.nbf)
    if now_s < begins - LEEWAY_S:
        raise SignedTokenError(f"is good from {date_text(begins)} on, and here it is {date_text(now_s)}")
    if now_s >= claims.exp + LEEWAY_S:
        raise SignedTokenError(f"has expired, at {date_text(claims.exp)}")
    if (closed := book.closed_at(claims.room)) is not None and claims.iat <= closed + LEEWAY_S:
        raise SignedTokenError(f"was made before its room was closed, at {date_text(closed)}")


class SignedTokens:
    """Judge of signed tokens at one server. It remembers those whose signature was right, so that whoever comes back costs
    nothing, and checks at most `SIGNATURES` others a second.

    audience  fingerprint of this server
    """

    def __init__(self, audience: str, clock_ns: Callable[[], int]) -> None:
        self._audience, self._clock_ns = audience, clock_ns
        self._budget = Buckets(1, SIGNATURES)
        self._known: OrderedDict[bytes, Signed] = OrderedDict()  # by SHA-256 of the token
        self._void: set[str] = set()
        self._keys: tuple[TokenKey, ...] = ()  # with which `_void` was made

    def admit(self, token: str, role: Role, room: str, book: TokenBook, now_s: float) -> Grant | Denied | None:
        """Answer a hello with this token. None where too many come: it comes again."""
        try:
            signed = self._checked(token, book)
            if signed is None:
                return None
            check_claims(signed, self._audience, now_s, book)
        except SignedTokenError as error:
            return Denied("token", f"this token {error}; ask for a new link")
        claims = signed.claims
        if why := book.why_spent(claims.jti, now_s, once=claims.once):
            return Denied("token", f"this token {why}; ask for a new link")
        grant = granted(role, room, claims.role, claims.jti, claims.room, claims.seat, claims.device)
        if isinstance(grant, Grant) and grant.role == "player":
            grant = replace(grant, force_n=claims.force_n, speed_mps=claims.speed_mps)
        return grant

    def shown(self, token: str, book: TokenBook, now_s: float) -> str | None:
        """Return the id of this token, used or not; None where it is not good, or is to come again."""
        try:
            signed = self._checked(token, book)
            if signed is None:
                return None
            check_claims(signed, self._audience, now_s, book)
        except SignedTokenError:
            return None
        spent = book.spent_of(signed.claims.jti)
        return None if spent is not None and spent.revoked is not None else signed.claims.jti

    def used_until(self, jti: str, now_s: float) -> float | None:
        """Return until when a token that was used is to be known as used up; None where it is not good for one time.

        One that is not remembered any more may be good for one time, and lasts as long as any.
        """
        claims = [each.claims for each in self._known.values() if each.claims.jti == jti]
        if not claims:
            return now_s + SPENT_S
        return max((each.exp + LEEWAY_S for each in claims if each.once), default=None)

    def void(self, book: TokenBook) -> set[str]:
        """Return the ids of remembered tokens whose key has gone."""
        if book.keys != self._keys:
            self._keys = book.keys
            self._void = {each.claims.jti for each in self._known.values() if book.key(each.key.kid) != each.key}
        return self._void

    def _checked(self, token: str, book: TokenBook) -> Signed | None:
        """Return what the token claims; None where the budget is spent. Raises SignedTokenError."""
        digest = hashlib.sha256(token.encode("utf-8", "surrogatepass")).digest()
        signed = self._known.get(digest)
        if not book.keys:
            raise SignedTokenError("is a signed one, and this server has no key for those")
        if signed is None or book.key(signed.key.kid) != signed.key:
            if not self._budget.take(0, self._clock_ns()):
                return None
            signed = self._known[digest] = check_signature(token, book)
            if len(self._known) > MOST_KNOWN:
                self._known.popitem(last=False)
        self._known.move_to_end(digest)
        return signed
