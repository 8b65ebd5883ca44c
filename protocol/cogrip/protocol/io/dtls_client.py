"""A client's DTLS channel to the server whose certificate the link names (`SPEC.md` section 11).

A handshake without an answer is begun anew, with new keys, each time after a longer wait: sooner than OpenSSL would repeat a
flight. No message is sent before the server has shown the certificate, and none is ever sent unencrypted.
"""

from collections import Counter, deque
from collections.abc import Sequence

from cogrip.protocol.io.dtls import CLOSED, FINAL, Association, client_context
from cogrip.protocol.io.dtls_session import SUITES, DtlsSession, export_keys, newest_number
from cogrip.protocol.secure.channel import PEER, Address
from cogrip.protocol.texts import shown
from cogrip.protocol.wire import messages

PATIENCE_NS = (500_000_000, 700_000_000, 900_000_000)
"""Time to wait for an answer to handshake 1, 2, 3 and all later ones."""
GIVE_UP_NS = 10_000_000_000
SHOWN_DIGITS = 16
NO_ANSWER_CURE = (
    "is it running with DTLS, and is its UDP port open and forwarded? An unencrypted server is joined by HOST:PORT"
)


class DtlsClient:
    """`Channel` of a client, which polls it. fingerprint: of the server's certificate, 64 lower-case hex digits."""

    def __init__(self, fingerprint: str) -> None:
        self.outbox: deque[tuple[Address, bytes]] = deque()
        self.dropped: Counter[str] = Counter()
        self.failed = ""
        self._fingerprint = fingerprint
        self._wrong_fingerprint = ""  # of a certificate that is not the link's
        self._hint = ""  # an unencrypted refusal, which anyone can have sent
        self._last_error = ""  # of the last handshake
        self._attempts = 0
        self._begun_ns = 0
        self._answered_ns = 0
        self._context = client_context(fingerprint, self._reject)
        self._association: Association | None = None
        self._session: DtlsSession | None = None  # since the handshake is done: OpenSSL's association is asked no more
        self._written = self._newest = -1  # highest numbers of the records of epoch 1, until then
        self._ready = False

    def _reject(self, fingerprint: str) -> None:
        self._wrong_fingerprint = fingerprint

    def _drop(self, reason: str) -> None:
        self.dropped[reason] += 1

    def ready(self, address: Address = PEER) -> bool:
        return self._ready and not self.failed

    def send(self, message: bytes, address: Address = PEER) -> bool:
        if not self._ready or self.failed or self._association is None:
            self._drop("no association yet" if not self.failed else "association failed")
            return False
        if not 0 < len(message) <= messages.MAX_MESSAGE_BYTES:
            self._drop("too large" if message else "empty")
            return False
        datagram = self._session.send(message) if self._session is not None else self._association.send(message)
        if not datagram:
            self._handle_failure()
            self._drop("association failed")
            return False
        self.outbox.append((PEER, datagram))
        return True

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        association = self._association
        if self.failed or association is None:
            self._drop("association failed" if self.failed else "unexpected")
            return ()
        if not datagram or len(datagram) > messages.MAX_DATAGRAM_BYTES:
            self._drop("too large" if datagram else "empty")
            return ()
        if not 20 <= datagram[0] <= 23:
            self._receive_unencrypted(datagram)
            return ()
        if self._session is not None:
            return self._open(self._session, association, datagram)
        received = association.feed(datagram)
        self._newest = max(self._newest, newest_number(datagram))
        if self._ready:
            if not received:
                self._drop("not authentic")
                if association.failed:
                    self._handle_failure()
                self._send_pending(association)
            return received
        if self._send_pending(association):  # only what brings the handshake on counts as an answer
            self._answered_ns = now_ns
        if association.ready and not association.failed:
            return self._check(association, received)
        if association.failed:
            self._handle_failure()
        return ()

    def _open(self, session: DtlsSession, association: Association, datagram: bytes) -> Sequence[bytes]:
        """Return the messages of a datagram of an association that is open."""
        received = session.receive(datagram)
        if not received:
            self._drop("not authentic")
            if session.closed:
                association.failed = CLOSED
                self._handle_failure()
        return tuple(received)

    def _check(self, association: Association, received: Sequence[bytes]) -> Sequence[bytes]:
        """Check once more, after the handshake, whom it was with."""
        theirs = association.peer_fingerprint()
        if theirs != self._fingerprint:
            self._wrong_fingerprint = theirs
            association.close()
            self._send_pending(association)
            self._handle_failure()
            return ()
        self._ready = True
        if association.connection.get_cipher_name() in SUITES:
            keys = export_keys(association.connection, self._written, self._newest, server=False)
            self._session = DtlsSession(keys)
        return received

    def poll(self, now_ns: int) -> None:
        if self.failed or self._ready:
            return
        association = self._association
        if association is None:
            self._begun_ns = now_ns
        elif now_ns - self._begun_ns >= GIVE_UP_NS:
            self.failed = self._why(f"no encrypted server answered within {GIVE_UP_NS / 1e9:g} s: {NO_ANSWER_CURE}")
            return
        elif now_ns - self._answered_ns < PATIENCE_NS[min(self._attempts, len(PATIENCE_NS)) - 1]:
            association.poll()
            self._send_pending(association)
            return
        self._attempts += 1
        if self._attempts > 1:
            self._drop("handshake begun again")
        self._answered_ns = now_ns
        self._written = self._newest = -1
        self._association = association = Association(self._context)
        association.connect()
        self._send_pending(association)

    def close(self, address: Address = PEER) -> None:
        if self._session is not None:
            if not self.failed:
                self.outbox.append((PEER, self._session.close()))
        elif self._association is not None:
            self._association.close()
            self._send_pending(self._association)
        self.failed = self.failed or "closed"

    def _send_pending(self, association: Association) -> bool:
        """Send the pending datagrams of an association; False if there are none."""
        datagrams = association.pop_datagrams()
        self._written = max(self._written, *map(newest_number, datagrams), -1)
        self.outbox.extend([(PEER, datagram) for datagram in datagrams])
        return bool(datagrams)

    def _receive_unencrypted(self, datagram: bytes) -> None:
        """Drop an unencrypted datagram, which anyone can have sent; a refusal is kept as a hint for people."""
        self._drop("not encrypted")
        if self._ready:
            return
        try:
            message = messages.decode(datagram)
        except messages.MalformedError:
            return
        if isinstance(message, messages.Refuse):
            self._hint = shown(f"{message.reason} [{message.code}]")

    def _handle_failure(self) -> None:
        """Give up where the failure is final, else let the next attempt follow."""
        association = self._association
        assert association is not None
        if self._wrong_fingerprint:
            self.failed = (
                f"the server's certificate has the fingerprint {self._wrong_fingerprint[:SHOWN_DIGITS]}…, the link names "
                f"{self._fingerprint[:SHOWN_DIGITS]}…: this is another server, or it was set up anew; ask for a new link"
            )
        elif self._ready or association.failed in FINAL:
            self.failed = self._why(association.failed)
        else:  # by a late flight of an earlier handshake, or by anyone on the path
            self._drop("handshake went wrong")
            self._last_error = association.failed

    def _why(self, reason: str) -> str:
        trouble = f"; the last handshake: {self._last_error}" if self._last_error else ""
        hint = f"; unencrypted came, perhaps from anyone: {self._hint}" if self._hint else ""
        return f"{reason}{trouble}{hint}"
