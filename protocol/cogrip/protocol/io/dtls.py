"""One sealed association: DTLS 1.2 by OpenSSL, over memory. Datagrams in, messages out; no socket in here.

The handshake's timers are OpenSSL's and run on the machine's clock; everything else goes by what is fed. Nothing that
comes from the network raises: an association that cannot go on says so in `failed`.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress

from cryptography.hazmat.primitives.serialization import Encoding
from OpenSSL import SSL, crypto

from cogrip.protocol.dtls_records import CLIENT_HELLO, HANDSHAKE, RECORD_HEADER_BYTES
from cogrip.protocol.io.certificate import Identity, fingerprint_of
from cogrip.protocol.messages import MAX_DATAGRAM_BYTES

DTLS1_2 = 0xFEFD
CIPHERS = b"ECDHE-ECDSA-AES128-GCM-SHA256:ECDHE-ECDSA-AES256-GCM-SHA384:ECDHE-ECDSA-CHACHA20-POLY1305"
OPTIONS = SSL.OP_NO_RENEGOTIATION | SSL.OP_NO_TICKET | SSL.OP_NO_COMPRESSION | SSL.OP_NO_QUERY_MTU
READ_BYTES = 1 << 14  # more than one call can leave behind

NOT_TRUSTED = "the other end does not trust this certificate: its link has another fingerprint"
NOT_THE_ONE = "the certificate is not the one of the link"
NO_CIPHER = "the two ends share no cipher: ECDHE with ECDSA and an AEAD is needed"
NO_VERSION = "the other end does not speak DTLS 1.2"
CLOSED = "the other end closed the seal"
WORDS = (  # what OpenSSL says, by a part of its words, in ours; the first that is in them
    ("alert unknown ca", NOT_TRUSTED),
    ("alert bad certificate", NOT_TRUSTED),
    ("certificate verify failed", NOT_THE_ONE),
    ("handshake failure", NO_CIPHER),
    ("insufficient security", NO_CIPHER),
    ("no shared cipher", NO_CIPHER),
    ("no suitable signature algorithm", NO_CIPHER),
    ("protocol version", NO_VERSION),
    ("unsupported protocol", NO_VERSION),
    ("wrong version number", NO_VERSION),
    ("alert", "the other end broke the handshake off"),
)
ELSE = "the handshake went wrong"
FINAL = frozenset((NOT_TRUSTED, NOT_THE_ONE, NO_CIPHER, NO_VERSION))  # another handshake would end in the same way


def server_context(
    identity: Identity, make_cookie: Callable[[SSL.Connection], bytes], fits: Callable[[SSL.Connection, bytes], bool]
) -> SSL.Context:
    """What all associations of a server share. The two functions give and check the cookie of an address."""
    context = _context()
    context.use_certificate(identity.certificate)
    context.use_privatekey(identity.key)
    assert SSL.OP_COOKIE_EXCHANGE is not None  # the library was built with DTLS
    context.set_options(SSL.OP_COOKIE_EXCHANGE)
    context.set_cookie_generate_callback(make_cookie)
    context.set_cookie_verify_callback(fits)
    return context


def client_context(fingerprint: str, found: Callable[[str], None]) -> SSL.Context:
    """Lets a server through whose own certificate has this fingerprint. `found` hears of every other one's."""

    def fits(_: SSL.Connection, certificate: crypto.X509, error: int, depth: int, ok: int) -> bool:
        theirs = fingerprint_of(crypto.dump_certificate(crypto.FILETYPE_ASN1, certificate))
        if depth == 0 and theirs == fingerprint:
            return True  # whoever signed it, and whatever this machine's clock says
        found(theirs)
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
    """`ready` once messages can be sent, `failed` says why it cannot go on, "" while it can; `take` what it leaves.

    A server's begins with `listen`, a client's with `dial`.
    """

    __slots__ = ("_connection", "_left", "failed", "ready")

    def __init__(self, context: SSL.Context, *, server: bool = False) -> None:
        self._connection = connection = SSL.Connection(context, None)
        connection.set_ciphertext_mtu(MAX_DATAGRAM_BYTES)
        if server:
            connection.set_accept_state()
        else:
            connection.set_connect_state()
        self._left: list[bytes] = []
        self.ready = False
        self.failed = ""

    def dial(self) -> None:
        """Begin a client's handshake."""
        self._shake()
        self._drain()

    def listen(self, datagram: bytes) -> bool:
        """Answer a ClientHello without keeping anything of it; True if it had a cookie that fits: this is its association.

        A handshake goes on by `accept` then.
        """
        connection = self._connection
        heard = False
        with suppress(SSL.Error, ValueError):  # no ClientHello, or one without a cookie that fits
            connection.bio_write(datagram)
            connection.DTLSv1_listen()
            heard = True
        self._drain()
        if not heard and not self._left:
            # it leaves what it found wrong in the error queue, which all associations share: the next one would take
            # that for its own. To listen begins with clearing the queue, and there is nothing more to hear
            with suppress(SSL.Error):
                connection.DTLSv1_listen()
        return heard

    def accept(self) -> None:
        """Answer the ClientHello that `listen` has let through."""
        self._shake()
        self._drain()

    def feed(self, datagram: bytes) -> Sequence[bytes]:
        """Messages that a datagram carried. OpenSSL is asked after every one, or a last flight that was lost stays lost."""
        if self.failed or not datagram:
            return ()
        connection, before = self._connection, self.ready
        try:
            connection.bio_write(datagram)
            if not before:
                self._shake()
            if self.ready:
                first = connection.recv(READ_BYTES)
                if before and len(datagram) == RECORD_HEADER_BYTES + int.from_bytes(datagram[11:13], "big"):
                    return (first,)  # one record, one message, and nothing to answer
                return self._more([first])
        except (SSL.Error, ValueError) as error:
            self._judge(error)
        self._drain()
        return ()

    def _more(self, messages: list[bytes]) -> list[bytes]:
        try:
            while True:
                messages.append(self._connection.recv(READ_BYTES))
        except (SSL.Error, ValueError) as error:
            self._judge(error)
        self._drain()
        return messages

    def send(self, message: bytes) -> bytes:
        """The datagram that carries a message; b"" if there is none: not ready, or failed."""
        if not self.ready or self.failed:
            return b""
        try:
            self._connection.send(message)
            return self._connection.bio_read(READ_BYTES)
        except (SSL.Error, ValueError) as error:
            self._judge(error)
            return b""

    def take(self) -> Sequence[bytes]:
        """Datagrams of the handshake and of its end, to send; each of MAX_DATAGRAM_BYTES at most."""
        if not self._left:
            return ()
        datagrams = packed(b"".join(self._left))
        self._left.clear()
        return datagrams

    def poll(self) -> None:
        """Repeat a flight that is unanswered, when OpenSSL's timer says so."""
        if self.failed:
            return
        try:
            if self._connection.DTLSv1_get_timeout() is not None:
                self._connection.DTLSv1_handle_timeout()
        except (SSL.Error, ValueError) as error:
            self._judge(error)
        self._drain()

    def close(self) -> None:
        """Tell the other end, if it can understand."""
        if self.ready and not self.failed:
            with suppress(SSL.Error, ValueError):  # there may be nobody to tell
                self._connection.shutdown()
            self._drain()
        self.failed = self.failed or "closed"

    def peer_fingerprint(self) -> str:
        """Of the other end's certificate, "" if it has shown none."""
        certificate = self._connection.get_peer_certificate(as_cryptography=True)
        return fingerprint_of(certificate.public_bytes(Encoding.DER)) if certificate else ""

    def _shake(self) -> None:
        try:
            self._connection.do_handshake()
            self.ready = True
        except (SSL.Error, ValueError) as error:
            self._judge(error)

    def _judge(self, error: Exception) -> None:
        if isinstance(error, SSL.WantReadError):
            return
        if isinstance(error, SSL.ZeroReturnError):
            self.failed = CLOSED
        elif not self.failed:
            self.failed = in_words(error)

    def _drain(self) -> None:
        try:
            while True:
                self._left.append(self._connection.bio_read(READ_BYTES))
        except (SSL.Error, ValueError):
            pass  # it is empty


