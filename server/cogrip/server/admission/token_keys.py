"""Keys by which a server knows signed tokens that others mint: Ed25519 public keys, and shared secrets.

The key says which algorithm holds; a token's own header never does.
"""

import re
from base64 import urlsafe_b64decode, urlsafe_b64encode
from typing import Annotated, Any, Literal

import msgspec

KID_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,39}\Z"
MOST_KEYS = 16  # most keys of a server
LEAST_SECRET_BITS = 256
MOST_SECRET_BYTES = 256
MOST_FILE_BYTES = 65536  # longest file of keys that is read
_HEX, _BASE64 = re.compile(r"[0-9a-fA-F]+\Z"), re.compile(r"[A-Za-z0-9+/_-]+={0,2}\Z")

Kid = Annotated[str, msgspec.Meta(pattern=KID_PATTERN)]
Algorithm = Literal["EdDSA", "HS256"]
Audience = Annotated[str, msgspec.Meta(max_length=100, pattern=r"^[!-~]*\Z")]


class KeyFileError(ValueError):
    """A file holds no key that can be used. The text says what it holds and the cure, and shows nothing of it."""


class TokenKey(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One key as it is kept. No field has a default: one that is missing in a file must not widen what it allows."""

    kid: Kid  # name of the key, as the header of its tokens has it
    algorithm: Algorithm
    key: Annotated[str, msgspec.Meta(max_length=400, pattern=r"^[A-Za-z0-9_-]+\Z")]  # base64url: public key, or secret
    audience: Audience  # what `aud` may say instead of the server's fingerprint; "" nothing else
    added: Annotated[int, msgspec.Meta(ge=-62_135_596_800, le=253_402_300_799)]  # Unix seconds

    def __post_init__(self) -> None:
        """Raises ValueError for a key that is none."""
        try:
            size = len(self.bytes)
        except ValueError:
            size = 0
        if size != 32 if self.algorithm == "EdDSA" else not 32 <= size <= MOST_SECRET_BYTES:
            raise ValueError(f"the key {self.kid} is no key for {self.algorithm}")

    @property
    def bytes(self) -> bytes:
        """The public key, or the secret."""
        return from_base64url(self.key)

    def __repr__(self) -> str:
        return f"TokenKey(kid={self.kid!r}, algorithm={self.algorithm!r}, audience={self.audience!r})"

    def __rich_repr__(self) -> list[tuple[str, Any]]:
        return [("kid", self.kid), ("algorithm", self.algorithm), ("audience", self.audience)]


class _Jwk(msgspec.Struct):
    """A JSON Web Key (RFC 7517, 8037), as far as it matters here."""

    kty: str
    crv: str = ""
    x: str = ""
    k: str = ""
    d: str = ""
    kid: str = ""
    alg: str = ""


class _Jwks(msgspec.Struct):
    keys: list[_Jwk]


def read_keys(data: bytes, kid: str, audience: str, now_s: float) -> list[TokenKey]:
    """Return the keys in a file: a PEM public key, a JSON Web Key or a set of them, or a secret as one line of hexadecimal
    digits or base64. kid: name for it, "" as the file says. Raises KeyFileError.
    """
    if len(data) > MOST_FILE_BYTES:
        raise KeyFileError(f"{len(data)} bytes are more than {MOST_FILE_BYTES}; give a file with a key alone")
    text = data.strip()
    if text.startswith(b"-----BEGIN"):
        found: list[tuple[str, Algorithm, bytes]] = [("", "EdDSA", _of_pem(text))]
    elif text.startswith(b"{"):
        found = _of_json(text)
    else:
        found = [("", "HS256", _of_line(text))]
    if kid and len(found) > 1:
        raise KeyFileError(f"it has {len(found)} keys, and --kid names one: leave it out, and each keeps its own name")
    keys = []
    for own, algorithm, key in found:
        name = kid or own
        if not re.match(KID_PATTERN, name):
            why = "has no name" if not name else "has a name that cannot be used"
            raise KeyFileError(
                f"a key {why}: give one by --kid, of at most 40 letters, digits and . _ -, a letter or digit first"
            )
        encoded = urlsafe_b64encode(key).decode().rstrip("=")
        keys.append(TokenKey(kid=name, algorithm=algorithm, key=encoded, audience=audience, added=int(now_s)))
    return keys


def _of_pem(text: bytes) -> bytes:
    from jwt.algorithms import OKPAlgorithm  # OpenSSL takes a while
    from jwt.exceptions import PyJWTError

    if b"PRIVATE KEY" in text.partition(b"\n")[0]:
        raise KeyFileError(
            "it holds a private key, which stays where tokens are minted: `openssl pkey -in FILE -pubout` gives the public one"
        )
    try:
        jwk = OKPAlgorithm.to_jwk(OKPAlgorithm().prepare_key(text), as_dict=True)
    except (PyJWTError, ValueError, TypeError):
        jwk = {}
    if jwk.get("crv") != "Ed25519":
        raise KeyFileError(
            "it holds no Ed25519 public key: `openssl genpkey -algorithm ed25519 -out FILE` makes a private key, "
            "`openssl pkey -in FILE -pubout` gives its public one"
        )
    return from_base64url(jwk["x"])


def _of_json(text: bytes) -> list[tuple[str, Algorithm, bytes]]:
    try:
        keys = (
            msgspec.json.decode(text, type=_Jwks).keys if b'"keys"' in text else [msgspec.json.decode(text, type=_Jwk)]
        )
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        raise KeyFileError("it is neither a JSON Web Key nor a set of them") from None
    if not 0 < len(keys) <= MOST_KEYS:
        raise KeyFileError(f"it has {len(keys)} keys, and 1 to {MOST_KEYS} are taken")
    return [(each.kid, *_of_jwk(each)) for each in keys]


def _of_jwk(jwk: _Jwk) -> tuple[Algorithm, bytes]:
    if jwk.d:
        raise KeyFileError("it holds a private key (d), which stays where tokens are minted: give the public one")
    algorithm: Algorithm = "HS256" if jwk.kty == "oct" else "EdDSA"
    if jwk.kty not in ("oct", "OKP") or (jwk.kty == "OKP" and jwk.crv != "Ed25519"):
        raise KeyFileError("a JSON Web Key is neither of Ed25519 (kty OKP, crv Ed25519) nor a secret (kty oct)")
    if jwk.alg not in ("", algorithm, "Ed25519" if jwk.kty == "OKP" else ""):
        raise KeyFileError(f"a JSON Web Key is for another algorithm than {algorithm}; give one for that")
    try:
        key = from_base64url(jwk.k if jwk.kty == "oct" else jwk.x)
    except ValueError:
        key = b""
    if algorithm == "EdDSA" and len(key) != 32:
        raise KeyFileError("a JSON Web Key of Ed25519 has no x of 32 bytes")
    if algorithm == "HS256":
        _check_secret(8 * len(key), len(key))
    return algorithm, key


def _of_line(text: bytes) -> bytes:
    """Return a secret: the characters of the line, as whoever mints gives them to a library."""
    line = text.decode("ascii", "replace")
    if not _BASE64.match(line):
        raise KeyFileError(
            "it holds neither a PEM public key, a JSON Web Key, nor a secret in one line of hexadecimal digits or base64, such "
            "as `openssl rand -hex 32` gives"
        )
    _check_secret(len(line) * (4 if _HEX.match(line) else 6), len(line))
    return text


def _check_secret(bits: int, size: int) -> None:
    if bits < LEAST_SECRET_BITS:
        raise KeyFileError(
            f"a shared secret has {bits} bits at most, and at least {LEAST_SECRET_BITS} are needed: `openssl rand -hex 32`"
        )
    if size > MOST_SECRET_BYTES:
        raise KeyFileError(f"a shared secret has {size} bytes, and at most {MOST_SECRET_BYTES} are taken")


def from_base64url(text: str) -> bytes:
    """Return the bytes in base64url without its padding. Raises ValueError."""
    return urlsafe_b64decode(text.encode("ascii") + b"=" * (-len(text) % 4))
