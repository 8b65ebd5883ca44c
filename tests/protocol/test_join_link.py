"""The line that lets a person in: there and back, every word of refusal, and a secret that shows nowhere."""

import io
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from cogrip.protocol.wire import join_link
from cogrip.protocol.wire.join_link import JoinLink, LinkError, is_link, is_secret, parse_link, unwrapped
from cogrip.protocol.wire.messages import MOST_TOKEN

FINGERPRINT = "0123456789abcdef" * 4
TOKEN = "Kq7-_xZz09QWERTYuiopAw"
SECRET = f"{FINGERPRINT}.{TOKEN}"
LINK = f"cogrip://lab.example:47801/demo#{SECRET}"

parts = st.from_regex(r"[A-Za-z0-9_-]{1,100}", fullmatch=True)
tokens = st.one_of(
    st.from_regex(r"[A-Za-z0-9_-]{22}", fullmatch=True),
    st.tuples(parts, parts, parts).map(lambda three: "eyJ" + ".".join(three)),
)
rooms = st.from_regex(r"([A-Za-z0-9][A-Za-z0-9 ._-]{0,39})?", fullmatch=True)
hosts = st.one_of(
    st.from_regex(r"[a-z0-9_][A-Za-z0-9_.-]{0,9}", fullmatch=True),
    st.ip_addresses().map(str),
    st.sampled_from(["fe80::1%eth0", "fe80::1%25", "fe80::f%2525~x", "a" * 253]),
)
links = st.builds(JoinLink, hosts, st.integers(1, 65535), rooms, st.from_regex(r"[0-9a-f]{64}", fullmatch=True), tokens)


def read(text: str) -> JoinLink | LinkError:
    try:
        return parse_link(text)
    except LinkError as error:
        return error


@pytest.mark.parametrize("most", [MOST_TOKEN, MOST_TOKEN + 1])
def test_both_sides_of_the_longest_signed_token_in_the_longest_link(most: int) -> None:
    token = "a.b." + "c" * (most - 4)
    text = f"cogrip://{'h' * 253}:65535/{'%41' * 40}#{FINGERPRINT}.{token}"
    if most == MOST_TOKEN:
        assert parse_link(text).token == token
        return
    with pytest.raises(LinkError, match="the signed token has 641 characters, and must have three parts") as caught:
        parse_link(text)
    assert "ccc" not in str(caught.value)


@given(links)
def test_there_and_back(link: JoinLink) -> None:
    assert parse_link(link.text) == link
    assert parse_link(f"  {link.text}\n") == link
    assert parse_link(link.text.replace(link.fingerprint, link.fingerprint.upper())) == link
    assert link.text.isascii()
    assert " " not in link.text
    assert link.token not in repr(link)
    assert link.token not in str(link)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "a join link begins with cogrip://"),
        ("cogrip:/a/b", "a join link begins with cogrip://"),
        (LINK + "x" * 1200, "characters are more than 1200"),
        (LINK[:30] + "\n" + LINK[30:], "paste it as one line"),
        (LINK.replace("demo", "room B"), "a blank in a room is %20"),
        (LINK.partition("#")[0], "the part after # is missing: put the link in quotes"),
        (LINK.partition("#")[0] + "#", "the part after # is missing: put the link in quotes"),
        (LINK.partition(".Kq")[0], "must stand FINGERPRINT.TOKEN"),
        (LINK.replace("#0", "#"), "the fingerprint has 63 characters, and must have 64 hexadecimal digits"),
        (LINK.replace("#0", "#x"), "the fingerprint has other characters"),
        (LINK[:-1], "the token has 21 characters, and must have 22"),
        (LINK.replace("Kq7", "Kq+"), "the token has other characters"),
        (LINK + "#", "the token has 23 characters"),
        (LINK.replace("lab.example:47801", ""), "host: there is none"),
        (LINK.replace("lab.example", "lab!"), "'lab!'"),
        (LINK.replace("lab.example", "-lab"), "'-lab'"),
        (LINK.replace("47801", "٣"), "number from 1 to 65535"),
        (LINK.replace("47801", "1" * 5000), "characters are more than 1200"),
        (LINK.replace("lab.example", "2001:db8::7"), "an IPv6 address stands in brackets"),
        (LINK.replace("lab.example:47801", "[2001:db8::7"), "[ADDRESS]:PORT"),
        (LINK.replace("lab.example", "[192.0.2.7]"), "brackets are for IPv6"),
        (LINK.replace("lab.example", "[::g]"), "'::g': that is no IPv6 address"),
        (LINK.replace("lab.example", "[fe80::1%25a!]"), "no IPv6 address with a zone"),
        (LINK.replace("demo", "demo/"), "'demo/' is no room"),
        (LINK.replace("demo", "demo?x=1"), "'demo?x=1' is no room"),
        (LINK.replace("demo", "a" * 41), "at most 40 letters"),
        (LINK.replace("demo", "%ff"), "is no room"),
    ],
)
def test_what_is_wrong_is_said_and_nothing_secret(text: str, words: str) -> None:
    with pytest.raises(LinkError) as caught:
        parse_link(text)
    assert words in str(caught.value)
    assert not any(TOKEN[at : at + 6] in str(caught.value) for at in range(17))


