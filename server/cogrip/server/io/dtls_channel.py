"""The sealed server's channel: a DTLS association for each peer, over one socket.

    stranger --ClientHello--> a cookie is sent, nothing is kept --ClientHello with the cookie--> half open
    half open --handshake done--> open --seat in time--> open for as long as the seat lasts
    half open or open without a seat --WAITS_NS; no message for HELLO_WAITS_NS; too many of them--> gone

A ClientHello from an address that has an association goes the same way: only a handshake that was completed replaces the
old association (RFC 6347 section 4.2.8), so that nobody can end it by a forged source address.

OpenSSL sees of a client's records only what `ClientRecords` passes. After the handshake it sees no handshake record at all:
where the server's last flight was lost, it is sent again as it was.
"""

import hmac
import secrets
from collections import Counter, deque
from collections.abc import Callable, Sequence
from pathlib import Path

from cogrip.protocol.channel import Address, place_text
from cogrip.protocol.dtls_records import (
    CHANGE_CIPHER_SPEC,
    DATA,
    HANDSHAKE,
    RECORD_HEADER_BYTES,
    ClientRecords,
)
from cogrip.protocol.io.certificate import load
from cogrip.protocol.io.dtls import Association, client_random, cookie_in, is_client_hello, server_context
from cogrip.protocol.messages import MAX_DATAGRAM_BYTES, MAX_MESSAGE_BYTES
from cogrip.protocol.session import nonce_of, refusal
from cogrip.server.events import ServerEvent
from cogrip.server.io.free_memory import trim
from cogrip.server.rate_limit import Buckets, Budget, RateLimiter, network_of
from cogrip.server.unencrypted_channel import looks_like_hello

MOST_OPEN = 1024
MOST_UNSEATED = 128  # associations without a seat: half open, or open
MOST_ASKED = 24  # datagrams of an association without a seat: a client says hello four times a second, for five seconds
MOST_SHAKING = 24  # datagrams of a handshake: two flights of a client, one datagram each, and what is repeated
MOST_REPEATS = 4  # of the server's last flight
MOST_RECORDS = 4  # messages taken from one datagram
MOST_LEFT = 1024  # of one whose seat has ended: waves that were under way, and the account
WAITS_NS = 5_000_000_000  # for the end of a handshake, then for a seat
HELLO_WAITS_NS = 3_000_000_000  # for the first message after a handshake
SWEEP_EVERY_NS = 500_000_000
TRIM_AFTER = 64  # handshakes, of some 90 kB each, which malloc keeps when they are over
COOKIE_NS = 30_000_000_000  # a cookie fits for so long, and at most twice
COOKIE_BYTES = 16
TOLD = Budget(1, 10)  # happenings that are said: whoever knocks often is counted, and shall not fill a journal
MOST_TOLD = 64  # that wait to be said
UNFINISHED = "records came where the end of the handshake must"
SEALED = "this server speaks under a seal only: join by a link that it prints at its start, or `cogrip token new` makes"


