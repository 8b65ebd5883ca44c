"""Channel of an encrypted server: a DTLS association for each peer, over one socket.

    unknown --ClientHello--> a cookie is sent, nothing is kept --ClientHello with the cookie--> half open
    half open --handshake done--> open --seat in time--> open for as long as the seat lasts
    half open or open without a seat --WAITS_NS; no message for HELLO_WAITS_NS; too many of them--> gone

A ClientHello from an address that has an association takes the same path: only a completed handshake replaces the old
association (RFC 6347 section 4.2.8), so that nobody can end it by a forged source address.

OpenSSL sees of a client's records only what `ClientRecords` passes, and after the handshake no handshake record at all: where
the server's last flight was lost, it is sent again as it was.
"""

import hmac
import secrets
from collections import Counter, deque
from collections.abc import Callable, Sequence
from pathlib import Path

from cogrip.machine.addition import add_integers
from cogrip.protocol.io.certificate import load
from cogrip.protocol.io.dtls import CLOSED, Association, client_random, cookie_in, is_client_hello, server_context
from cogrip.protocol.io.dtls_session import SessionKeys, export_keys, newest_number
from cogrip.protocol.secure.channel import Address, place_text
from cogrip.protocol.secure.dtls_records import HANDSHAKE, RECORD_HEADER_BYTES, ClientRecords
from cogrip.protocol.wire.messages import MAX_MESSAGE_BYTES
from cogrip.protocol.wire.session import nonce_of, refusal
from cogrip.server.events import ServerEvent
from cogrip.server.io.dtls_peer import (
    COOKIE_BYTES,
    Peer,
    cookies_of,
    is_of_handshake,
    is_of_session,
    trim,
)
from cogrip.server.rate_limit import Buckets, Budget, RateLimiter
from cogrip.server.unencrypted_channel import ENCRYPTED_ONLY, looks_like_hello

MOST_OPEN = 1024
MOST_UNSEATED = 128  # most associations without a seat, half open or open
MOST_ASKED = 24
"""Most datagrams of an association without a seat: a client says hello four times a second, for five seconds."""
MOST_SHAKING = 24  # most datagrams of a handshake: two flights of a client, one datagram each, and what is repeated
MOST_REPEATS = 4  # most repetitions of the server's last flight
MOST_RECORDS = 4  # most messages that are taken from one datagram
MOST_LEFT = 1024  # most datagrams after a seat has ended: waves that were under way, and the account
WAITS_NS = 5_000_000_000  # time for a handshake, then for a seat
HELLO_WAITS_NS = 3_000_000_000  # time for the first message after a handshake
SWEEP_EVERY_NS = 500_000_000
TRIM_AFTER = 64  # number of handshakes after which memory is given back: malloc keeps some 90 kB of each
REPORTED = Budget(1, 10)  # budget of reported events; others are only counted, so that nobody can fill a log
MOST_EVENTS = 64  # most events that wait to be reported
UNFINISHED = "records came where the end of the handshake must"


