"""Secrets in recordings: no token of a hello, and only the hash of a ticket."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.recording.secrets import without_secrets
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Heartbeat, Hello, Stamp, Welcome
from cogrip.protocol.wire.session import foreign_version, make_hello, nonce_of

TOKEN, TICKET = "token-of-22-characters", "ticket-22-characters-x"
HELLO = msgspec.structs.replace(
    make_hello(
        software="1", nonce=77, room="lab", name="anna", digest="", device="sim:x", axes=1, rate_hz=1e3, token=TOKEN
    ),
    ticket=TICKET,
)
WELCOME = Welcome(3, 7, 5, "d", "1", seat_settings(resolve({}), 0), TICKET)
SECRETS = (TOKEN.encode(), TICKET.encode())


def ticket_hash(ticket: str) -> str:
    return f"m{len(ticket)}"


def kept(message: bytes) -> bytes:
    out = without_secrets(message, ticket_hash)
    assert not any(secret in out for secret in SECRETS)
    return out


def test_a_hello_loses_its_token_and_keeps_a_mark_and_so_does_a_welcome() -> None:
    out = kept(messages.padded(HELLO))
    assert len(out) == messages.HELLO_BYTES
    read = messages.decode(out)
    assert isinstance(read, Hello)
    assert msgspec.structs.replace(read, padding=b"") == msgspec.structs.replace(HELLO, token="", ticket="m22")
    assert messages.decode(kept(messages.encode(WELCOME))) == msgspec.structs.replace(WELCOME, ticket="m22")


def test_a_signed_token_is_left_out_too() -> None:
    token = f"eyJ.{'s' * 550}.{'t' * 85}"
    out = without_secrets(
        messages.padded(msgspec.structs.replace(HELLO, token=token, device="sim:" + "x" * 196)), ticket_hash
    )
    assert b"sss" not in out
    assert b"ttt" not in out
    assert len(out) == messages.HELLO_BYTES


def test_what_holds_no_secret_is_kept_as_it_is() -> None:
    bare = messages.padded(msgspec.structs.replace(HELLO, token="", ticket=""))
    for message in (bare, messages.encode(Heartbeat(1, Stamp(1))), b"", b"\x90", b"\xdc", bytes(40), b"\x91\x01"):
        assert without_secrets(message, ticket_hash) == message


@pytest.mark.parametrize(
    "tag", [b"\x01", b"\xcc\x01", b"\xcd\x00\x01", b"\xd0\x01", b"\xd1\x00\x01", b"\xcf" + bytes(7) + b"\x01"]
)
@pytest.mark.parametrize("head", [b"\xdc\x00\x13", b"\xdd\x00\x00\x00\x13"])
def test_however_it_is_written(head: bytes, tag: bytes) -> None:
    plain = messages.padded(HELLO)
    assert plain[:4] == b"\xdc\x00\x13\x01"
    kept(head + tag + plain[4:])


@pytest.mark.parametrize("version", [0, 1, 3, 99, 2**53])
def test_a_hello_of_another_version_is_refused_the_same(version: int) -> None:
    theirs = messages.padded(msgspec.structs.replace(HELLO, version=version))
    theirs = theirs.replace(b"sim:x", b"\xa0\xa0\xa0\xa0\xc1")  # and what follows is another layout
    out = kept(theirs)
    assert len(out) == len(theirs)
    assert foreign_version(out) == foreign_version(theirs)
    assert nonce_of(out) == nonce_of(theirs)


@given(st.binary(max_size=12), st.integers(11, 1100), st.integers(0, 255))
def test_a_broken_hello_is_kept_without_them(junk: bytes, at: int, value: int) -> None:
    """Cut, lengthened, or with a byte after the magic changed: a core makes the same of what is kept."""
    whole = messages.padded(HELLO)
    for broken in (whole[:at], whole + junk, whole[:at] + bytes([value]) + whole[at + 1 :]):
        out = without_secrets(broken, ticket_hash)
        for secret in SECRETS:  # one that was broken itself is none any more
            assert secret not in out
        try:
            messages.decode(broken)
        except messages.MalformedError:
            assert foreign_version(out) == foreign_version(broken)
            with pytest.raises(messages.MalformedError):
                messages.decode(out)
