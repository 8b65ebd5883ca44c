"""One DTLS 1.2 association by OpenSSL, over memory: datagrams in, messages out, without a socket (`SPEC.md` section 11).

The handshake's timers are OpenSSL's and run on the machine's clock. Nothing that comes from the network raises: an association
that cannot go on says so in `failed`.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress

from cryptography.hazmat.primitives.serialization import Encoding
from OpenSSL import SSL, crypto

from cogrip.protocol.io.certificate import Identity, fingerprint_of
from cogrip.protocol.secure.dtls_records import CLIENT_HELLO, HANDSHAKE, RECORD_HEADER_BYTES
from cogrip.protocol.wire.messages import MAX_DATAGRAM_BYTES

DTLS1_2 = 0xFEFD
CIPHERS = b"ECDHE-ECDSA-AES128-GCM-SHA256:ECDHE-ECDSA-AES256-GCM-SHA384:ECDHE-ECDSA-CHACHA20-POLY1305"
OPTIONS = SSL.OP_NO_RENEGOTIATION | SSL.OP_NO_TICKET | SSL.OP_NO_COMPRESSION | SSL.OP_NO_QUERY_MTU
READ_BYTES = 1 << 14  # bytes of one read: more than one call can produce

NOT_TRUSTED = "the other end does not trust this certificate: its link has another fingerprint"
WRONG_CERTIFICATE = "the certificate is not the one of the link"
NO_CIPHER = "the two ends share no cipher: ECDHE with ECDSA and an AEAD is needed"
NO_VERSION = "the other end does not speak DTLS 1.2"
CLOSED = "the other end closed the DTLS association"
# our text, and the parts of OpenSSL's text that it stands for; the first text of which a part is found counts
ERROR_TEXTS = {
    NOT_TRUSTED: ("alert unknown ca", "alert bad certificate"),
    WRONG_CERTIFICATE: ("certificate verify failed",),
    NO_CIPHER: ("handshake failure", "insufficient security", "no shared cipher", "no suitable signature algorithm"),
    NO_VERSION: ("protocol version", "unsupported protocol", "wrong version number"),
    "the other end broke the handshake off": ("alert",),
}
OTHER_ERROR = "the handshake went wrong"
FINAL = (NOT_TRUSTED, WRONG_CERTIFICATE, NO_CIPHER, NO_VERSION)
"""Errors after which another handshake would end in the same way."""


def server_context(
    identity: Identity, make_cookie: Callable[[SSL.Connection], bytes], fits: Callable[[SSL.Connection, bytes], bool]
) -> SSL.Context:
    """Return the context of all associations of a server. make_cookie, fits: make and check the cookie of an address."""
    context = _context()
    context.use_certificate(identity.certificate)
    context.use_privatekey(identity.key)
    assert SSL.OP_COOKIE_EXCHANGE is not None  # the library was built with DTLS
    context.set_options(SSL.OP_COOKIE_EXCHANGE)
    context.set_cookie_generate_callback(make_cookie)
    context.set_cookie_verify_callback(fits)
    return context


def client_context(fingerprint: str, rejected: Callable[[str], None]) -> SSL.Context:
    """Return a context that accepts the certificate with this fingerprint alone. rejected: called with any other one's."""

    def fits(_: SSL.Connection, certificate: crypto.X509, error: int, depth: int, ok: int) -> bool:
        theirs = fingerprint_of(crypto.dump_certificate(crypto.FILETYPE_ASN1, certificate))
        if depth == 0 and theirs == fingerprint:
            return True  # whoever signed it, and whatever this machine's clock says
        rejected(theirs)
        return False

    context = _context()
    context.set_verify(SSL.VERIFY_PEER, fits)
    return context


def _context() -> SSL.Context:
    context = SSL.Context(SSL.DTLS_METHOD)
    context.set_min_proto_version(DTLS1_2)
    context.set_max_proto_version(DTLS1_2)
    context.set_cipher_list(CIPHERS)
    context.set_options(OPTIONS)
    context.set_session_cache_mode(SSL.SESS_CACHE_OFF)
    return context


