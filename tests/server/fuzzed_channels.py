"""Unauthenticated peers without number: seeded mutations of real traffic against unencrypted and encrypted channel.

Each of the `DOORS` raises AssertionError where something passes, where anything grows, or where somebody else is disturbed.
"""

import random
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from OpenSSL.SSL import _lib  # type: ignore[attr-defined]

from cogrip.protocol.secure.channel import PEER, Address
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import MAX_DATAGRAM_BYTES, Hello, Stamp, Waves
from cogrip.protocol.wire.session import foreign_version, make_hello
from cogrip.server.io.dtls_channel import MOST_UNSEATED
from cogrip.server.rate_limit import LIMITS, RateLimiter
from cogrip.server.unencrypted_channel import UnencryptedListener, looks_like_hello

from tests.server.encrypted_network import ANNA, BEN, NO_LIMITS, Wire

FLOOD_NS = 50_000  # 20,000 datagrams a second
MOST_NAMES = 40  # under which datagrams are dropped
VISITED_EVERY = {True: 20_000, False: 2_000}  # with budgets: so that they run out
STRANGERS: list[Address] = [
    *[(f"127.0.{number}.{number % 7}", 1024 + number) for number in range(300)],
    *[(f"2001:db8:{number:x}::1", 4000, 0, 0) for number in range(100)],
]


def mutated(chance: random.Random, datagram: bytes, others: Sequence[bytes]) -> bytes:
    """A datagram that is no longer what it was, one to four times over."""
    changed = bytearray(datagram)
    for _ in range(chance.choice((1, 1, 2, 4))):
        at = chance.randrange(len(changed)) if changed else 0
        match chance.randrange(8):
            case 0 | 1:
                if changed:
                    changed[at] ^= 1 << chance.randrange(8)
            case 2:
                if changed:
                    changed[at] = chance.choice((0, 1, 0x7F, 0x80, 0xFE, 0xFF))
            case 3:
                del changed[at:]
            case 4:
                changed[at:at] = chance.randbytes(chance.choice((1, 2, 16, 300)))
            case 5:
                changed[at:] = chance.choice(others)[chance.randrange(60) :]
            case 6:
                changed = changed[at:] + changed[:at]
            case 7:
                head = chance.randrange(min(len(changed), 60) + 1)  # where headers are
                changed[head : head + 2] = chance.randbytes(2)
    return bytes(changed[: MAX_DATAGRAM_BYTES + 8])


def unencrypted_traffic() -> list[bytes]:
    """Return hellos and waves as an unencrypted port receives them."""
    traffic = []
    for number in range(8):
        hello = make_hello(
            software="test", nonce=number + 1, room="lab", name="", digest="", device="sim:phantom", axes=3, rate_hz=1024.0,
            token="x" * 22,
        )  # fmt: skip
        traffic.append(messages.padded(hello))
        wave = tuple(0.1 * step for step in range(8))
        traffic.append(messages.encode(Waves(number + 1, 8, wave, (0.0,), (1.0,), 0.1, 0.2, 7, Stamp(1), (0.0, 0.1))))
    return traffic


def encrypted_traffic(wire: Wire) -> list[tuple[Address, bytes]]:
    """Every flight of handshakes that were done, in both directions, and what was said after them; with whose it was."""
    for address in (ANNA, BEN):
        wire.seal(address)
        for _ in range(4):
            wire.talk(address)
    return [(address, datagram) for _, address, datagram in wire.log]


def fuzz_unencrypted(datagrams: int, folder: Path, seed: int) -> dict[str, int]:
    """Send to an unencrypted channel, also from the address of a seated peer. Returns the drops."""
    chance = random.Random(seed)
    seated: Address = ("10.0.0.1", 4001)
    authenticator = UnencryptedListener(RateLimiter(b"s" * 16, LIMITS), lambda address: address == seated)
    traffic = unencrypted_traffic()
    now_ns = passed = 0
    for _ in range(datagrams):
        now_ns += FLOOD_NS
        datagram = mutated(chance, chance.choice(traffic), traffic)
        address = chance.choice(STRANGERS) if chance.random() < 0.95 else seated
        for message in authenticator.receive(datagram, address, now_ns):
            passed += address != seated
            assert address == seated or looks_like_hello(message), message
            try:
                decoded = messages.decode(message)
            except messages.MalformedError:
                foreign_version(message)
            else:
                assert address == seated or isinstance(decoded, Hello)
    assert not authenticator.outbox
    assert len(authenticator.dropped) <= MOST_NAMES
    strangers = 2 * LIMITS.contacts.burst + 2 * LIMITS.contacts.per_second * (now_ns * 1e-9 + 1.0)  # new, and again
    assert passed <= strangers
    return authenticator.dropped


