"""One association: packing, what peers it takes, what it says of those it does not, flights that are lost."""

import random
import time
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from OpenSSL import SSL

from cogrip.protocol.io import certificate, dtls
from cogrip.protocol.io.certificate import Identity
from cogrip.protocol.io.dtls import NO_CIPHER, NO_VERSION, OTHER_ERROR, WRONG_CERTIFICATE, cookie_in, error_text
from cogrip.protocol.secure import dtls_records
from cogrip.protocol.secure.dtls_records import ALERT
from cogrip.protocol.wire.messages import DTLS_BYTES, MAX_DATAGRAM_BYTES

from tests.fair_time import FairTime
from tests.protocol import foreign_peers
from tests.protocol.foreign_peers import DTLS1_0, Pair, client_side, foreign, long_identity, rsa_identity, server_side


@pytest.fixture(scope="module")
def identity(tmp_path_factory: pytest.TempPathFactory) -> Identity:
    return certificate.load(tmp_path_factory.mktemp("state"))


def ours(identity: Identity) -> Pair:
    return Pair(client_side(identity), server_side(identity))


def test_a_handshake(identity: Identity) -> None:
    pair = ours(identity).shake()
    assert pair.ready
    assert [len(flight) for flight in pair.flights] == [1, 1, 1, 1, 1, 1]
    first, _, second, *_ = [flight[0] for flight in pair.flights]
    assert [dtls.is_client_hello(flight[0]) for flight in pair.flights] == [True, False, True, False, False, False]
    assert (cookie_in(first), cookie_in(second)) == (b"", foreign_peers.COOKIE)
    assert pair.client.peer_fingerprint() == identity.fingerprint
    assert pair.server.peer_fingerprint() == ""
    connection = pair.client.connection
    assert connection.get_protocol_version() == dtls.DTLS1_2
    assert (connection.get_cipher_name() or "").startswith("ECDHE-ECDSA-AES")


@pytest.fixture(scope="module")
def pair(identity: Identity) -> Pair:
    return ours(identity).shake()


@given(messages=st.lists(st.binary(min_size=1, max_size=300), min_size=1, max_size=8))
def test_what_is_sent_is_what_comes_out(pair: Pair, messages: list[bytes]) -> None:
    datagrams = [pair.client.send(message) for message in messages]
    assert all(len(datagram) == len(m) + DTLS_BYTES for datagram, m in zip(datagrams, messages, strict=True))
    assert [message for datagram in datagrams for message in pair.server.feed(datagram)] == messages
    together = b"".join([pair.server.send(message) for message in messages])
    assert list(pair.client.feed(together)) == messages  # several records in one datagram are allowed


def test_nothing_is_sent_before_the_end_of_a_handshake_and_after_closing_which_is_heard(identity: Identity) -> None:
    pair = ours(identity)
    assert pair.client.send(b"x") == b""
    assert pair.client.feed(b"") == ()
    pair.shake()
    pair.client.close()
    pair.client.close()
    assert pair.client.send(b"x") == b""
    assert pair.client.feed(pair.server.send(b"y")) == ()
    (alert,) = pair.client.pop_datagrams()
    assert pair.server.feed(alert) == ()
    assert pair.server.failed == dtls.CLOSED


