"""Tokens: whom they let in as what, until when, how often; and a book that is read exactly or not at all."""

import json
from dataclasses import dataclass
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.wire.join_link import JoinLink
from cogrip.server.admission import tokens
from cogrip.server.admission.admission import Denied, Grant
from cogrip.server.admission.tokens import (
    MOST_IN_BOOK,
    MOST_TOKENS,
    BookReading,
    Token,
    TokenBook,
    TokenError,
    UnknownTokenError,
    decode_book,
    derived_token,
    encode_book,
    token_hash,
)

NOW_S = 1_800_000_000.5
SECRET = b"k" * 32


@dataclass
class Made:
    """A book with one token, and the token."""

    book: TokenBook
    text: str
    id: str

    def ask(self, role: Any = "player", room: str = "demo", now_s: float = NOW_S) -> Grant | Denied:
        return self.book.admit(self.text, role, room, now_s)


def drawn(number: int) -> str:
    return derived_token(b"test", "player", "", number)


def made(number: int = 0, **terms: Any) -> Made:
    text = drawn(number)
    book, token = TokenBook().new(text, NOW_S, **terms)
    return Made(book, text, token.id)


# --- whom it lets in --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("terms", "role", "room", "answer"),
    [
        ({}, "player", "demo", ("player", "", "", "")),
        ({}, "player", "", ("player", "", "", "")),
        ({}, "observer", "demo", ("observer", "", "", "")),
        ({"role": "observer"}, "observer", "demo", ("observer", "", "", "")),
        ({"role": "observer"}, "player", "demo", ("observer", "", "", "")),
        ({"room": "demo"}, "player", "demo", ("player", "demo", "", "")),
        ({"room": "demo"}, "player", "", ("player", "demo", "", "")),
        ({"user": "anna", "device": "hid:woodenhaptics"}, "player", "", ("player", "", "anna", "hid:woodenhaptics")),
        ({"room": "demo", "user": "anna", "device": "hid:"}, "observer", "", ("observer", "demo", "", "")),
    ],
)
def test_a_good_token_is_granted_within_its_terms(terms, role, room, answer) -> None:
    asked = made(**terms)
    role_, room_, user, device = answer
    assert asked.ask(role, room) == Grant(role_, asked.id, room_, user, device)


@pytest.mark.parametrize(
    "guess", ["x" * 22, drawn(0)[:-1], drawn(0) + "A", drawn(0).swapcase(), "\ud800", "é" * 22, ""]
)
def test_a_wrong_token_a_missing_one_and_one_of_another_room_are_refused_in_words(guess: str) -> None:
    words = "this token is unknown here" if guess else "this server lets in only who has a token"
    asked = made(room="demo")
    assert asked.book.admit(guess, "observer", "", NOW_S) == Denied("token", f"{words}; ask for a new link")
    assert asked.ask(room="wall") == Denied("room", "this token is for room 'demo', not 'wall'; use the link as it is")


def test_it_expires_to_the_second() -> None:
    asked = made(expires=1_800_000_060)
    assert isinstance(asked.ask(now_s=1_800_000_059.999), Grant)
    gone = Denied("token", "this token has expired, at 2027-01-15 08:01 UTC; ask for a new link")
    assert asked.ask(now_s=1_800_000_060.0) == gone
    assert asked.ask(now_s=9e9) == gone
    assert asked.ask("observer", now_s=9e9) == gone


def test_a_one_time_token_is_good_for_one_time() -> None:
    asked = made(once=True)
    assert isinstance(asked.ask(), Grant)
    assert isinstance(asked.ask(), Grant), "asking alone does not use it up"
    asked.book = asked.book.use(asked.id, NOW_S + 1)
    used = Denied("token", "this token was used already: it is good for one time; ask for a new link")
    assert asked.ask() == used
    assert asked.ask("observer") == used
    assert asked.book.use(asked.id, NOW_S + 99) == asked.book, "the first use counts"
    assert asked.book.tokens[0].used == int(NOW_S) + 1
    standing = made()
    assert standing.book.use(standing.id, NOW_S) == standing.book


def test_a_revoked_token_says_so_whatever_else_ails_it() -> None:
    asked = made(once=True, expires=1_800_000_060)
    asked.book = asked.book.use(asked.id, NOW_S).revoke(asked.id, NOW_S + 5)
    gone = Denied("token", "this token was revoked at 2027-01-15 08:00 UTC; ask for a new link")
    assert asked.ask() == gone
    assert asked.ask(now_s=9e9) == gone
    assert asked.book.revoke(asked.id, 9e9) == asked.book, "the first date counts"


