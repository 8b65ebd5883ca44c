"""Files of keys for signed tokens: what is taken, and what is refused without showing any of it."""

import json
from base64 import urlsafe_b64encode
from contextlib import suppress
from typing import Any

import msgspec
import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec, ed448, rsa
from hypothesis import given
from hypothesis import strategies as st
from joserfc.jwk import KeySet, OctKey, OKPKey

from cogrip.server.admission.token_keys import MOST_KEYS, KeyFileError, TokenKey, read_keys
from cogrip.server.admission.tokens import (
    MOST_CLOSED,
    SPENT_S,
    TokenBook,
    TokenError,
    UnknownTokenError,
    decode_book,
    encode_book,
)

from tests.server.signers import JTI, NOW_S, SECRET, SecretSigner, Signer

UNI = Signer()
X = "11qYAYKxCrfVS_7TyWQHOg7hcvPapiMlrwIaaPcHURo"  # RFC 8037, appendix A.2
JWK = {"kty": "OKP", "crv": "Ed25519", "x": X, "kid": "rfc8037"}


def read(data: bytes | dict[str, Any], kid: str = "", audience: str = "") -> list[TokenKey]:
    return read_keys(data if isinstance(data, bytes) else json.dumps(data).encode(), kid, audience, NOW_S)


def pem_of(key: Any) -> bytes:
    return key.public_key().public_bytes(serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo)  # type: ignore[no-any-return]