@given(st.integers(0, len(LINK)), st.integers(0, 2), st.text(max_size=2))
def test_one_slip_never_shows_the_token(at: int, without: int, instead: str) -> None:
    said = repr(read(LINK[:at] + instead + LINK[at + without :]))
    assert not any(TOKEN[at : at + 6] in said for at in range(17))


@given(st.text(max_size=60), st.sampled_from(["", "cogrip://", "cogrip://a:1/", "cogrip://a:1/#", "cogrip://["]))
def test_any_text_is_refused_in_words(text: str, before: str) -> None:
    assert isinstance(read(before + text), LinkError)
    with suppress(LinkError):
        join_link.split_place(text)


def test_a_pretty_printer_shows_no_token() -> None:
    console = Console(file=io.StringIO(), width=500)
    console.print([parse_link(LINK)])
    assert TOKEN not in console.file.getvalue()  # type: ignore[attr-defined]


def test_what_is_meant_as_a_link() -> None:
    for text in (LINK, " Cogrip:/x", "https://lab.example", LINK.removeprefix("cogrip://"), f"#{SECRET}"):
        assert is_link(text)
    assert not any(map(is_link, ("127.0.0.1:47800", "cogrip")))


@given(links, st.sampled_from([40, 41, 64]))
def test_the_end_of_a_link_is_known(link: JoinLink, digits: int) -> None:
    for begin in (link.fingerprint[-digits:], link.fingerprint[:4], ""):
        text = f"{begin}.{link.token}"
        assert is_secret(text)
        assert is_secret(f"lab:4711/{text}")
    assert is_secret(link.fingerprint[:digits].upper())
    assert is_secret(TOKEN)


@pytest.mark.parametrize(
    "text",
    ["lab", "lab:47800", "192.0.2.7:47800", "[2001:db8::7]:1", "a" * 39, "laboratory.example.org", "a-machine-of-the-group",
     "My-Laboratory", f"lab.{'a' * 21}", f"lab.{'a' * 23}", f"lab.{'a' * 22}:47800"],
)  # fmt: skip
def test_a_place_is_not_taken_for_a_secret(text: str) -> None:
    assert not is_secret(text)


@given(
    st.sampled_from([LINK, "lab:47800", "[::1]:1"]),
    st.sampled_from(["", "cogrip join ", " cogrip  join\t", "Cogrip Join '"]),
    st.sampled_from([("", ""), ("'", "'"), ('"', '"'), ("<", ">"), (" “", "”\n"), ("`<", ">`"), ("'", "")]),
)
def test_what_stands_around_a_link_is_taken_off(text: str, command: str, around: tuple[str, str]) -> None:
    assert unwrapped(f"{around[0]}{command}{text}{around[1]}") == text
    assert unwrapped(f"{command}{around[0]}{text}{around[1]}") == text
    assert unwrapped(around[0] + around[1]) == ""


def test_a_place() -> None:
    assert join_link.split_place("lab") == ("lab", None)
    assert join_link.split_place("[::1]:65535") == ("::1", 65535)
    assert join_link.split_place("[fe80::1%eth0]") == ("fe80::1%eth0", None)