def test_a_token_is_found_among_many_by_its_hash_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """One hash is made, however many tokens there are: what a guess costs does not grow with the book."""
    book = TokenBook(tokens=tuple(
        msgspec.structs.replace(made().book.tokens[0], id=hashed[:8], hash=hashed)
        for hashed in map(token_hash, map(drawn, range(MOST_IN_BOOK)))
    ))  # fmt: skip
    assert isinstance(book.admit(drawn(0), "player", "", NOW_S), Grant)
    hashed: list[str] = []
    monkeypatch.setattr(tokens, "token_hash", lambda token: hashed.append(token) or token_hash(token))
    for number in (0, 1000, MOST_IN_BOOK - 1, MOST_IN_BOOK):
        assert isinstance(book.admit(drawn(number), "player", "", NOW_S), Grant) == (number < MOST_IN_BOOK)
    assert len(hashed) == 4
    revoked = book.revoke(book.tokens[7].id, NOW_S)
    assert isinstance(revoked.admit(drawn(7), "player", "", NOW_S), Denied)
    assert decode_book(encode_book(revoked)) == revoked


# --- making and finding -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("terms", "words"),
    [
        ({"role": "observer", "user": "anna"}, "an observer has neither seat nor device"),
        ({"role": "observer", "device": "hid:"}, "an observer has neither seat nor device"),
        ({"role": "king"}, "role: Invalid enum value 'king'"),
        ({"room": "a/b"}, "room: "),
        ({"room": "a" * 41}, "room: "),
        ({"user": " anna"}, "user: "),
        ({"device": "d" * 201}, "device: "),
        ({"device": "hid:\n"}, "device: "),
        ({"note": "bell \x07"}, "note: "),
        ({"note": "n" * 201}, "note: "),
        ({"expires": -1}, "expires: "),
        ({"expires": 10**15}, "expires: "),
    ],
)
def test_a_token_that_cannot_be_is_refused(terms, words) -> None:
    with pytest.raises(TokenError, match=words):
        made(**terms)


def test_an_id_is_given_once() -> None:
    one = made()
    with pytest.raises(TokenError, match=f"the id {one.id} is taken; draw another token"):
        one.book.new(one.text, NOW_S)


def test_an_unknown_id_is_answered_with_the_nearest() -> None:
    one = made()
    near = one.id[:-1] + ("0" if one.id[-1] != "0" else "1")
    for change in (one.book.revoke, one.book.use):
        with pytest.raises(UnknownTokenError, match=f"no token has the id {near}; did you mean {one.id}?"):
            change(near, NOW_S)
    with pytest.raises(UnknownTokenError, match=r"`cogrip token list` shows those there are"):
        TokenBook().revoke(near, NOW_S)


def test_the_oldest_dead_tokens_make_room_and_no_others() -> None:
    book, _ = TokenBook().standing(SECRET, ["demo"], NOW_S)
    start = [token.id for token in book.tokens]
    book = book.revoke(start[0], NOW_S)
    for number in range(MOST_TOKENS - 2):
        book, _ = book.new(drawn(number), NOW_S, room="demo")
    assert len(book.tokens) == MOST_TOKENS
    for room, of in (("", "for any room"), ("wall", "for room wall")):  # each has its own
        other = book
        for number in range(MOST_TOKENS):
            other, _ = other.new(drawn(1000 + number), NOW_S, room=room)
        with pytest.raises(
            TokenError, match=f"there are {MOST_TOKENS} tokens {of}, and at most {MOST_TOKENS} are kept"
        ):
            other.new(drawn(1999), NOW_S, room=room)
    words = f"there are {MOST_TOKENS} tokens for room demo, and at most {MOST_TOKENS} are kept; revoke some first"
    with pytest.raises(TokenError, match=words):
        book.new(drawn(MOST_TOKENS), NOW_S, room="demo")
    dead = book.tokens[200].id
    book, new = book.revoke(dead, NOW_S).new(drawn(MOST_TOKENS), NOW_S, room="demo")
    ids = [token.id for token in book.tokens]
    assert len(ids) == MOST_TOKENS
    assert dead not in ids
    assert ids[:2] == start, "a revoked start link is remembered"
    assert ids[-1] == new.id


# --- links that a start prints ----------------------------------------------------------------------------------------


def test_every_start_prints_the_same_links_and_keeps_hashes_only() -> None:
    book, links = TokenBook().standing(SECRET, ["demo", "wall"], NOW_S)
    assert [(link.role, link.room) for link in links] == [
        ("player", "demo"), ("observer", "demo"), ("player", "wall"), ("observer", "wall"),
    ]  # fmt: skip
    assert len({link.token for link in links}) == 4
    for link in links:
        JoinLink("a", 1, link.room, "0" * 64, link.token)
        assert book.admit(link.token, link.role, link.room, NOW_S) == Grant(link.role, link.id, link.room)
        assert link.token not in encode_book(book).decode()
        assert link.token not in repr(link)
    assert book.standing(SECRET, ["demo", "wall"], NOW_S + 9) == (book, links)
    assert [link.token for link in TokenBook().standing(SECRET, ["wall"], 0.0)[1]] == [link.token for link in links[2:]]
    assert {link.token for link in TokenBook().standing(b"other", ["demo"], NOW_S)[1]}.isdisjoint(
        link.token for link in links
    )


