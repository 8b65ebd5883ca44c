"""A client's sealed channel: one handshake with the server whose certificate the link names, and what follows it.

A handshake that gets no answer is begun anew, with new keys, each time after a longer wait: sooner than OpenSSL would
repeat a flight. Nothing is sent before the server has shown the certificate, and nothing is ever sent without a seal.
"""

from collections import deque
from collections.abc import Sequence

from cogrip.protocol import messages
from cogrip.protocol.channel import PEER, Address
from cogrip.protocol.io.dtls import FINAL, Association, client_context

PATIENCE_NS = (500_000_000, 700_000_000, 900_000_000)  # without an answer; the last for all that follow
GIVE_UP_NS = 10_000_000_000
SHOWN_DIGITS = 16
NO_ANSWER_CURE = (
    "is it running and sealed, and is its UDP port open and forwarded on the way? A plain server is joined by HOST:PORT"
)


class DtlsClient:
    """`Channel` of a client. fingerprint: of the server's certificate, 64 lower-case hex digits."""

    def __init__(self, fingerprint: str) -> None:
        self.outbox: deque[tuple[Address, bytes]] = deque()
        self.dropped: dict[str, int] = {}
        self.failed = ""
        self._fingerprint = fingerprint
        self._found = ""  # fingerprint of a certificate that was not the server's
        self._hint = ""
        self._trouble = ""  # why the last handshake went wrong
        self._dials = 0
        self._begun_ns = 0
        self._heard_ns = 0
        self._context = client_context(fingerprint, self._see)
        self._association: Association | None = None
        self._ready = False

    def _see(self, fingerprint: str) -> None:
        self._found = fingerprint

    def _drop(self, reason: str) -> None:
        self.dropped[reason] = self.dropped.get(reason, 0) + 1

    def ready(self, address: Address = PEER) -> bool:
        return self._ready and not self.failed

    def send(self, message: bytes, address: Address = PEER) -> bool:
        if not self._ready or self.failed or self._association is None:
            self._drop("not sealed yet" if not self.failed else "seal failed")
            return False
        if not 0 < len(message) <= messages.MAX_MESSAGE_BYTES:
            self._drop("too large" if message else "empty")
            return False
        datagram = self._association.send(message)
        if not datagram:
            self._judge()
            self._drop("seal failed")
            return False
        self.outbox.append((PEER, datagram))
        return True

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        association = self._association
        if self.failed or association is None:
            self._drop("seal failed" if self.failed else "unexpected")
            return ()
        if not datagram or len(datagram) > messages.MAX_DATAGRAM_BYTES:
            self._drop("too large" if datagram else "empty")
            return ()
        if not 20 <= datagram[0] <= 23:
            self._plain(datagram)
            return ()
        if self._ready:
            heard = association.feed(datagram)
            if not heard:
                self._drop("not of this seal")
                if association.failed:
                    self._judge()
                self._take(association)
            return heard
        heard = association.feed(datagram)
        if self._take(association):  # only what brings the handshake on counts as an answer
            self._heard_ns = now_ns
        if association.ready and not association.failed:
            return self._check(association, heard)
        if association.failed:
            self._judge()
        return ()

    def _check(self, association: Association, heard: Sequence[bytes]) -> Sequence[bytes]:
        """The handshake is over: look once more whom it was with."""
        theirs = association.peer_fingerprint()
        if theirs != self._fingerprint:
            self._found = theirs
            association.close()
            self._take(association)
            self._judge()
            return ()
        self._ready = True
        return heard

    def poll(self, now_ns: int) -> None:
        if self.failed or self._ready:
            return
        association = self._association
        if association is None:
            self._begun_ns = now_ns
        elif now_ns - self._begun_ns >= GIVE_UP_NS:
            self.failed = self._why(f"no sealed server answered within {GIVE_UP_NS / 1e9:g} s: {NO_ANSWER_CURE}")
            return
        elif now_ns - self._heard_ns < PATIENCE_NS[min(self._dials, len(PATIENCE_NS)) - 1]:
            association.poll()
            self._take(association)
            return
        self._dials += 1
        if self._dials > 1:
            self._drop("handshake begun again")
        self._heard_ns = now_ns
        self._association = association = Association(self._context)
        association.dial()
        self._take(association)

    def close(self, address: Address = PEER) -> None:
        if self._association is not None:
            self._association.close()
            self._take(self._association)
        self.failed = self.failed or "closed"

    def _take(self, association: Association) -> bool:
        """Put on the way what an association left; False if that is nothing."""
        datagrams = association.take()
        self.outbox.extend([(PEER, datagram) for datagram in datagrams])
        return bool(datagrams)

    def _plain(self, datagram: bytes) -> None:
        """Anyone can have sent this: at most a hint for people."""
        self._drop("not sealed")
        if self._ready:
            return
        try:
            message = messages.decode(datagram)
        except messages.MalformedError:
            return
        if isinstance(message, messages.Refuse):
            self._hint = messages.shown(f"{message.reason} [{message.code}]")

    def _judge(self) -> None:
        """The association failed: for good, or for this time."""
        association = self._association
        assert association is not None
        if self._found:
            self.failed = (
                f"the server's certificate has the fingerprint {self._found[:SHOWN_DIGITS]}…, the link names "
                f"{self._fingerprint[:SHOWN_DIGITS]}…: this is another server, or it was set up anew; ask for a new link"
            )
        elif self._ready or association.failed in FINAL:
            self.failed = self._why(association.failed)
        else:  # a late flight of an earlier handshake can do that, and so can anyone on the way
            self._drop("handshake went wrong")
            self._trouble = association.failed

    def _why(self, reason: str) -> str:
        trouble = f"; the last handshake: {self._trouble}" if self._trouble else ""
        hint = f"; without a seal came, perhaps from anyone: {self._hint}" if self._hint else ""
        return f"{reason}{trouble}{hint}"
