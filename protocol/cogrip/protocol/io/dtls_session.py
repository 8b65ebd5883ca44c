"""Keys of an open DTLS 1.2 association, handed from the process that made the handshake to the one that has the session.

Only what an open association needs: records of epoch 1 with data or an alert, an AEAD, a replay window (RFC 6347 section 4.1,
RFC 5246 sections 5, 6.3 and 8.1, RFC 5288, RFC 7905). The process that has exported the keys must write no record any more: a
number used twice would break the AEAD.
"""

import hmac
from typing import TYPE_CHECKING

import msgspec
from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM, ChaCha20Poly1305

from cogrip.protocol.secure.dtls_records import ALERT, DATA, RECORD_HEADER_BYTES, records

if TYPE_CHECKING:  # a worker has no handshake to make, and is there sooner without
    from OpenSSL import SSL

VERSION = b"\xfe\xfd"
EPOCH = 1
CLOSE_NOTIFY = b"\x01\x00"
WINDOW = 64  # records behind the newest that may still come, once each
SUITES = {  # Each suite, by OpenSSL's name: the PRF's hash, and the bytes of a key, of a nonce's implicit and explicit part.
    "ECDHE-ECDSA-AES128-GCM-SHA256": ("sha256", 16, 4, 8),
    "ECDHE-ECDSA-AES256-GCM-SHA384": ("sha384", 32, 4, 8),
    "ECDHE-ECDSA-CHACHA20-POLY1305": ("sha256", 32, 12, 0),
}
TAG_BYTES, NONCE_BYTES = 16, 12
_EPOCH_AT, _NUMBER_AT, _LENGTH_AT = 3, 5, 11  # places of epoch, number and length in a record
_MOST_BYTES = 2048  # longest record: no datagram is longer
_ALL_SEEN = (1 << WINDOW) - 1  # window in which all records have been seen; a C number once it is compiled


class SessionKeys(msgspec.Struct, frozen=True):
    """Keys and numbers by which an end goes on with an association. They are secret: never written to a file or a log.

    written, received  highest numbers of the records of epoch 1 so far
    """

    suite: str
    read_key: bytes
    write_key: bytes
    read_iv: bytes
    write_iv: bytes
    written: int
    received: int

    def __repr__(self) -> str:
        return f"SessionKeys(suite={self.suite!r})"


def export_keys(connection: "SSL.Connection", written: int, received: int, *, server: bool = True) -> SessionKeys:
    """Return the keys of one end of an open association. written, received: see `SessionKeys`. Raises ValueError."""
    suite = connection.get_cipher_name() or ""
    digest, key_bytes, iv_bytes, _ = SUITES[suite]
    master, clients, servers = connection.master_key(), connection.client_random(), connection.server_random()
    if master is None or clients is None or servers is None:
        raise ValueError("the handshake is not done: there are no keys yet")
    block = prf(digest, master, b"key expansion", servers + clients, 2 * (key_bytes + iv_bytes))
    ends = [key_bytes, 2 * key_bytes, 2 * key_bytes + iv_bytes]
    client_key, server_key = block[: ends[0]], block[ends[0] : ends[1]]
    client_iv, server_iv = block[ends[1] : ends[2]], block[ends[2] :]
    if server:
        return SessionKeys(suite, client_key, server_key, client_iv, server_iv, written, received)
    return SessionKeys(suite, server_key, client_key, server_iv, client_iv, written, received)


def prf(digest: str, secret: bytes, label: bytes, seed: bytes, size: int) -> bytes:
    """Return the pseudorandom function of TLS 1.2 (RFC 5246 section 5)."""
    a = seed = label + seed
    block = b""
    while len(block) < size:
        a = hmac.digest(secret, a, digest)
        block += hmac.digest(secret, a + seed, digest)
    return block[:size]


def is_one_message(datagram: bytes) -> bool:
    """Return whether a datagram is one record of epoch 1 with a message, by its header."""
    return (
        len(datagram) > RECORD_HEADER_BYTES
        and datagram[0] == DATA
        and datagram[1] == VERSION[0]
        and datagram[3] == 0
        and datagram[4] == 1
        and len(datagram) == RECORD_HEADER_BYTES + 256 * datagram[11] + datagram[12]
    )


def newest_number(datagram: bytes) -> int:
    """Return the highest number among a datagram's records of epoch 1; -1 where there is none."""
    return max((each.number for each in records(datagram) if each.epoch == 1), default=-1)