def test_a_revoked_start_link_has_a_successor_and_never_comes_back() -> None:
    book, (player, observer) = TokenBook().standing(SECRET, ["demo"], NOW_S)
    seen = {player.token}
    for _ in range(3):
        book = book.revoke(player.id, NOW_S)
        gone = player
        book, (player, same) = book.standing(SECRET, ["demo"], NOW_S)
        assert same == observer
        assert player.token not in seen
        seen.add(player.token)
        assert isinstance(book.admit(gone.token, "player", "demo", NOW_S), Denied)
        assert isinstance(book.admit(player.token, "player", "demo", NOW_S), Grant)
    assert len(book.tokens) == 5


# --- the file's text --------------------------------------------------------------------------------------------------

seconds = st.integers(0, 253_402_300_799)
hashes = st.binary(min_size=32, max_size=32).map(bytes.hex)
names = st.sampled_from(["", "demo", "room B.2", "a" * 40])


def _token(digest: str, **fields: Any) -> Token:
    return Token(id=digest[:8], hash=digest, **fields)


books = st.lists(
    st.builds(
        _token, hashes, role=st.sampled_from(["player", "observer"]), room=names, user=names,
        device=st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=40),
        once=st.booleans(), start=st.booleans(),
        expires=st.none() | seconds, created=seconds, used=st.none() | seconds, revoked=st.none() | seconds,
        note=st.text(st.characters(exclude_categories=["Cc", "Cs"]), max_size=40),
    ),
    max_size=5, unique_by=lambda token: token.id,
).map(lambda tokens: TokenBook(tokens=tuple(tokens)))  # fmt: skip


@given(books)
def test_a_book_there_and_back(book: TokenBook) -> None:
    assert decode_book(encode_book(book)) == book


@given(books, st.text(max_size=22), st.sampled_from(["player", "observer"]), names, st.floats(0, 1e10))
def test_any_book_answers_any_hello(book: TokenBook, token: str, role: Any, room: str, now_s: float) -> None:
    assert isinstance(book.admit(token, role, room, now_s), Denied)


@given(books, books, st.integers(1, 3))
def test_a_book_read_in_parts_with_what_is_known_is_the_book(before: TokenBook, added: TokenBook, most: int) -> None:
    first = BookReading(encode_book(before))
    first.read(first.left)
    known = {token.id for token in before.tokens}
    news = tuple(token for token in added.tokens if token.id not in known)
    book = TokenBook(tokens=(*news, *before.tokens))
    reading = BookReading(encode_book(book), first.texts)
    for left in range(len(news), 0, -most):
        assert reading.left == left, "nothing of before is decoded again"
        reading.read(most)
    assert reading.left == 0
    assert reading.book() == book


def table(**changes: Any) -> dict[str, Any]:
    whole: dict[str, Any] = json.loads(encode_book(made().book))
    whole["tokens"][0].update(changes)
    return whole


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "truncated"),
        ("{}", "version = None, and this cogrip knows 1"),
        ("[]", "Expected `object`"),
        ('{"version": 2, "tokens": []}', "version = 2, and this cogrip knows 1"),
        ('{"version": true, "tokens": []}', "version = True"),
        ('{"version": "1", "tokens": []}', "version = '1'"),
        ('{"version": 1, "tokens": [], "more": 1}', "unknown field `more`"),
        ('{"version": 1, "tokens": {}}', "tokens: "),
        (b"\xff\xfe", "malformed"),
        (b'{"version": 1, "tokens": [{"id": "\xff"}]}', "utf-8|malformed"),
        ("[" * 100_000, "Expected `object`"),
        ('{"version": ' + "[" * 100_000, "recursion|Stack overflow|malformed|truncated"),
        (json.dumps(table())[:-3], "truncated"),
        (json.dumps(table(hash="0" * 64)), "its id is not the beginning of its hash"),
        (json.dumps(table(hash="0" * 63)), "hash: "),
        (json.dumps(table(role="king")), r"tokens\[0\].role: "),
        (json.dumps(table(once=None)), "once: "),
        (json.dumps(table(once=0)), "once: "),
        (json.dumps(table(expires=1.5)), "expires: "),
        (json.dumps(table(revoked="yes")), "revoked: "),
        (json.dumps(table(room="../x")), "room: "),
        (json.dumps(table(weird=1)), "unknown field `weird`"),
    ],
)
def test_a_text_that_is_not_exactly_a_book_is_refused(text: str | bytes, words: str) -> None:
    with pytest.raises(TokenError, match=words):
        decode_book(text if isinstance(text, bytes) else text.encode())


@pytest.mark.parametrize("field", Token.__struct_fields__)
def test_a_field_that_is_missing_never_widens_a_token(field: str) -> None:
    whole = table()
    del whole["tokens"][0][field]
    with pytest.raises(TokenError, match=f"missing required field `{field}`"):
        decode_book(json.dumps(whole).encode())


def test_a_token_may_not_stand_twice() -> None:
    whole = table()
    whole["tokens"] *= 2
    with pytest.raises(TokenError, match="stands twice"):
        decode_book(json.dumps(whole).encode())


@given(st.binary(max_size=200))
def test_no_bytes_break_the_reader(data: bytes) -> None:
    with pytest.raises(TokenError):
        decode_book(data)