class Association:
    """One DTLS association. A server's begins with `listen`, a client's with `connect`. Send what `pop_datagrams` returns.

    connection  of OpenSSL, over memory; none after `release`
    ready       messages can be sent
    failed      why the association cannot go on, "" while it can
    """

    __slots__ = ("_pending", "connection", "failed", "ready")

    def __init__(self, context: SSL.Context, *, server: bool = False) -> None:
        self.connection = connection = SSL.Connection(context, None)
        connection.set_ciphertext_mtu(MAX_DATAGRAM_BYTES)
        if server:
            connection.set_accept_state()
        else:
            connection.set_connect_state()
        self._pending: list[bytes] = []
        self.ready = False
        self.failed = ""

    def connect(self) -> None:
        """Begin a client's handshake; as `accept` answer the ClientHello that `listen` has accepted."""
        self._handshake()
        self._drain()

    accept = connect

    def listen(self, datagram: bytes) -> bool:
        """Answer a ClientHello without keeping any of it. True if its cookie fits: go on with `accept`."""
        connection = self.connection
        fits = False
        with suppress(SSL.Error, ValueError):  # no ClientHello, or one without a cookie that fits
            connection.bio_write(datagram)
            connection.DTLSv1_listen()
            fits = True
        self._drain()
        if not fits and not self._pending:
            # it leaves its error in the error queue, which all associations share: the next one would treat that as its own.
            # listening begins with clearing the queue, and there is nothing more to receive
            with suppress(SSL.Error):
                connection.DTLSv1_listen()
        return fits

    def feed(self, datagram: bytes) -> Sequence[bytes]:
        """Return the messages of a datagram. OpenSSL is asked after each of them, or a last flight that was lost stays lost."""
        if self.failed or not datagram:
            return ()
        connection, before = self.connection, self.ready
        try:
            connection.bio_write(datagram)
            if not before:
                self._handshake()
            if self.ready:
                first = connection.recv(READ_BYTES)
                if before and len(datagram) == RECORD_HEADER_BYTES + int.from_bytes(datagram[11:13], "big"):
                    return (first,)  # one record, one message, and nothing to answer
                return self._more([first])
        except (SSL.Error, ValueError) as error:
            self._handle_error(error)
        self._drain()
        return ()

    def _more(self, messages: list[bytes]) -> list[bytes]:
        try:
            while True:
                messages.append(self.connection.recv(READ_BYTES))
        except (SSL.Error, ValueError) as error:
            self._handle_error(error)
        self._drain()
        return messages

    def send(self, message: bytes) -> bytes:
        """Return the datagram that carries a message; b"" where the association is not ready or has failed."""
        if not self.ready or self.failed:
            return b""
        try:
            self.connection.send(message)
            return self.connection.bio_read(READ_BYTES)
        except (SSL.Error, ValueError) as error:
            self._handle_error(error)
            return b""

    def pop_datagrams(self) -> Sequence[bytes]:
        """Return the pending datagrams of handshake and closing, each of MAX_DATAGRAM_BYTES at most."""
        if not self._pending:
            return ()
        datagrams = packed(b"".join(self._pending))
        self._pending.clear()
        return datagrams

    def poll(self) -> None:
        """Repeat a flight that is unanswered, when OpenSSL's timer says so."""
        if self.failed:
            return
        try:
            if self.connection.DTLSv1_get_timeout() is not None:
                self.connection.DTLSv1_handle_timeout()
        except (SSL.Error, ValueError) as error:
            self._handle_error(error)
        self._drain()

    def close(self) -> None:
        """Close the association and tell the other end, where it can understand that."""
        if self.ready and not self.failed:
            with suppress(SSL.Error, ValueError):  # the other end may be gone
                self.connection.shutdown()
            self._drain()
        self.failed = self.failed or "closed"

    def release(self) -> None:
        """Free what OpenSSL keeps, 100 kB: something else goes on with the keys, and nothing is asked of it any more."""
        del self.connection

    def peer_fingerprint(self) -> str:
        """Return the fingerprint of the other end's certificate, "" if it has shown none."""
        certificate = self.connection.get_peer_certificate(as_cryptography=True)
        return fingerprint_of(certificate.public_bytes(Encoding.DER)) if certificate else ""

    def _handshake(self) -> None:
        try:
            self.connection.do_handshake()
            self.ready = True
        except (SSL.Error, ValueError) as error:
            self._handle_error(error)

    def _handle_error(self, error: Exception) -> None:
        if isinstance(error, SSL.WantReadError):
            return
        if isinstance(error, SSL.ZeroReturnError):
            self.failed = CLOSED
        elif not self.failed:
            self.failed = error_text(error)

    def _drain(self) -> None:
        try:
            while True:
                self._pending.append(self.connection.bio_read(READ_BYTES))
        except (SSL.Error, ValueError):
            pass  # no more


def error_text(error: Exception) -> str:
    """Return one of a bounded number of texts for an error of OpenSSL."""
    said = str(error).lower()
    return next((text for text, parts in ERROR_TEXTS.items() if any(part in said for part in parts)), OTHER_ERROR)


def packed(records: bytes) -> list[bytes]:
    """Return datagrams of whole records, as few as hold them: a memory BIO runs records together."""
    datagrams = [b""]
    while records:
        end = RECORD_HEADER_BYTES + int.from_bytes(records[11:13], "big")
        if datagrams[-1] and len(datagrams[-1]) + end > MAX_DATAGRAM_BYTES:
            datagrams.append(b"")
        datagrams[-1] += records[:end]
        records = records[end:]
    return datagrams if datagrams[0] else []


def is_client_hello(datagram: bytes) -> bool:
    """Return whether a datagram begins like a ClientHello: an unencrypted DTLS handshake record."""
    begins = datagram[:2] == bytes([HANDSHAKE, 0xFE]) and datagram[3:5] == b"\0\0"
    return begins and len(datagram) > RECORD_HEADER_BYTES and datagram[RECORD_HEADER_BYTES] == CLIENT_HELLO


def client_random(datagram: bytes) -> bytes:
    """Return the 32 random bytes that identify a client's handshake; fewer where the datagram is too short."""
    return datagram[27:59]


def cookie_in(datagram: bytes) -> bytes:
    """Return the cookie of a ClientHello; b"" if there is none. Only for sorting: OpenSSL parses the message itself."""
    if len(datagram) < 61:
        return b""
    at = 60 + datagram[59]  # after the session id
    return datagram[at + 1 : at + 1 + datagram[at]] if at < len(datagram) else b""