def in_words(error: Exception) -> str:
    """OpenSSL's error for people; of a bounded number of texts."""
    said = str(error).lower()
    return next((words for part, words in WORDS if part in said), ELSE)


def packed(records: bytes) -> list[bytes]:
    """Datagrams of whole records, as few as hold them: a memory BIO runs records together."""
    datagrams = []
    begin = here = 0
    while here + RECORD_HEADER_BYTES <= len(records):
        end = here + RECORD_HEADER_BYTES + int.from_bytes(records[here + 11 : here + 13], "big")
        if end - begin > MAX_DATAGRAM_BYTES and here > begin:
            datagrams.append(records[begin:here])
            begin = here
        here = end
    if begin < len(records):
        datagrams.append(records[begin:])
    return datagrams


def is_client_hello(datagram: bytes) -> bool:
    """Whether a datagram begins as a ClientHello does: a record of the handshake, not sealed, of DTLS."""
    return len(datagram) > RECORD_HEADER_BYTES and datagram[0] == HANDSHAKE and (
        datagram[1] == 0xFE and not datagram[3] and not datagram[4] and datagram[13] == CLIENT_HELLO
    )  # fmt: skip


def client_random(datagram: bytes) -> bytes:
    """The 32 bytes by which a client tells one handshake from another; fewer where the datagram is too short."""
    return datagram[27:59]


def cookie_in(datagram: bytes) -> bytes:
    """The cookie of a ClientHello; b"" if there is none. Only to sort by: OpenSSL reads the whole of it."""
    if len(datagram) < 61:
        return b""
    at = 60 + datagram[59]  # after the session id
    return datagram[at + 1 : at + 1 + datagram[at]] if at < len(datagram) else b""
