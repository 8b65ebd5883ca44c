"""A DTLS 1.2 client that is not OpenSSL: it joins as any client does, and it can send whatever an attacker would.

    hello --HelloVerifyRequest--> hello with cookie --ServerHello ... ServerHelloDone--> finishing --Finished--> open

It is a `Channel`, so it can take the place of `DtlsClient`. Each step of the handshake can also be made by hand.
"""

import os
from collections import Counter, deque
from collections.abc import Sequence

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

from cogrip.protocol.secure.channel import PEER, Address

from tests.dtls_peer import records as wire
from tests.dtls_peer.records import ALERT, APPLICATION_DATA, HANDSHAKE, Fragment, Protection, hashed, prf, whole

REPEAT_NS = 1_000_000_000  # RFC 6347 4.2.4.1
X25519, SECP256R1, ECDSA_P256_SHA256 = b"\x00\x1d", b"\x00\x17", b"\x04\x03"  # RFC 8422 5.1.1, RFC 5246 7.4.1.4.1
Part = tuple[int, int, bytes]  # of a flight: type of record, epoch, what it holds


class PeerError(AssertionError):
    """The server did what the standard forbids."""


class DtlsPeer:
    """`outbox` holds what is to be sent. fingerprint: of the server's certificate; "" takes any."""

    halted = False  # stands where it was left, on purpose

    def __init__(self, fingerprint: str = "", suites: Sequence[wire.Suite] = wire.SUITES) -> None:
        self.outbox: deque[tuple[Address, bytes]] = deque()
        self.dropped = Counter[str]()
        self.failed = ""
        self.repeats = 0
        self.cookie = b""
        self._fingerprint = fingerprint
        self._suites = {suite.number: suite for suite in suites}
        self._random = os.urandom(32)
        self._server_random = b""
        self._private = X25519PrivateKey.generate()
        self._numbers = [0, 0]  # of the next record, by epoch
        self._seen: set[int] = set()  # of records of epoch 1
        self._reassembly = wire.Reassembly()
        self._transcript = b""
        self._messages: dict[int, bytes] = {}
        self._suite = wire.SUITES[0]
        self._master = self._pre_master = b""
        self._ours: Protection | None = None
        self._theirs: Protection | None = None
        self._flight: tuple[Part, ...] = ()
        self._repeat_ns: int | None = None
        self._next_seq = 0
        self._open = False

    # Channel

    def ready(self, address: Address = PEER) -> bool:
        return self._open and not self.failed

    def send(self, message: bytes, address: Address = PEER) -> bool:
        if not self.ready():
            return False
        self.put(self.record(APPLICATION_DATA, message))
        return True

    def poll(self, now_ns: int) -> None:
        """Begin; repeat the last flight when it stays unanswered."""
        if self.failed or self._open:
            return
        if not self._flight:
            self.put_flight((HANDSHAKE, 0, self.client_hello().encode()))
        elif self._repeat_ns is not None and now_ns >= self._repeat_ns:
            self.repeats += 1
            self.put_flight()
        elif self._repeat_ns is not None:
            return
        self._repeat_ns = now_ns + REPEAT_NS

    def close(self, address: Address = PEER) -> None:
        if self.ready():
            self.put(self.record(ALERT, b"\x01\x00"))  # close_notify, RFC 5246 7.2.1
        self.failed = self.failed or "closed"

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        messages = []
        for record in wire.decode_records(datagram):
            body: bytes | None = record.body
            if record.epoch:
                body = self._theirs.open(record) if self._theirs is not None and record.epoch == 1 else None
            # In the clear numbers may repeat: OpenSSL's ServerHello begins with 1 whatever the ClientHello's number was,
            # which a HelloVerifyRequest may have had (RFC 6347 4.2.1 says otherwise)
            if body is None or (record.epoch and record.number in self._seen):
                self.dropped["record"] += 1
                continue
            if record.epoch:
                self._seen.add(record.number)
            if record.type == APPLICATION_DATA and record.epoch:
                messages.append(body)
            elif record.type == ALERT and (body[:1] == b"\x02" or body == b"\x01\x00"):
                self.failed = f"alert {body[1]}"
            elif record.type == HANDSHAKE and not self._open:
                for fragment in wire.decode_fragments(body):
                    self._hear(fragment)
        if self._flight and not self._open:
            self._repeat_ns = None  # the server is there: its answer counts from now
            self.poll(now_ns)
        return messages

    # what goes out

    def put(self, *records: bytes) -> None:
        """Join records to one datagram."""
        self.outbox.append((PEER, b"".join(records)))

    def record(self, kind: int, body: bytes, epoch: int | None = None, number: int | None = None) -> bytes:
        """One record, protected from epoch 1 on; by default of the newest epoch, with the next number."""
        epoch = int(self._ours is not None) if epoch is None else epoch
        if number is None:
            number = self._numbers[min(epoch, 1)]
            self._numbers[min(epoch, 1)] += 1
        record = wire.Record(kind, epoch, number, body)
        if epoch and self._ours is not None:
            record = self._ours.protect(record)
        return record.encode()

    def fragment(self, kind: int, seq: int, body: bytes, length: int | None = None, offset: int = 0) -> bytes:
        """A record that holds a fragment of a handshake message. length: what it announces."""
        announced = len(body) if length is None else length
        return self.record(HANDSHAKE, Fragment(kind, announced, seq, offset, body).encode())

    def put_flight(self, *flight: Part) -> None:
        """A flight, by default the last one, in records with new numbers."""
        self._flight = flight or self._flight
        self.put(*[self.record(kind, body, epoch) for kind, epoch, body in self._flight])

    # the handshake

    def client_hello(self) -> Fragment:
        """RFC 6347 4.2.1 with the extensions that ECDHE with ECDSA needs (RFC 8422 5.1) and RFC 7627's."""

        def vector(body: bytes, size: int = 2) -> bytes:
            return len(body).to_bytes(size, "big") + body

        def extension(number: int, body: bytes) -> bytes:
            return number.to_bytes(2, "big") + vector(body)

        suites = b"".join(number.to_bytes(2, "big") for number in self._suites)
        extensions = (
            extension(10, vector(X25519 + SECP256R1))  # supported_groups: of the exchange, then of the certificate
            + extension(11, vector(b"\0", 1))  # ec_point_formats: uncompressed
            + extension(13, vector(ECDSA_P256_SHA256))  # signature_algorithms
            + extension(23, b"")  # extended_master_secret
            + extension(0xFF01, vector(b"", 1))  # renegotiation_info, RFC 5746 3.4
        )
        body = wire.VERSION + self._random + vector(b"", 1) + vector(self.cookie, 1) + vector(suites)
        body += vector(b"\0", 1) + vector(extensions)
        return whole(wire.CLIENT_HELLO, self._next_seq, body)

    def _hear(self, fragment: Fragment) -> None:
        for message in self._reassembly.add(fragment):
            if message.type == wire.HELLO_VERIFY_REQUEST:
                self.cookie = message.body[3:]
                self._next_seq = 1
                hello = self.client_hello().encode()
                self._transcript = hello  # neither the first hello nor its answer count: RFC 6347 4.2.1
                self.put_flight((HANDSHAKE, 0, hello))
                continue
            if message.type == wire.FINISHED:
                self._check_finished(message)
            self._transcript += message.encode()
            self._messages[message.type] = message.body
            if message.type == wire.SERVER_HELLO_DONE:
                self.answer_server_hello()

    def answer_server_hello(self) -> None:
        """Check what the server has shown; send ClientKeyExchange, ChangeCipherSpec and Finished."""
        self.read_server()
        exchange = (HANDSHAKE, 0, self.key_exchange())
        self.put_flight(exchange, (wire.CHANGE_CIPHER_SPEC, 0, b"\x01"), (HANDSHAKE, 1, self.finished()))

    def read_server(self) -> None:
        """Check what the server has shown; find the shared secret. Raises PeerError, InvalidSignature."""
        hello, certificate = self._messages[wire.SERVER_HELLO], self._messages[wire.CERTIFICATE]
        if hello[:2] != wire.VERSION or hello[34]:
            raise PeerError("another version, or a session that could be resumed")
        self._suite = self._suites[int.from_bytes(hello[35:37], "big")]
        self._server_random = hello[2:34]
        if b"\x00\x17\x00\x00" not in hello[38:]:
            raise PeerError("no extended master secret")
        der = certificate[6 : 6 + int.from_bytes(certificate[3:6], "big")]
        shown = x509.load_der_x509_certificate(der)
        if self._fingerprint and shown.fingerprint(hashes.SHA256()).hex() != self._fingerprint:
            self.put(self.record(ALERT, b"\x02\x30"))  # unknown_ca
            self.failed = "another certificate"
            raise PeerError(self.failed)
        # RFC 8422 5.4: named_curve, the curve, the point; then a signature
        exchange = self._messages[wire.SERVER_KEY_EXCHANGE]
        point_end = 4 + exchange[3]
        parameters, signature = exchange[:point_end], exchange[point_end + 4 :]
        if parameters[:3] != b"\x03" + X25519:
            raise PeerError("another curve than the one that was offered")
        key = shown.public_key()
        assert isinstance(key, ec.EllipticCurvePublicKey)
        key.verify(signature, self._random + self._server_random + parameters, ec.ECDSA(hashes.SHA256()))
        self._pre_master = self._private.exchange(X25519PublicKey.from_public_bytes(parameters[4:]))

    def key_exchange(self) -> bytes:
        """ClientKeyExchange; from here on there are keys (RFC 7627 4)."""
        point = self._private.public_key().public_bytes(Encoding.Raw, PublicFormat.Raw)
        message = whole(wire.CLIENT_KEY_EXCHANGE, 2, bytes([len(point)]) + point).encode()
        self._transcript += message
        session = hashed(self._suite, self._transcript)
        self._master = prf(self._suite, self._pre_master, b"extended master secret", session, 48)
        self._ours, self._theirs = wire.protections(self._suite, self._master, self._random, self._server_random)
        return message

    def finished(self) -> bytes:
        """RFC 5246 7.4.9."""
        data = prf(self._suite, self._master, b"client finished", hashed(self._suite, self._transcript), 12)
        message = whole(wire.FINISHED, 3, data).encode()
        self._transcript += message
        return message

    def _check_finished(self, message: Fragment) -> None:
        wanted = prf(self._suite, self._master, b"server finished", hashed(self._suite, self._transcript), 12)
        if message.body != wanted:
            raise PeerError("the server's Finished does not fit the handshake")
        self._open = True