def oct_of(bits: int) -> dict[str, str]:
    return {"kty": "oct", "k": urlsafe_b64encode(b"k" * (bits // 8)).decode().rstrip("="), "kid": "o"}


def test_a_public_key_in_pem() -> None:
    (key,) = read(b"\n" + UNI.pem + b"\n", "uni", "lab.example")
    assert (key.kid, key.algorithm, key.audience, key.added) == ("uni", "EdDSA", "lab.example", NOW_S)
    assert key.bytes == UNI.private.public_key().public_bytes_raw()


def test_a_json_web_key_and_a_set_of_them_as_another_library_writes_it() -> None:
    (key,) = read(JWK)
    assert (key.kid, key.algorithm, key.key) == ("rfc8037", "EdDSA", X)
    assert read(JWK, "mine")[0].kid == "mine"
    first, second = (OKPKey.generate_key("Ed25519", {"kid": kid, "use": "sig", "alg": "EdDSA"}) for kid in ("a", "b"))
    shared = OctKey.generate_key(256, {"kid": "c"})
    keys = read(KeySet([first, second, shared]).as_dict(private=False) | {"keys": [
        first.as_dict(private=False), second.as_dict(private=False), shared.as_dict(private=True)]})  # fmt: skip
    assert [(each.kid, each.algorithm) for each in keys] == [("a", "EdDSA"), ("b", "EdDSA"), ("c", "HS256")]
    assert keys[0].bytes == first.public_key.public_bytes_raw()
    assert keys[2].bytes == shared.raw_value


@pytest.mark.parametrize("line", [SECRET, "Ag" * 21 + "g", "Ab+/" * 11, "Ab-_" * 10 + "Ab0="])
def test_a_secret_is_the_characters_of_its_line(line: str) -> None:
    (key,) = read(f"{line}\n".encode(), "app")
    assert (key.algorithm, key.bytes) == ("HS256", line.encode())


REFUSED: dict[str, tuple[bytes | dict[str, Any], str, str]] = {
    "a private key": (UNI.private_pem, "k", "it holds a private key, which stays where tokens are minted: `openssl pkey"),
    "a private one, JSON": (JWK | {"d": X}, "", "it holds a private key (d)"),
    "RSA": (pem_of(rsa.generate_private_key(65537, 2048)), "k", "it holds no Ed25519 public key: `openssl genpkey"),
    "P-256": (pem_of(ec.generate_private_key(ec.SECP256R1())), "k", "it holds no Ed25519 public key"),
    "Ed448": (pem_of(ed448.Ed448PrivateKey.generate()), "k", "it holds no Ed25519 public key"),
    "a broken one": (b"-----BEGIN PUBLIC KEY-----\nAAAA\n-----END PUBLIC KEY-----", "k", "it holds no Ed25519 public key"),
    "a certificate": (b"-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----", "k", "it holds no Ed25519 public"),
    "X25519, JSON": (JWK | {"crv": "X25519"}, "", "neither of Ed25519 (kty OKP, crv Ed25519) nor a secret"),
    "RSA, JSON": ({"kty": "RSA", "n": "AQAB", "e": "AQAB", "kid": "r"}, "", "neither of Ed25519"),
    "for another algorithm": (oct_of(512) | {"alg": "HS512"}, "", "for another algorithm than HS256"),
    "31 bytes": (JWK | {"x": X[:-2]}, "", "has no x of 32 bytes"),
    "no bytes": (JWK | {"x": "é"}, "", "has no x of 32 bytes"),
    "248 bits": (oct_of(248), "", "a shared secret has 248 bits at most, and at least 256 are needed: `openssl rand -hex 32`"),
    "257 bytes": (oct_of(8 * 257), "", "a shared secret has 257 bytes, and at most 256 are taken"),
    "63 digits": (SECRET[:63].encode(), "k", "a shared secret has 252 bits at most"),
    "42 letters": (b"A" * 41 + b"g", "k", "a shared secret has 252 bits at most"),
    "a passphrase": (b"correct horse battery staple, and then some more of it", "k", "it holds neither a PEM public key"),
    "two lines": (SECRET.encode() + b"\n" + SECRET.encode(), "k", "it holds neither a PEM public key"),
    "nothing": (b" \n", "k", "it holds neither a PEM public key"),
    "no name": (UNI.pem, "", "a key has no name: give one by --kid"),
    "a name that is none": (UNI.pem, "a/b", "a key has a name that cannot be used"),
    "a long name": (UNI.pem, "k" * 41, "a key has a name that cannot be used"),
    "one name for two": ({"keys": [JWK, JWK]}, "k", "it has 2 keys, and --kid names one"),
    "no keys": ({"keys": []}, "", f"it has 0 keys, and 1 to {MOST_KEYS} are taken"),
    "many keys": ({"keys": [JWK] * (MOST_KEYS + 1)}, "", f"it has 17 keys, and 1 to {MOST_KEYS} are taken"),
    "no JSON": (b"{", "", "it is neither a JSON Web Key nor a set of them"),
    "brackets": (b'{"keys":' + b"[" * 9000, "", "it is neither a JSON Web Key nor a set of them"),
    "too long": (b"A" * 70_000, "k", "70000 bytes are more than 65536"),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_no_key_is_refused_in_words(what: str) -> None:
    data, kid, words = REFUSED[what]
    with pytest.raises(KeyFileError) as caught:
        read(data, kid)
    assert words in str(caught.value)
    assert SECRET[:20] not in str(caught.value)
    assert X[:10] not in str(caught.value)


@given(st.binary(max_size=80) | st.text(max_size=80).map(str.encode))
def test_any_file_is_read_or_refused(data: bytes) -> None:
    for begin in (b"", b"-----BEGIN PUBLIC KEY-----\n", b'{"kty":"OKP","crv":"Ed25519","x":"'):
        with suppress(KeyFileError):
            assert all(key.bytes for key in read(begin + data, "k"))


def test_a_key_shows_nothing_of_itself() -> None:
    assert SECRET not in repr(SecretSigner().key())
    assert X not in repr(TokenBook(keys=tuple(read(JWK))))


# --- in the book ------------------------------------------------------------------------------------------------------


def test_keys_and_void_tokens_are_written_and_read_again() -> None:
    book = TokenBook().add_key(UNI.key()).add_key(SecretSigner().key("lab"))
    book = book.spend(JTI, "use", NOW_S + 60, NOW_S).spend("another-one", "revoke", NOW_S + 60, NOW_S)
    book, _ = book.new("a" * 22, NOW_S)
    book = book.close_room("group 7", NOW_S)
    assert decode_book(encode_book(book)) == book
    assert encode_book(TokenBook()) == b'{"version":1,"tokens":[\n\n]}\n', "as before there were keys"


def test_a_name_stands_for_one_key() -> None:
    book = TokenBook().add_key(UNI.key())
    with pytest.raises(TokenError, match="there is a key uni already; give the new one another name, or remove that"):
        book.add_key(Signer(seed=2).key())
    with pytest.raises(UnknownTokenError, match="there is no key uin; there is: uni"):
        book.remove_key("uin")
    for number in range(MOST_KEYS - 1):
        book = book.add_key(Signer(f"k{number}").key())
    with pytest.raises(TokenError, match="there are 16 keys, and at most 16 are kept; remove some first"):
        book.add_key(Signer("more").key())
    assert book.remove_key("uni").key("uni") is None


def test_the_last_closed_rooms_are_kept_for_as_long_as_a_token_lasts() -> None:
    book = TokenBook()
    for number in range(MOST_CLOSED + 1):
        book = book.close_room(f"group {number}", NOW_S + number)
    assert len(book.closed) == MOST_CLOSED
    assert (book.closed_at("group 0"), book.closed_at("group 1")) == (None, NOW_S + 1)
    assert book.close_room("group 1", NOW_S + 1) is book
    again = book.close_room("group 1", NOW_S + 9000)
    assert again.closed_at("group 1") == NOW_S + 9000
    assert len(decode_book(encode_book(again)).closed) == MOST_CLOSED
    assert len(book.close_room("x", NOW_S + SPENT_S + 100).closed) == MOST_CLOSED - 100 + 1


KEY = json.dumps(msgspec.to_builtins(UNI.key()))
SPENT = f'{{"jti":"{JTI}","until":1,"used":null,"revoked":1}}'


@pytest.mark.parametrize(
    ("keys", "spent", "words"),
    [
        (f"{KEY},{KEY}", "", "key uni stands twice"),
        (KEY.replace('"uni"', '"a b"'), "", "keys[0].kid"),
        (KEY.replace("EdDSA", "none"), "", "keys[0].algorithm"),
        (KEY.replace("EdDSA", "HS256"), "", ""),
        (KEY.replace('"key": "', '"key": "AAAA'), "", "the key uni is no key for EdDSA"),
        (KEY.replace('"audience": "", ', ""), "", "missing required field `audience`"),
        ("", f"{SPENT},{SPENT}", f"token {JTI} stands twice"),
        ("", SPENT.replace(JTI, "short"), "spent[0].jti"),
        ("", SPENT.replace(',"revoked":1', ""), "spent[0]: Object missing required field `revoked`"),
    ],
)
def test_a_book_with_a_damaged_key_is_refused(keys: str, spent: str, words: str) -> None:
    text = f'{{"version":1,"tokens":[],"keys":[{keys}],"spent":[{spent}]}}'.encode()
    if not words:  # 32 bytes are a secret, too: the file is this user's own
        assert decode_book(text).keys[0].algorithm == "HS256"
        return
    with pytest.raises(TokenError) as caught:
        decode_book(text)
    assert words in str(caught.value)