def fuzz_encrypted(datagrams: int, folder: Path, seed: int, *, limited: bool = True) -> dict[str, int]:
    """Send to an encrypted channel, during handshakes of others too. Returns the drops."""
    chance = random.Random(seed)
    wire = Wire(folder, LIMITS if limited else NO_LIMITS)
    standing = [*encrypted_traffic(wire), *((BEN, datagram) for datagram in unencrypted_traffic())]
    traffic, everything = standing, [datagram for _, datagram in standing]
    wire.heard.clear()
    for number in range(datagrams):
        if number % VISITED_EVERY[limited] == 0:
            # by guests who are gone again: their cookies and their seals are still fresh
            guests = [_visit(wire, ("10.7.0.1", (number + each) % 60_000)) for each in range(2)]
            traffic = standing + guests[0] + guests[1]
            everything = [datagram for _, datagram in traffic]
        wire.now_ns += FLOOD_NS
        whose, datagram = chance.choice(traffic)
        datagram = mutated(chance, datagram, everything)
        # from its own address, where a cookie of it fits, or from any other; Anna is spared, and is to notice nothing
        address = whose if whose != ANNA and chance.random() < 0.4 else chance.choice(STRANGERS)
        assert wire.inject(datagram, address) == (), datagram
        first = sum(len(answer) for to, answer in wire.listener.outbox if to == address)
        assert first <= len(datagram) or address == whose, datagram
        wire.listener.outbox.clear()
        if number % 100 == 0:
            wire.listener.poll(wire.now_ns)
            wire.listener.outbox.clear()
    _visit(wire, ("10.7.0.1", 0))
    assert len(wire.listener.dropped) <= MOST_NAMES
    return wire.listener.dropped


def _visit(wire: Wire, guest: Address) -> list[tuple[Address, bytes]]:
    """Nothing was delivered and nothing has grown; who is in does not notice, and who wants in gets in. The guest's traffic."""
    assert not wire.heard
    assert wire.listener.ready(ANNA)
    assert wire.listener.ready(BEN)  # still the seal that it was: nobody else has its keys
    assert not wire.listener.renewed
    assert wire.listener.counts()["half open"] <= MOST_UNSEATED
    assert _lib.ERR_peek_error() == 0
    wire.calls.pop(BEN, None)
    wire.talk(ANNA)
    wire.log.clear()
    wire.seats.add(guest)
    wire.now_ns += 3_000_000_000  # budgets fill up again
    wire.seal(guest)
    wire.talk(guest)
    said = [(address, datagram) for _, address, datagram in wire.log if address == guest]
    wire.calls.pop(guest)
    wire.answers.pop(guest)
    wire.seats.discard(guest)
    wire.listener.close(guest)
    wire.listener.outbox.clear()
    wire.log.clear()
    wire.heard.clear()
    return said


def fuzz_call(datagrams: int, folder: Path, seed: int) -> dict[str, int]:
    """Send mutated datagrams of a server to clients with and without an association. Returns the drops."""
    chance = random.Random(seed)
    wire = Wire(folder)
    said = [datagram for _, datagram in encrypted_traffic(wire)] + unencrypted_traffic()
    anna, calling, dropped = wire.calls[ANNA], wire.call(), dict[str, int]()
    wire.heard.clear()
    for number in range(datagrams):
        if number % 200 == 0:
            calling = wire.call(("10.8.0.1", number % 60_000))
            calling.poll(wire.now_ns)
            wire.calls = {ANNA: anna}
        wire.now_ns += FLOOD_NS
        datagram = mutated(chance, chance.choice(said), said)
        assert anna.receive(datagram, PEER, wire.now_ns) == ()
        assert calling.receive(datagram, PEER, wire.now_ns) == ()
        calling.poll(wire.now_ns)
        assert not calling.ready(PEER)
        assert all(20 <= left[0] <= 23 for _, left in calling.outbox)  # nothing leaves without a seal
        calling.outbox.clear()
        anna.outbox.clear()
        if number % 1000 == 0:
            dropped.update(calling.dropped)
            wire.talk(ANNA)
    assert not anna.failed
    assert _lib.ERR_peek_error() == 0
    wire.talk(ANNA)
    return {**dropped, **anna.dropped}


DOORS: dict[str, Callable[[int, Path, int], dict[str, int]]] = {
    "sealed": fuzz_encrypted,
    "open": partial(fuzz_encrypted, limited=False),  # the sealed one without budgets
    "plain": fuzz_unencrypted,
    "call": fuzz_call,  # the client's side of the sealed one
}
