"""Records, handshake messages and key derivation of DTLS 1.2, written from the standard.

Sections are those of RFC 5246 (TLS 1.2) and RFC 6347 (DTLS 1.2) unless another document is named. Only the primitives
(AEAD, HMAC, X25519, ECDSA) come from a library: record layer, handshake and key schedule share no line with OpenSSL's.
"""

import hashlib
import hmac
from typing import Literal, NamedTuple

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM, ChaCha20Poly1305

VERSION = b"\xfe\xfd"
CHANGE_CIPHER_SPEC, ALERT, HANDSHAKE, APPLICATION_DATA = 20, 21, 22, 23  # RFC 5246 6.2.1
CLIENT_HELLO, SERVER_HELLO, HELLO_VERIFY_REQUEST, CERTIFICATE = 1, 2, 3, 11  # RFC 5246 7.4, RFC 6347 4.3.2
SERVER_KEY_EXCHANGE, SERVER_HELLO_DONE, CLIENT_KEY_EXCHANGE, FINISHED = 12, 14, 16, 20
RECORD_BYTES, MESSAGE_BYTES = 13, 12  # headers: RFC 6347 4.1, 4.2.2


class Record(NamedTuple):
    """One record as it is on the wire: `body` may be protected."""

    type: int
    epoch: int
    number: int
    body: bytes

    @property
    def place(self) -> bytes:
        """Epoch and sequence number as 8 bytes."""
        return self.epoch.to_bytes(2, "big") + self.number.to_bytes(6, "big")

    def encode(self) -> bytes:
        return bytes([self.type]) + VERSION + self.place + len(self.body).to_bytes(2, "big") + self.body


def decode_records(datagram: bytes) -> list[Record]:
    """All whole records of a datagram."""
    found, at = [], 0
    while at + RECORD_BYTES <= len(datagram):
        end = at + RECORD_BYTES + int.from_bytes(datagram[at + 11 : at + 13], "big")
        if end > len(datagram):
            break
        epoch, number = (int.from_bytes(datagram[at + first : at + last], "big") for first, last in ((3, 5), (5, 11)))
        found.append(Record(datagram[at], epoch, number, datagram[at + RECORD_BYTES : end]))
        at = end
    return found


class Fragment(NamedTuple):
    """A part of a handshake message; `length` is what its header announces for the whole (RFC 6347 4.2.2)."""

    type: int
    length: int
    seq: int
    offset: int
    body: bytes

    def encode(self) -> bytes:
        header = bytes([self.type]) + self.length.to_bytes(3, "big") + self.seq.to_bytes(2, "big")
        return header + self.offset.to_bytes(3, "big") + len(self.body).to_bytes(3, "big") + self.body


def whole(kind: int, seq: int, body: bytes) -> Fragment:
    """A message in one fragment: in this form it enters the hash of the handshake (RFC 6347 4.2.6)."""
    return Fragment(kind, len(body), seq, 0, body)


def decode_fragments(body: bytes) -> list[Fragment]:
    """All fragments of a record of type HANDSHAKE."""
    found, at = [], 0
    while at + MESSAGE_BYTES <= len(body):
        places = ((1, 4), (4, 6), (6, 9), (9, 12))
        length, seq, offset, size = (int.from_bytes(body[at + first : at + last], "big") for first, last in places)
        at += MESSAGE_BYTES
        found.append(Fragment(body[at - MESSAGE_BYTES], length, seq, offset, body[at : at + size]))
        at += size
    return found


class Reassembly:
    """Puts fragments together, in any order; gives whole messages in the order of their numbers."""

    def __init__(self) -> None:
        self._parts: dict[int, list[Fragment]] = {}
        self.next_seq = 0

    def add(self, fragment: Fragment) -> list[Fragment]:
        """The messages that are whole now."""
        if fragment.seq >= self.next_seq:
            self._parts.setdefault(fragment.seq, []).append(fragment)
        done = []
        while self.next_seq in self._parts:
            parts, body = sorted(self._parts[self.next_seq], key=lambda part: part.offset), b""
            for part in parts:
                if part.offset <= len(body):
                    body += part.body[len(body) - part.offset :]
            if len(body) < parts[0].length:
                break
            done.append(whole(parts[0].type, self.next_seq, body))
            del self._parts[self.next_seq]
            self.next_seq += 1
        return done


class Suite(NamedTuple):
    """Numbers of RFC 5289 (AES-GCM) and RFC 7905 (ChaCha20)."""

    number: int
    digest: Literal["sha256", "sha384"]
    key_bytes: int
    iv_bytes: int  # 4: the other 8 of a nonce stand in the record (RFC 5288 3)


AES_128_GCM = Suite(0xC02B, "sha256", 16, 4)
AES_256_GCM = Suite(0xC02C, "sha384", 32, 4)
CHACHA20_POLY1305 = Suite(0xCCA9, "sha256", 32, 12)
SUITES = (AES_128_GCM, AES_256_GCM, CHACHA20_POLY1305)


def prf(suite: Suite, secret: bytes, label: bytes, seed: bytes, size: int) -> bytes:
    """P_hash of section 5."""
    seed = label + seed
    made, a = b"", seed
    while len(made) < size:
        a = hmac.digest(secret, a, suite.digest)
        made += hmac.digest(secret, a + seed, suite.digest)
    return made[:size]


def hashed(suite: Suite, messages: bytes) -> bytes:
    return hashlib.new(suite.digest, messages).digest()


class Protection:
    """Protects the records of one direction (RFC 5246 6.2.3.3)."""

    def __init__(self, suite: Suite, key: bytes, iv: bytes) -> None:
        self._iv = iv
        self._aead: AESGCM | ChaCha20Poly1305 = (ChaCha20Poly1305 if suite is CHACHA20_POLY1305 else AESGCM)(key)

    def _nonce(self, place: bytes) -> bytes:
        if len(self._iv) == 4:
            return self._iv + place
        return bytes(a ^ b for a, b in zip(self._iv, b"\0\0\0\0" + place, strict=True))  # RFC 7905 2

    def protect(self, record: Record) -> Record:
        explicit = record.place if len(self._iv) == 4 else b""
        aad = record.place + bytes([record.type]) + VERSION + len(record.body).to_bytes(2, "big")
        return record._replace(body=explicit + self._aead.encrypt(self._nonce(record.place), record.body, aad))

    def open(self, record: Record) -> bytes | None:
        """Return what a record holds, None where it was not made with these keys."""
        explicit = 8 if len(self._iv) == 4 else 0
        size = len(record.body) - explicit - 16
        if size < 0:
            return None
        place = record.body[:8] if explicit else record.place
        aad = record.place + bytes([record.type]) + VERSION + size.to_bytes(2, "big")
        try:
            return self._aead.decrypt(self._nonce(place), record.body[explicit:], aad)
        except InvalidTag:
            return None


def protections(
    suite: Suite, master: bytes, client_random: bytes, server_random: bytes
) -> tuple[Protection, Protection]:
    """Return keys and nonces of the client's and the server's records, from the key block of section 6.3."""
    key, iv = suite.key_bytes, suite.iv_bytes
    block = prf(suite, master, b"key expansion", server_random + client_random, 2 * (key + iv))
    ours = Protection(suite, block[:key], block[2 * key : 2 * key + iv])
    return ours, Protection(suite, block[key : 2 * key], block[2 * key + iv :])
