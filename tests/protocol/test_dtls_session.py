"""An association that another process goes on with, against OpenSSL's own client."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.io import certificate
from cogrip.protocol.io.dtls import CLOSED, Association
from cogrip.protocol.io.dtls_session import SUITES, WINDOW, DtlsSession, export_keys, newest_number, prf
from cogrip.protocol.secure.dtls_records import ALERT, RECORD_HEADER_BYTES
from cogrip.protocol.wire.messages import DTLS_BYTES, MAX_MESSAGE_BYTES

from tests.protocol.foreign_peers import Pair, client_side, server_side


@pytest.fixture(scope="module")
def identity(tmp_path_factory: pytest.TempPathFactory) -> certificate.Identity:
    return certificate.load(tmp_path_factory.mktemp("identity"))


def handed_over(identity: certificate.Identity, suite: str = "") -> tuple[Association, Association, DtlsSession]:
    """Return both ends of an association, and the session that goes on for the server after one message each way."""
    context = server_side(identity)
    if suite:
        context.set_cipher_list(suite.encode())
    pair = Pair(client_side(identity), context).shake()
    client, server = pair.client, pair.server
    assert server.ready
    assert client.ready
    hello = client.send(b"hello")
    assert server.feed(hello) == (b"hello",)
    welcome = server.send(b"welcome")
    assert client.feed(welcome) == (b"welcome",)
    keys = export_keys(server.connection, newest_number(welcome), newest_number(hello))
    assert repr(keys) == f"SessionKeys(suite={keys.suite!r})", "the keys do not show"
    return client, server, DtlsSession(keys)


@pytest.mark.parametrize("suite", SUITES)
def test_the_client_does_not_notice(identity: certificate.Identity, suite: str) -> None:
    client, _, session = handed_over(identity, suite)
    for size in (1, 17, 200, MAX_MESSAGE_BYTES):
        message = random.Random(size).randbytes(size)
        assert session.receive(client.send(message)) == [message]
        datagram = session.send(message)
        assert len(datagram) <= size + DTLS_BYTES
        assert client.feed(datagram) == (message,)
    with pytest.raises(ValueError, match="a record of 2048 bytes: at most 2047 fit"):
        session.send(bytes(2048))
    assert client.feed(session.send(longest := bytes(2047))) == (longest,), "and no number was left out"
    client.feed(session.close())
    assert client.failed == CLOSED


def test_each_record_is_taken_once_in_any_order_and_none_from_before(identity: certificate.Identity) -> None:
    client, server, session = handed_over(identity)
    datagrams = [client.send(bytes([number])) for number in range(1, 101)]
    shuffled = datagrams[:50]
    random.Random(1).shuffle(shuffled)
    came = [message for datagram in shuffled * 2 for message in session.receive(datagram)]
    assert sorted(came) == [bytes([number]) for number in range(1, 51)]
    assert session.receive(datagrams[99]) == [b"\x64"]
    assert session.receive(datagrams[60]) == [bytes([61])]
    late = client.send(b"late")
    for _ in range(WINDOW):
        newest = client.send(b"newest")
    assert session.receive(newest) == [b"newest"]
    assert session.receive(late) == [], "it is behind the window"
    assert session.receive(client.send(b"next")) == [b"next"]
    before = server.send(b"by the process that has handed over")
    assert session.receive(before) == [], "of the other direction: other keys"


@given(st.data())
def test_what_was_changed_is_dropped_and_changes_nothing(identity: certificate.Identity, data: st.DataObject) -> None:
    client, _, session = handed_over(identity)
    good = client.send(b"a message")
    place = data.draw(st.integers(0, len(good) - 1))
    bit = data.draw(st.integers(0, 7))
    bad = good[:place] + bytes([good[place] ^ 1 << bit]) + good[place + 1 :]
    assert session.receive(bad) == []
    assert session.receive(data.draw(st.binary(max_size=64))) == []
    assert not session.closed
    assert session.receive(good) == [b"a message"]


def test_closing_is_heard_and_an_alert_of_somebody_else_closes_nothing(identity: certificate.Identity) -> None:
    client, _, session = handed_over(identity)
    forged = bytes([ALERT]) + b"\xfe\xfd" + b"\x00\x01" + bytes(5) + b"\x09" + b"\x00\x1a" + bytes(26)
    assert len(forged) == RECORD_HEADER_BYTES + 26
    session.receive(forged)
    assert not session.closed
    client.close()
    for datagram in client.pop_datagrams():
        assert session.receive(datagram) == []
    assert session.closed


def test_prf_has_the_value_of_the_published_vector() -> None:
    """Vector of the TLS working group's list, "Test vectors for TLS 1.2 PRF", P_SHA256."""
    secret = bytes.fromhex("9bbe436ba940f017b17652849a71db35")
    seed = bytes.fromhex("a0ba9f936cda311827a6f796ffd5198c")
    block = prf("sha256", secret, b"test label", seed, 100)
    assert block.hex().startswith("e3f229ba727be17b8d122620557cd453c2aab21d07c3d495329b52d4e61edb5a")