class DtlsListener:
    """`Channel` of a sealed server. seated: whether someone sits at an address, as the core says.

    `events` holds what people should hear of; `renewed` the addresses where a new association has taken the place of an old
    one: who speaks there now has yet to show the right to what the old one had.
    """

    def __init__(
        self, folder: Path, rate_limiter: RateLimiter, seated: Callable[[Address], bool], *, most: int = MOST_OPEN
    ) -> None:
        """Raises CertificateError where the key or the certificate in `folder` cannot be used."""
        identity = load(folder)
        self.fingerprint = identity.fingerprint
        self.outbox: deque[tuple[Address, bytes]] = deque()
        self.dropped: dict[str, int] = {}
        self.failed = ""
        self.events: deque[ServerEvent] = deque(maxlen=MOST_TOLD)
        self.renewed: deque[Address] = deque(maxlen=most)
        self._rate_limiter = rate_limiter
        self._seated = seated
        self._most = most
        self._secret = secrets.token_bytes(32)
        self._cookies = (b"", b"")  # that the address in question may have: the one to send, the one before it
        self._context = server_context(identity, lambda _: self._cookies[0], lambda _, cookie: self._fits(cookie))
        self._authenticator = Association(self._context, server=True)
        self._voice = Buckets(1, TOLD)
        self._half: dict[Address, _Peer] = {}
        self._open: dict[Address, _Peer] = {}
        self._unseated: dict[Address, _Peer] = {}  # those that are open and have no seat
        self._sweep_ns = 0
        self._begun = 0  # handshakes since memory was given back

    def ready(self, address: Address) -> bool:
        return address in self._open

    def send(self, message: bytes, address: Address) -> bool:
        peer = self._open.get(address)
        if peer is None:
            self._drop("no seal")
            return False
        if not 0 < len(message) <= MAX_MESSAGE_BYTES:
            self._drop("too large" if message else "empty")
            return False
        datagram = peer.association.send(message)
        if not datagram:
            self._end(address, peer)
            return False
        self.outbox.append((address, datagram))
        return True

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        peer = self._open.get(address)
        if peer is not None and peer.seated and _of_session(datagram):  # nearly all; the same as below, in fewer steps
            reason = self._rate_limiter.peer(address, now_ns)
            if not reason:
                return self._hear(peer, datagram, address, now_ns)
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
            return self._strange(datagram, address, now_ns)
        if is_client_hello(datagram):
            self._greet(datagram, address, now_ns)
            return ()
        if peer is None and half is None:
            self._drop("stranger")
            return ()
        reason = self._rate_limiter.peer(address, now_ns) or (
            "no record" if len(datagram) < RECORD_HEADER_BYTES else ""
        )
        if reason:
            self._drop(reason)
            return ()
        if half is not None and (peer is None or _of_handshake(datagram)):
            return self._shake(half, datagram, address, now_ns)
        assert peer is not None
        if not peer.seated and not self._may_ask(peer, address, now_ns):
            return ()
        passed = peer.records.passed(datagram)
        if peer.records.repeats:
            self._repeat(peer, address)
        return self._hear(peer, passed, address, now_ns) if passed else ()

    def _repeat(self, peer: "_Peer", address: Address) -> None:
        """A client that has not received the end of the handshake sends its own again (RFC 6347 section 4.2.4)."""
        if peer.repeats < MOST_REPEATS and not peer.heard:
            peer.repeats += 1
            self.outbox.extend([(address, datagram) for datagram in peer.last_flight])

    def _hear(self, peer: "_Peer", datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        heard = self._some(peer.association.feed(datagram), address, now_ns)
        if not heard:
            self._drop("not of this seal")
            self._take(peer, address)
            if peer.association.failed:
                self._end(address, peer)
        else:
            peer.heard = True
        return heard

    def _some(self, heard: Sequence[bytes], address: Address, now_ns: int) -> Sequence[bytes]:
        """Of what came in one datagram: senders put one message in each, and the budget is one of messages."""
        for place in range(1, len(heard)):
            if place == MOST_RECORDS or self._rate_limiter.peer(address, now_ns):
                self._drop("too many records")
                return heard[:place]
        return heard

    def _may_ask(self, peer: "_Peer", address: Address, now_ns: int) -> bool:
        """Who has no seat may ask for one a few times: a seal costs the stranger little, each refusal the server some."""
        if self._look(peer, address, now_ns):
            return True
        peer.asked += 1
        if peer.asked <= peer.may_ask:
            return True
        self._drop("asked too often")
        self.close(address)
        return False

    def _look(self, peer: "_Peer", address: Address, now_ns: int) -> bool:
        """Return whether somebody has a seat by this association now."""
        seated = self._seated(address)
        if seated != peer.seated:
            peer.seated = seated
            peer.had_seat = True
            self._rate_limiter.seated(address, now_ns)
            if seated:
                peer.asked, peer.may_ask = 0, MOST_LEFT
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
        if peer is not None:
            peer.association.close()
            self._take(peer, address)

    def counts(self) -> dict[str, int]:
        """How many associations there are: open, and half open."""
        return {"open": len(self._open), "half open": len(self._half)}

    def _drop(self, reason: str) -> None:
        self.dropped[reason] = self.dropped.get(reason, 0) + 1

    def _take(self, peer: "_Peer", address: Address, *, last: bool = False) -> None:
        """last: this is the end of a handshake."""
        datagrams = peer.association.pop_datagrams()
        if last:
            peer.last_flight = datagrams
        self.outbox.extend([(address, datagram) for datagram in datagrams])

    def _strange(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        """No seal, and nobody known: at most someone who has to be told that a seal is needed."""
        if not looks_like_hello(datagram):
            self._drop("stranger")
            return ()
        reason = self._rate_limiter.contact(address, now_ns)
        self._drop(reason or "refused: sealed")
        if not reason:
            answer = refusal(nonce_of(datagram), "sealed", SEALED)
            self.outbox.append((address, answer))
            self._tell(f"refused {place_text(address)}: it spoke without a seal", address, "sealed", now_ns)
        return ()

    def _greet(self, datagram: bytes, address: Address, now_ns: int) -> None:
        """A ClientHello. Until its cookie fits nothing is kept, and the answer is no longer than the question."""
        half, peer, nonce = self._half.get(address), self._open.get(address), client_random(datagram)
        cookie, fits = cookie_in(datagram), False
        if len(cookie) == COOKIE_BYTES:
            self._cookies = self._cookies_of(address, now_ns)
            fits = self._fits(cookie)
        if fits and half is not None and half.nonce == nonce:  # repeated: its handshake goes on
            self._drop("hello again")
            self._shake(half, datagram, address, now_ns)
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
        self._cookies = self._cookies_of(address, now_ns)
        passes = ClientRecords(self._drop)
        passed = passes.passed(datagram)
        if not passed:
            return
        heard = self._authenticator.listen(passed)
        answers = self._authenticator.pop_datagrams()
        if sum(map(len, answers)) > len(datagram):
            self._drop("answer too long")
            return
        self.outbox.extend([(address, answer) for answer in answers])
        if not heard:
            self._drop("cookie sent" if answers else "malformed hello")
            return
        self._admit(_Peer(self._authenticator, nonce, address, now_ns, passes), address)

    def _admit(self, peer: "_Peer", address: Address) -> None:
        self._authenticator = Association(self._context, server=True)
        self._begun += 1
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
        """End the oldest association without a seat of the network that has most of them; who had a seat lately goes last.

        So somebody with one address displaces only themselves; with many they displace nobody before MOST_UNSEATED more
        handshakes were begun, for which there is a budget: longer than a newcomer needs for a seat.
        """
        waiting = [*self._half.values(), *self._unseated.values()]
        shares = Counter([peer.network for peer in waiting])
        oldest = min(waiting, key=lambda peer: (peer.had_seat, -shares[peer.network], peer.since_ns))
        self._drop("too many without a seat")
        if self._half.get(oldest.address) is oldest:
            del self._half[oldest.address]
        else:
            self.close(oldest.address)

    def _shake(self, half: "_Peer", datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        association = half.association
        half.asked += 1
        if half.asked > MOST_SHAKING:
            del self._half[address]
            self._drop("handshake too long")
            return ()
        passed = half.records.passed(datagram)
        if not passed:
            return ()
        heard = association.feed(passed)
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
        half.since_ns, half.asked, half.heard = now_ns, 0, bool(heard)
        self._open[address] = self._unseated[address] = half
        return heard

    def _fail(self, peer: "_Peer", address: Address, now_ns: int) -> None:
        reason = peer.association.failed
        self._drop(f"handshake failed: {reason}")
        self._tell(f"refused {place_text(address)}: {reason}", address, "seal", now_ns)

    def _end(self, address: Address, peer: "_Peer") -> None:
        del self._open[address]
        self._unseated.pop(address, None)
        self._drop(f"seal ended: {peer.association.failed}")

    def _sweep(self, now_ns: int) -> None:
        """Close what nobody sits behind."""
        for address, peer in list(self._open.items()):
            waited_ns = now_ns - peer.since_ns
            if self._look(peer, address, now_ns):
                peer.since_ns = now_ns
            elif waited_ns >= WAITS_NS or (waited_ns >= HELLO_WAITS_NS and not peer.heard):
                self._drop("no seat in time" if peer.heard else "no hello in time")
                self.close(address)
        if self._begun >= TRIM_AFTER and not self._half and not self._unseated:
            self._begun = 0
            trim()

    def _tell(self, text: str, address: Address, code: str, now_ns: int) -> None:
        if self._voice.take(0, now_ns):
            self.events.append(ServerEvent("refused", text, address=place_text(address), code=code))

    def _cookies_of(self, address: Address, now_ns: int) -> tuple[bytes, bytes]:
        """What this address may have been sent lately."""
        number, text = now_ns // COOKIE_NS, repr(address)
        now, before = [
            hmac.digest(self._secret, f"{each} {text}".encode(), "sha256")[:COOKIE_BYTES]
            for each in (number, number - 1)
        ]
        return now, before

    def _fits(self, cookie: bytes) -> bool:
        now, before = self._cookies
        return hmac.compare_digest(cookie, now) or hmac.compare_digest(cookie, before)


class _Peer:
    """An association, which handshake it is of, and since when it has been without the next step."""

    __slots__ = (
        "address", "asked", "association", "had_seat", "heard", "last_flight", "may_ask", "network", "nonce", "records",
        "repeats", "seated", "since_ns",
    )  # fmt: skip

    def __init__(
        self, association: Association, nonce: bytes, address: Address, now_ns: int, passes: ClientRecords
    ) -> None:
        self.association = association
        self.nonce = nonce
        self.address = address
        self.network = network_of(address)
        self.records = passes
        self.since_ns = now_ns
        self.seated = False  # as far as was looked at
        self.had_seat = False  # or somebody else at this address, lately
        self.heard = False  # a message has come
        self.asked = 0  # datagrams of this handshake, then since there was no seat
        self.may_ask = MOST_ASKED
        self.last_flight: Sequence[bytes] = ()
        self.repeats = 0  # how often that was sent again


def _of_session(datagram: bytes) -> bool:
    """Return whether a datagram is one record of messages under a seal, by its header."""
    return (
        RECORD_HEADER_BYTES < len(datagram) <= MAX_DATAGRAM_BYTES
        and datagram[0] == DATA
        and bool(datagram[3] or datagram[4])
        and len(datagram) == RECORD_HEADER_BYTES + int.from_bytes(datagram[11:13], "big")
    )


def _of_handshake(datagram: bytes) -> bool:
    """Whether a datagram can only be of a handshake that is under way: all but messages, and alerts under a seal."""
    return datagram[0] in (CHANGE_CIPHER_SPEC, HANDSHAKE) or not (datagram[3] or datagram[4])