class DtlsSession:
    """One end of an open association. closed: the other end has closed it."""

    __slots__ = (
        "_associated", "_explicit", "_head", "_newest", "_nonce", "_read", "_read_iv", "_seen", "_write", "_write_iv",
        "_written", "closed",
    )  # fmt: skip

    def __init__(self, keys: SessionKeys) -> None:
        _, _, _, self._explicit = SUITES[keys.suite]
        cipher = AESGCM if "GCM" in keys.suite else ChaCha20Poly1305
        self._read, self._write = cipher(keys.read_key), cipher(keys.write_key)
        self._read_iv, self._write_iv = keys.read_iv.ljust(NONCE_BYTES, b"\0"), keys.write_iv.ljust(NONCE_BYTES, b"\0")
        self._nonce, self._associated = bytearray(NONCE_BYTES), bytearray(RECORD_HEADER_BYTES)  # of the newest record
        self._head = bytearray(RECORD_HEADER_BYTES + self._explicit)
        self._written, self._newest = keys.written, keys.received
        self._seen = _ALL_SEEN  # all before the hand-over; bit k: the newest less k
        self.closed = False

    def send(self, message: bytes) -> bytes:
        """Return the datagram that carries a message."""
        return self._record(DATA, message)

    def close(self) -> bytes:
        """Return the datagram that tells the other end that this association is over."""
        return self._record(ALERT, CLOSE_NOTIFY)

    def receive(self, datagram: bytes) -> list[bytes]:
        """Return the messages of a datagram. What is not authentic, or comes again, changes nothing."""
        if is_one_message(datagram):  # nearly all are
            plain = self._open(datagram)
            return [] if plain is None else [plain]
        messages = []
        for each in records(datagram):
            if each.epoch != 1 or each.type not in (DATA, ALERT):
                continue
            plain = self._open(datagram[each.begin : each.end])
            if plain is None:
                continue
            if each.type == DATA:
                messages.append(plain)
            else:  # every alert ends a session: none but close_notify is expected
                self.closed = True
        return messages

    def _open(self, record: bytes) -> bytes | None:
        """Return what a record of epoch 1 holds; None where it is not authentic, or comes again."""
        begin = RECORD_HEADER_BYTES + self._explicit
        plain_bytes = len(record) - begin - TAG_BYTES
        if not 0 <= plain_bytes < _MOST_BYTES:
            return None
        number = 0
        for place in range(_NUMBER_AT, _LENGTH_AT):
            number = number << 8 | record[place]
        if not self._new(number):
            return None
        self._prepare(self._read_iv, record, RECORD_HEADER_BYTES if self._explicit else _EPOCH_AT, plain_bytes)
        try:
            plain: bytes = self._read.decrypt(self._nonce, record[begin:], self._associated)
        except InvalidTag:
            return None
        self._note(number)
        return plain

    def _record(self, kind: int, plain: bytes) -> bytes:
        """Return the record of a content type that holds this."""
        head, explicit, plain_bytes = self._head, self._explicit, len(plain)
        if plain_bytes >= _MOST_BYTES:
            raise ValueError(f"a record of {plain_bytes} bytes: at most {_MOST_BYTES - 1} fit")
        self._written += 1
        number, length = EPOCH << 48 | self._written, explicit + plain_bytes + TAG_BYTES
        head[0], head[1], head[2] = kind, VERSION[0], VERSION[1]
        for place in range(_EPOCH_AT, _LENGTH_AT):
            head[place] = number >> (80 - 8 * place) & 255
        head[_LENGTH_AT], head[_LENGTH_AT + 1] = length >> 8, length & 255
        for place in range(explicit):
            head[RECORD_HEADER_BYTES + place] = head[_EPOCH_AT + place]
        self._prepare(self._write_iv, head, _EPOCH_AT, plain_bytes)
        return b"".join((self._head, self._write.encrypt(self._nonce, plain, self._associated)))

    def _prepare(self, iv: bytes, record: bytes | bytearray, at: int, plain_bytes: int) -> None:
        """Set nonce and additional data of a record.

        at: place of what the nonce has of the record. RFC 7905 section 2 adds it to the IV; that of RFC 5288 section 3 is 0
        there.
        """
        nonce, associated = self._nonce, self._associated
        for place in range(4):
            nonce[place] = iv[place]
        for place in range(4, NONCE_BYTES):
            nonce[place] = iv[place] ^ record[at + place - 4]
        for place in range(8):  # epoch and number, then type and version, then length (RFC 5246 section 6.2.3.3)
            associated[place] = record[_EPOCH_AT + place]
        for place in range(_EPOCH_AT):
            associated[8 + place] = record[place]
        associated[11], associated[12] = plain_bytes >> 8, plain_bytes & 255

    def _new(self, number: int) -> bool:
        behind = self._newest - number
        return behind < 0 or (behind < WINDOW and not self._seen >> behind & 1)

    def _note(self, number: int) -> None:
        ahead, bit = number - self._newest, 1
        if ahead > 0:
            self._newest = number
            self._seen = (self._seen << ahead & _ALL_SEEN | bit) if ahead < WINDOW else bit
        else:
            self._seen |= bit << -ahead  # `1 << -ahead` would have 32 bits in C
