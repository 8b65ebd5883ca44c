"""Signers of tokens for tests, and what they sign."""

import hashlib
import hmac
import json
from base64 import urlsafe_b64encode
from typing import Any

from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from cogrip.server.admission.token_keys import TokenKey, read_keys

NOW_S = 1_800_000_000
FINGERPRINT = "0123456789abcdef" * 4
SECRET = "5f" * 32  # a secret of the form that `openssl rand -hex 32` writes
JTI = "7d2f8a40c1e94b53"


def claims(**changed: Any) -> dict[str, Any]:
    """Return claims that are good at NOW_S, with changes; None leaves one out."""
    good = {"aud": FINGERPRINT, "iat": NOW_S, "exp": NOW_S + 600, "jti": JTI, "room": "lab", "role": "player"}
    return {name: value for name, value in {**good, **changed}.items() if value is not None}


def part(content: object) -> str:
    """Return one part of a token; bytes as they are, anything else in JSON."""
    data = content if isinstance(content, bytes) else json.dumps(content, separators=(",", ":")).encode()
    return urlsafe_b64encode(data).decode().rstrip("=")


class Signer:
    """An Ed25519 key pair. Its tokens are put together by hand here, so that they may be wrong in any way."""

    algorithm = "EdDSA"

    def __init__(self, kid: str = "uni", seed: int = 1) -> None:
        self.kid, self.private = kid, Ed25519PrivateKey.from_private_bytes(bytes([seed]) * 32)

    @property
    def pem(self) -> bytes:
        """The public key."""
        return self.private.public_key().public_bytes(
            serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
        )

    @property
    def private_pem(self) -> bytes:
        return self.private.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )

    def key(self, audience: str = "") -> TokenKey:
        """Return the key as a server keeps it."""
        (key,) = read_keys(self.pem, self.kid, audience, NOW_S)
        return key

    def header(self, **changed: Any) -> dict[str, Any]:
        good = {"alg": self.algorithm, "kid": self.kid, "typ": "JWT"}
        return {name: value for name, value in {**good, **changed}.items() if value is not None}

    def signature(self, data: bytes) -> bytes:
        return self.private.sign(data)

    def token(self, content: object = None, header: object = None, **changed: Any) -> str:
        """Return a token. content: claims, good ones with `changed` if not given; header likewise"""
        parts = f"{part(self.header() if header is None else header)}.{part(claims(**changed) if content is None else content)}"
        return f"{parts}.{part(self.signature(parts.encode()))}"


class SecretSigner(Signer):
    """A shared secret, for HS256."""

    algorithm = "HS256"

    def __init__(self, kid: str = "app", secret: bytes = SECRET.encode()) -> None:
        super().__init__(kid)
        self.secret = secret

    def key(self, audience: str = "") -> TokenKey:
        (key,) = read_keys(self.secret, self.kid, audience, NOW_S)
        return key

    def signature(self, data: bytes) -> bytes:
        return hmac.digest(self.secret, data, hashlib.sha256)