def test_flights_of_several_datagrams_in_any_order() -> None:
    long = long_identity()
    for seed in range(20):
        chance = random.Random(seed)

        def direction(_: int, datagrams: list[bytes], chance: random.Random = chance) -> list[bytes]:
            assert all(len(datagram) <= MAX_DATAGRAM_BYTES for datagram in datagrams)
            moved = datagrams + chance.sample(datagrams, len(datagrams) // 2)
            chance.shuffle(moved)
            return moved

        pair = ours(long).shake(direction)
        assert pair.ready
        assert len(pair.flights[3]) >= 4


def test_records_of_a_flight_one_by_one_and_the_certificate_s_in_reverse(identity: Identity) -> None:
    def direction(number: int, datagrams: list[bytes]) -> list[bytes]:
        apart = records(b"".join(datagrams))
        return apart[::-1] if number == 3 else apart  # a CCS that comes before its time is lost: it has no number

    pair = ours(identity).shake(direction)
    assert pair.ready
    assert list(pair.server.feed(pair.client.send(b"hello"))) == [b"hello"]


def records(flight: bytes) -> list[bytes]:
    return [flight[each.begin : each.end] for each in dtls_records.records(flight)]


def test_early_messages_wait_for_a_last_flight_that_is_late(identity: Identity) -> None:
    pair = ours(identity)
    late: list[bytes] = []

    def direction(number: int, datagrams: list[bytes]) -> list[bytes]:
        if number == 5:
            late.extend(datagrams)
            return []
        return datagrams

    pair.shake(direction)
    assert pair.server.ready
    assert not pair.client.ready
    early = pair.server.send(b"early")
    assert pair.client.feed(early) == ()
    (finished,) = late
    assert list(pair.client.feed(finished)) == [b"early"]
    assert pair.client.ready


def test_a_last_flight_that_is_lost_is_sent_again(identity: Identity) -> None:
    """The one test that waits for OpenSSL's own timer, of a client that does not begin anew as ours does: one second."""
    pair = ours(identity).shake(lambda number, datagrams: [] if number == 5 else datagrams)
    assert pair.server.ready
    assert not pair.client.ready
    waited = FairTime()
    again: list[bytes] = []
    while not again:
        assert waited.spent_s() < 30.0
        time.sleep(0.02)  # until the condition holds
        pair.client.poll()
        again = list(pair.client.pop_datagrams())
    assert pair.to_client(pair.to_server(again)) == []
    assert pair.client.ready
    assert list(pair.server.feed(pair.client.send(b"hello"))) == [b"hello"]


@pytest.mark.parametrize(
    ("options", "server_says", "client_says"),
    [
        ({"version": DTLS1_0}, NO_VERSION, NO_VERSION),
        ({"ciphers": b"ECDHE-ECDSA-AES128-SHA256"}, NO_CIPHER, NO_CIPHER),  # CBC
        ({"ciphers": b"ECDHE-RSA-AES128-GCM-SHA256"}, NO_CIPHER, NO_CIPHER),
        ({"ciphers": b"AES128-GCM-SHA256"}, NO_CIPHER, NO_CIPHER),  # no forward secrecy
        ({"ciphers": b"DHE-RSA-AES128-GCM-SHA256"}, NO_CIPHER, NO_CIPHER),
    ],
)
def test_clients_that_are_refused(
    identity: Identity, options: dict[str, object], server_says: str, client_says: str
) -> None:
    pair = Pair(foreign(**options), server_side(identity)).shake()  # type: ignore[arg-type]
    assert not pair.server.ready
    assert not pair.client.ready
    assert pair.server.failed == server_says
    assert pair.client.failed == client_says


def test_servers_that_are_refused(identity: Identity) -> None:
    old = Pair(client_side(identity), foreign(version=DTLS1_0, identity=identity)).shake()
    assert not old.client.ready
    assert not old.server.ready
    assert {old.client.failed, old.server.failed} <= {NO_VERSION, NO_CIPHER}
    blocks = foreign(ciphers=b"ECDHE-ECDSA-AES128-SHA256", identity=identity)
    assert Pair(client_side(identity), blocks).shake().client.failed == NO_CIPHER
    other_kind = Pair(client_side(identity), foreign(identity=rsa_identity())).shake()
    assert other_kind.client.failed == NO_CIPHER
    assert not other_kind.client.ready


def test_a_client_that_trusts_everyone_gets_in_by_the_allowed_ciphers_alone(identity: Identity) -> None:
    for cipher in dtls.CIPHERS.split(b":"):
        pair = Pair(foreign(ciphers=cipher), server_side(identity)).shake()
        assert pair.client.ready
        assert len(pair.client.send(b"x" * 100)) <= 100 + DTLS_BYTES


def test_another_certificate_is_refused_and_both_sides_hear_of_it(identity: Identity, tmp_path: Path) -> None:
    found: list[str] = []
    pair = Pair(dtls.client_context("0" * 64, found.append), server_side(identity)).shake()
    assert pair.client.failed == WRONG_CERTIFICATE
    assert pair.server.failed == dtls.NOT_TRUSTED
    assert set(found) == {identity.fingerprint}
    # The pinned certificate as the "issuer" of one's own proves nothing: the key of the first one is what is shown.
    context = foreign(identity=certificate.load(tmp_path))
    context.add_extra_chain_cert(identity.certificate)
    pair = Pair(client_side(identity), context).shake()
    assert pair.client.failed == WRONG_CERTIFICATE
    assert not pair.client.ready


@pytest.mark.parametrize("asks", ["client", "server"])
def test_renegotiation_is_refused(identity: Identity, asks: str) -> None:
    if asks == "client":
        pair = Pair(foreign(), server_side(identity)).shake()
        asking, asked = pair.client, pair.server
    else:
        pair = Pair(client_side(identity), foreign(identity=identity)).shake()
        asking, asked = pair.server, pair.client
    asking.connection.renegotiate()
    asking.connect()
    for datagram in asking.pop_datagrams():
        assert asked.feed(datagram) == ()
    assert all(datagram[0] == ALERT for datagram in asked.pop_datagrams())
    if not asked.failed:
        assert list(pair.server.feed(pair.client.send(b"on"))) in ([b"on"], [])
    assert asked.connection.total_renegotiations() == 0


def test_no_session_is_resumed(identity: Identity) -> None:
    context = foreign()
    context.set_session_cache_mode(SSL.SESS_CACHE_CLIENT)
    first = Pair(context, server_side(identity)).shake()
    session = first.client.connection.get_session()
    second = Pair(context, server_side(identity))
    if session is not None:
        second.client.connection.set_session(session)
    second.shake()
    assert second.client.ready
    assert len(second.flights) == 6  # all of it again
    assert first.client.connection.master_key() != second.client.connection.master_key()


@pytest.mark.parametrize("sizes", [(100,), (700, 500), (700, 600), (13,) * 100, (1219, 14, 1219), (2000, 20)])
def test_records_are_packed_whole(sizes: tuple[int, ...]) -> None:
    flight = [b"\x16\xfe" + bytes(9) + (size - 13).to_bytes(2, "big") + bytes(size - 13) for size in sizes]
    datagrams = dtls.packed(b"".join(flight))
    assert b"".join(datagrams) == b"".join(flight)
    for datagram in datagrams:
        assert len(datagram) <= MAX_DATAGRAM_BYTES or datagram in flight
        assert b"".join(records(datagram)) == datagram
    for one, next_one in pairwise(datagrams):
        assert len(one) + len(records(next_one)[0]) > MAX_DATAGRAM_BYTES


def test_words_are_of_a_bounded_number() -> None:
    assert error_text(SSL.Error([("SSL routines", "", "tlsv1 alert protocol version")])) == NO_VERSION
    assert error_text(SSL.Error([("SSL routines", "", "something new")])) == OTHER_ERROR
    assert error_text(ValueError()) == OTHER_ERROR