class DtlsListener:
    """`Channel` of an encrypted server. seated: says whether somebody in a session is at an address (`ServerCore.knows`).

    events   to be reported
    renewed  addresses where a new association has replaced the old one: its peer has yet to resume what the old one had
    """

    def __init__(
        self, folder: Path, rate_limiter: RateLimiter, seated: Callable[[Address], bool], *, most: int = MOST_OPEN
    ) -> None:
        """folder: of key and certificate; raises CertificateError where they cannot be used. most: associations."""
        identity = load(folder)
        self.fingerprint = identity.fingerprint
        self.outbox: deque[tuple[Address, bytes]] = deque()
        self.dropped: dict[str, int] = Counter()
        self.failed = ""
        self.events: deque[ServerEvent] = deque(maxlen=MOST_EVENTS)
        self.renewed: deque[Address] = deque(maxlen=most)
        self._rate_limiter = rate_limiter
        self._seated = seated
        self._most = most
        self._secret = secrets.token_bytes(32)
        self._cookies = (b"", b"")  # valid for the address in question: the newest is sent
        self._context = server_context(identity, lambda _: self._cookies[0], lambda _, cookie: self._fits(cookie))
        self._listener = Association(self._context, server=True)
        self._event_budget = Buckets(1, REPORTED)
        self._half: dict[Address, Peer] = {}
        self._open: dict[Address, Peer] = {}
        self._unseated: dict[Address, Peer] = {}  # open, without a seat
        self._sweep_ns = 0
        self._handshakes = 0  # handshakes since `trim`

    def ready(self, address: Address) -> bool:
        return address in self._open

    def send(self, message: bytes, address: Address) -> bool:
        peer = self._open.get(address)
        if peer is None:
            self._drop("no association")
            return False
        if not 0 < len(message) <= MAX_MESSAGE_BYTES:
            self._drop("too large" if message else "empty")
            return False
        if peer.session is not None:
            self.outbox.append((address, peer.session.send(message)))
            return True
        datagram = peer.association.send(message)
        if not datagram:
            self._end(address, peer)
            return False
        peer.written = newest_number(datagram)
        self.outbox.append((address, datagram))
        return True

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        peer = self._open.get(address)
        if peer is not None and peer.seated and is_of_session(datagram):  # nearly all: a short cut of the general case
            reason = self._rate_limiter.peer(address, now_ns)
            if not reason:
                return self._decrypt(peer, datagram, address, now_ns)
            self._drop(reason)
            return ()
        return self._sort(datagram, address, now_ns)

    def _sort(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        reason = self._rate_limiter.size(datagram)
        if reason:
            self._drop(reason)
            return ()
        peer, half = self._open.get(address), self._half.get(address)
        if peer is None and half is None and datagram[0] != HANDSHAKE:
            return self._receive_unencrypted(datagram, address, now_ns)
        if is_client_hello(datagram):
            self._receive_client_hello(datagram, address, now_ns)
            return ()
        if peer is None and half is None:
            self._drop("unauthenticated")
            return ()
        short = "no record" if len(datagram) < RECORD_HEADER_BYTES else ""
        if reason := self._rate_limiter.peer(address, now_ns) or short:
            self._drop(reason)
            return ()
        if half is not None and (peer is None or is_of_handshake(datagram)):
            return self._continue_handshake(half, datagram, address, now_ns)
        assert peer is not None
        if not peer.seated and not self._may_request(peer, address, now_ns):
            return ()
        passed = peer.records.passed(datagram)
        if peer.records.repeats:
            self._repeat(peer, address)
        return self._decrypt(peer, passed, address, now_ns) if passed else ()

    def _repeat(self, peer: Peer, address: Address) -> None:
        """Repeat the last flight: a client that has not received it repeats its own (RFC 6347 section 4.2.4)."""
        if peer.repeats < MOST_REPEATS and not peer.has_received:
            peer.repeats += 1
            self.outbox.extend([(address, datagram) for datagram in peer.last_flight])

    def _decrypt(self, peer: Peer, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        session = peer.session
        if session is not None:
            received = self._bounded(session.receive(datagram), address, now_ns)
            if not received:
                self._drop("not authentic")
            if session.closed:
                peer.association.failed = CLOSED
                self._end(address, peer)
            return received or ()
        received = self._bounded(peer.feed(datagram), address, now_ns)
        if not received:
            self._drop("not authentic")
            self._take(peer, address)
            if peer.association.failed:
                self._end(address, peer)
        else:
            peer.has_received = True
        return received

    def _bounded(self, received: Sequence[bytes], address: Address, now_ns: int) -> Sequence[bytes]:
        """Return the messages of one datagram that the budget of messages allows; a good sender puts one in each."""
        for place in range(1, len(received)):
            if place == MOST_RECORDS or self._rate_limiter.peer(address, now_ns):
                self._drop("too many records")
                return received[:place]
        return received

    def _may_request(self, peer: Peer, address: Address, now_ns: int) -> bool:
        """Return whether a peer may send: without a seat only some datagrams, as each refusal costs the server time."""
        if self._update_seated(peer, address, now_ns):
            return True
        peer.requests += 1
        if peer.requests <= peer.most_requests:
            return True
        self._drop("asked too often")
        self.close(address)
        return False

    def _update_seated(self, peer: Peer, address: Address, now_ns: int) -> bool:
        """Return whether this association has a seat now, and note a change."""
        seated = self._seated(address)
        if seated != peer.seated:
            peer.seated = seated
            peer.had_seat = True
            self._rate_limiter.seated(address, now_ns)
            if seated:
                peer.begin_session()
                peer.requests, peer.most_requests = 0, MOST_LEFT
                self._unseated.pop(address, None)
            else:
                self._unseated[address] = peer
        return seated

    def poll(self, now_ns: int) -> None:
        for address, peer in list(self._half.items()):
            if now_ns - peer.since_ns >= WAITS_NS:
                del self._half[address]
                self._drop("handshake timed out")
                continue
            peer.association.poll()
            self._take(peer, address)
        if now_ns >= self._sweep_ns:
            self._sweep_ns = now_ns + SWEEP_EVERY_NS
            self._sweep(now_ns)

    def close(self, address: Address) -> None:
        self._half.pop(address, None)
        self._unseated.pop(address, None)
        peer = self._open.pop(address, None)
        if peer is not None and peer.session is not None:
            self.outbox.append((address, peer.session.close()))
        elif peer is not None:
            peer.association.close()
            self._take(peer, address)

    def hand_over(self, address: Address, last: bytes) -> SessionKeys | None:
        """Send a last message, and return the keys by which another process goes on; None where it cannot be sent."""
        peer = self._open.get(address)
        if peer is None or peer.session is not None or not self.send(last, address):
            return None
        del self._open[address]
        self._unseated.pop(address, None)
        self._rate_limiter.seated(address, peer.since_ns)
        return export_keys(peer.association.connection, newest_number(self.outbox[-1][1]), peer.newest)

    def counts(self) -> dict[str, int]:
        """Return the numbers of associations, open and half open."""
        return {"open": len(self._open), "half open": len(self._half)}

    def _drop(self, reason: str) -> None:
        self.dropped[reason] += 1

    def _take(self, peer: Peer, address: Address, *, last: bool = False) -> None:
        """Send what an association has to send. last: this is the end of a handshake."""
        datagrams = peer.association.pop_datagrams()
        for datagram in datagrams:
            peer.written = max(peer.written, newest_number(datagram))
        if last:
            peer.last_flight = datagrams
        self.outbox.extend([(address, datagram) for datagram in datagrams])

    def _receive_unencrypted(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        """Refuse an unencrypted hello of an unknown peer; drop all else."""
        if not looks_like_hello(datagram):
            self._drop("unauthenticated")
            return ()
        reason = self._rate_limiter.contact(address, now_ns)
        self._drop(reason or "refused: not encrypted")
        if not reason:
            answer = refusal(nonce_of(datagram), "sealed", ENCRYPTED_ONLY)
            self.outbox.append((address, answer))
            self._report(f"refused {place_text(address)}: its hello was not encrypted", address, "sealed", now_ns)
        return ()

    def _receive_client_hello(self, datagram: bytes, address: Address, now_ns: int) -> None:
        """Answer a ClientHello. Until its cookie is valid nothing is kept, and the answer is no longer than the request."""
        half, peer, nonce = self._half.get(address), self._open.get(address), client_random(datagram)
        cookie, fits = cookie_in(datagram), False
        if len(cookie) == COOKIE_BYTES:
            self._cookies = cookies_of(self._secret, address, now_ns)
            fits = self._fits(cookie)
        if fits and half is not None and half.nonce == nonce:  # repeated: its handshake goes on
            self._drop("hello again")
            self._continue_handshake(half, datagram, address, now_ns)
            return
        if fits and peer is not None and peer.nonce == nonce:
            self._drop("hello again")
            return
        reason = (self._rate_limiter.handshake if fits else self._rate_limiter.contact)(address, now_ns)
        if not reason and fits and peer is None and len(self._open) >= self._most:
            reason = "too many associations"
        if reason:
            self._drop(reason)
            return
        self._cookies = cookies_of(self._secret, address, now_ns)
        records = ClientRecords(self._drop)
        passed = records.passed(datagram)
        if not passed:
            return
        complete = self._listener.listen(passed)
        answers = self._listener.pop_datagrams()
        if add_integers(map(len, answers)) > len(datagram):
            self._drop("answer too long")
            return
        self.outbox.extend([(address, answer) for answer in answers])
        if not complete:
            self._drop("cookie sent" if answers else "malformed hello")
            return
        self._admit(Peer(self._listener, nonce, address, now_ns, records, MOST_ASKED), address)

    def _admit(self, peer: Peer, address: Address) -> None:
        self._listener = Association(self._context, server=True)
        self._handshakes += 1
        peer.had_seat = self._rate_limiter.was_seated(address, peer.since_ns)
        peer.association.accept()
        self._take(peer, address)
        if peer.association.failed:
            self._fail(peer, address, peer.since_ns)
            return
        if self._half.pop(address, None) is not None:
            self._drop("handshake begun again")
        elif len(self._half) + len(self._unseated) >= MOST_UNSEATED:
            self._evict()
        self._half[address] = peer

    def _evict(self) -> None:
        """End the oldest association without a seat of the network that has most of them; peers with a recent seat go last.

        An attacker with one address evicts only itself; with many it evicts nobody before MOST_UNSEATED more handshakes were
        begun, for which there is a budget: longer than a newcomer needs for a seat.
        """
        waiting = [*self._half.values(), *self._unseated.values()]
        counts = Counter([peer.network for peer in waiting])
        oldest = min(waiting, key=lambda peer: (peer.had_seat, -counts[peer.network], peer.since_ns))
        self._drop("too many without a seat")
        if self._half.get(oldest.address) is oldest:
            del self._half[oldest.address]
        else:
            self.close(oldest.address)

    def _continue_handshake(self, half: Peer, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        association = half.association
        half.requests += 1
        if half.requests > MOST_SHAKING:
            del self._half[address]
            self._drop("handshake too long")
            return ()
        passed = half.records.passed(datagram)
        if not passed:
            return ()
        received = association.feed(passed)
        self._take(half, address, last=association.ready)
        if not association.ready and half.records.overdue:
            association.failed = association.failed or UNFINISHED
        if association.failed:
            del self._half[address]
            self._fail(half, address, now_ns)
            return ()
        if not association.ready:
            self._drop("amid a handshake")
            return ()
        del self._half[address]
        half.records.open()
        if self._open.pop(address, None) is not None:
            self._unseated.pop(address, None)
            self.renewed.append(address)
        elif len(self._open) >= self._most:
            self._drop("too many associations")
            association.close()
            self._take(half, address)
            return ()
        half.since_ns, half.requests, half.has_received = now_ns, 0, bool(received)
        half.newest = newest_number(datagram) if received else 0  # 0: the client's Finished
        self._open[address] = self._unseated[address] = half
        return received

    def _fail(self, peer: Peer, address: Address, now_ns: int) -> None:
        reason = peer.association.failed
        self._drop(f"handshake failed: {reason}")
        self._report(f"refused {place_text(address)}: {reason}", address, "handshake", now_ns)

    def _end(self, address: Address, peer: Peer) -> None:
        del self._open[address]
        self._unseated.pop(address, None)
        self._drop(f"association ended: {peer.association.failed}")

    def _sweep(self, now_ns: int) -> None:
        """Close associations without a seat whose time is over."""
        for address, peer in list(self._open.items()):
            waited_ns = now_ns - peer.since_ns
            if self._update_seated(peer, address, now_ns):
                peer.since_ns = now_ns
            elif waited_ns >= WAITS_NS or (waited_ns >= HELLO_WAITS_NS and not peer.has_received):
                self._drop("no seat in time" if peer.has_received else "no hello in time")
                self.close(address)
        if self._handshakes >= TRIM_AFTER and not self._half and not self._unseated:
            self._handshakes = 0
            trim()

    def _report(self, text: str, address: Address, code: str, now_ns: int) -> None:
        if self._event_budget.take(0, now_ns):
            self.events.append(ServerEvent("refused", text, address=place_text(address), code=code))

    def _fits(self, cookie: bytes) -> bool:
        return any(hmac.compare_digest(cookie, each) for each in self._cookies)
