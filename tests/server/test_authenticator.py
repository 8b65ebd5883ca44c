"""Authenticator of an encrypted server: the newest file, changes that hold at once, a broken book that ends no session."""

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from typing import Any

import pytest

from cogrip.protocol.wire.messages import MAGIC, PROTOCOL_VERSION, Hello
from cogrip.server.admission import tokens
from cogrip.server.admission.admission import Authenticator, Denied, Grant
from cogrip.server.admission.signed_tokens import LEEWAY_S
from cogrip.server.admission.tokens import READ_AT_ONCE, SPENT_S, TokenBook
from cogrip.server.events import EVENTS, ServerEvent
from cogrip.server.io.authenticator import TOO_MANY, TokenAuthenticator
from cogrip.server.io.state_folder import StateError, StateFolder, make_folder
from cogrip.server.io.token_file import TokenFile, draw_token
from cogrip.server.rate_limit import SIGNATURES

from tests.server.signers import FINGERPRINT, JTI, Signer

LIMIT_S = 20.0  # for what a thread is waited for
NOW_S = 1_800_000_000.0
USED = Denied("token", "this token was used already: it is good for one time; ask for a new link")
REVOKED = Denied("token", "this token was revoked at 2027-01-15 08:00 UTC; ask for a new link")


def hello(token: str, role: Any = "player", room: str = "") -> Hello:
    return Hello(MAGIC, PROTOCOL_VERSION, "", 1, room, "", "", "sim:", 3, 1e3, 8.5, 1.0, role, token)


class Bench:
    """A folder, its file, and authenticators with a virtual clock."""

    def __init__(self, folder: StateFolder, after: ExitStack) -> None:
        self.folder, self._after = folder, after
        self.file = TokenFile(folder)
        self.said: list[ServerEvent] = []
        self.now_s = NOW_S

    def authenticator(self) -> TokenAuthenticator:
        return self._after.enter_context(closing(TokenAuthenticator(self.file, self.said.append, lambda: self.now_s)))

    def new(self, **terms: Any) -> tuple[str, str]:
        """Token and id."""
        token = draw_token()
        return token, self.file.change(lambda book: book.new(token, NOW_S, **terms)).id

    def edit(self, edit: Callable[[TokenBook], TokenBook]) -> None:
        self.file.change(lambda book: (edit(book), None))

    def events(self) -> list[str]:
        return [each.event for each in self.said]


@pytest.fixture
def bench(tmp_path) -> Iterator[Bench]:
    with ExitStack() as after:
        bench = Bench(make_folder(tmp_path / "state"), after)
        yield bench
    assert set(bench.events()) <= set(EVENTS)


def test_what_was_made_after_the_start_is_known_at_the_next_hello(bench: Bench) -> None:
    authenticator: Authenticator = bench.authenticator()
    token, ident = bench.new(room="demo", user="anna")
    assert authenticator.admit(hello(token)) == Grant("player", ident, "demo", "anna")
    assert authenticator.admit(hello(token, "observer", "wall")) == Denied(
        "room", "this token is for room 'demo', not 'wall'; use the link as it is"
    )
    bench.edit(lambda book: book.revoke(ident, NOW_S))
    assert authenticator.admit(hello(token)) == REVOKED
    assert bench.said == []


def test_the_clock_decides_what_has_expired_and_each_end_is_told_once(bench: Bench) -> None:
    end_s = int(NOW_S) + 60
    (_, early), (_, used), (token, late) = [
        bench.new(expires=at_s, once=once) for at_s, once in ((int(NOW_S) - 1, False), (end_s, True), (end_s, False))
    ]
    authenticator = bench.authenticator()
    authenticator.admitted(Grant("player", used))  # used up: it expires all the same
    assert [authenticator.expired(), authenticator.expired()] == [{early}, set()]
    bench.now_s = end_s - 0.01
    assert isinstance(authenticator.admit(hello(token)), Grant)
    assert authenticator.expired() == set()
    bench.now_s = end_s
    expired = Denied("token", "this token has expired, at 2027-01-15 08:01 UTC; ask for a new link")
    assert authenticator.admit(hello(token)) == expired
    assert [authenticator.expired(), authenticator.expired()] == [{used, late}, set()]


def test_a_one_time_token_is_used_up_by_the_place_it_gave_not_by_asking(bench: Bench) -> None:
    token, ident = bench.new(once=True)
    authenticator = bench.authenticator()
    grant = authenticator.admit(hello(token))
    assert isinstance(authenticator.admit(hello(token)), Grant)
    assert isinstance(grant, Grant)
    authenticator.admitted(grant)
    assert authenticator.admit(hello(token)) == USED
    authenticator.close()
    assert bench.file.load().find(ident).used == NOW_S
    assert bench.authenticator().admit(hello(token)) == USED, "the next server knows too"


def test_a_token_that_was_good_for_one_time_still_resumes_its_session_until_it_ends(bench: Bench) -> None:
    end_s = int(NOW_S) + 60
    (once, ident), (_, other) = bench.new(once=True, expires=end_s), bench.new()
    authenticator = bench.authenticator()
    assert ident != other
    authenticator.admitted(Grant("player", ident))
    assert authenticator.admit(hello(once)) == USED
    assert authenticator.shown(hello(once)) == ident
    for nobody in ("", "x"):
        assert authenticator.shown(hello(nobody)) is None
    bench.now_s = end_s
    assert authenticator.shown(hello(once)) is None, "expired"
    bench.now_s = NOW_S
    authenticator.close()
    bench.edit(lambda book: book.revoke(ident, NOW_S))
    assert authenticator.shown(hello(once)) is None, "revoked in the file a moment ago"


def test_a_standing_token_writes_nothing(bench: Bench) -> None:
    token, _ = bench.new()
    authenticator, stamp = bench.authenticator(), bench.file.stamp()
    for _ in range(3):
        grant = authenticator.admit(hello(token))
        assert isinstance(grant, Grant)
        authenticator.admitted(grant)
    for nobody in ("", "00000000"):
        authenticator.admitted(Grant("player", nobody))
    authenticator.close()
    assert bench.file.stamp() == stamp


@pytest.mark.parametrize("again", ["reload", "another", "replaced"])
def test_a_use_that_cannot_be_written_holds_and_is_written_later(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, again: str
) -> None:
    """The tick does not wait for the disk."""
    (token, ident), (_, other) = bench.new(once=True), bench.new(once=True)
    authenticator, failed = bench.authenticator(), threading.Event()

    def full(edit: object, pause: object) -> None:
        failed.set()
        raise StateError("tokens.json: cannot be written: No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(bench.file, "change", full)
        authenticator.admitted(Grant("player", ident))
        assert authenticator.admit(hello(token)) == USED
        assert failed.wait(LIMIT_S)
    if again == "reload":
        assert authenticator.reload()
    elif again == "another":
        authenticator.admitted(Grant("player", other))
    else:
        bench.new()
        assert authenticator.admit(hello(token)) == USED
    authenticator.close()
    assert bench.file.load().find(ident).used == NOW_S
    assert authenticator.admit(hello(token)) == USED
    (trouble,) = [each.text for each in bench.said if each.event == "trouble"]
    assert trouble.startswith(
        "a token's use or end is not written down, and holds until this server ends: tokens.json:"
    )


def test_a_use_while_the_file_is_away_makes_no_empty_one(bench: Bench) -> None:
    token, ident = bench.new(once=True)
    authenticator, kept = bench.authenticator(), bench.folder.tokens.read_bytes()
    bench.folder.tokens.unlink()
    authenticator.admitted(Grant("player", ident))
    assert authenticator.admit(hello(token)) == USED
    authenticator.close()
    assert not bench.folder.tokens.exists()
    bench.folder.tokens.write_bytes(kept)
    bench.folder.tokens.chmod(0o600)
    assert authenticator.admit(hello(token)) == USED


def test_revoked_ids_are_reported_once_and_all_at_the_start(bench: Bench) -> None:
    (_, old), (token, new), (_, third) = bench.new(), bench.new(), bench.new()
    bench.edit(lambda book: book.revoke(old, NOW_S))
    authenticator = bench.authenticator()
    assert authenticator.revoked() == {old}, "a restored seat may have been taken by it"
    assert authenticator.revoked() == set()
    bench.edit(lambda book: book.revoke(new, NOW_S))
    assert authenticator.revoked() == set(), "nothing was read yet"
    assert authenticator.reload()
    assert authenticator.revoked() == {new}
    for each in (third, "00000000"):
        authenticator.revoke(each)
    assert authenticator.revoked() == {third}
    assert authenticator.revoked() == set()
    assert authenticator.admit(hello(token)) == REVOKED
    authenticator.close()
    assert bench.file.load().find(third).revoked == NOW_S
    assert [each.text for each in bench.said] == ["tokens were read again: 1 of 3 are good"]


@pytest.mark.parametrize("harm", ["damaged", "readable", "gone"])
def test_a_broken_book_puts_nobody_out_and_is_said_once_and_to_whoever_asks(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, harm: str
) -> None:
    token, ident = bench.new()
    authenticator, path = bench.authenticator(), bench.folder.tokens
    kept, loads, begin = path.read_bytes(), [], bench.file.begin
    monkeypatch.setattr(bench.file, "begin", lambda: loads.append(1) or begin())
    harms = {"damaged": lambda: path.write_bytes(b"{"), "readable": lambda: path.chmod(0o644), "gone": path.unlink}
    harms[harm]()
    answers: list[Grant | Denied] = []
    for _ in range(3):
        answers += [authenticator.admit(hello(token)), authenticator.admit(hello(token + "x"))]
        assert authenticator.revoked() == set()
    assert [type(answer) for answer in answers] == [Grant, Denied] * 3
    assert len(loads) == (harm != "gone")
    assert bench.events() == ["trouble"]
    for asked in (2, 3):
        assert not authenticator.reload()
        assert bench.events() == ["trouble"] * asked, "who asks is told, each time"
    authenticator.admit(hello(token))
    assert {each.text for each in bench.said} == {bench.said[0].text}
    assert bench.events() == ["trouble"] * 3
    bench.said[1:] = []
    assert "tokens are not read anew, and stay as they were" in bench.said[0].text
    assert str(path) in bench.said[0].text
    path.write_bytes(kept)
    path.chmod(0o600)
    bench.edit(lambda book: book.revoke(ident, NOW_S))
    assert authenticator.admit(hello(token)) == REVOKED
    path.write_bytes(b"{")
    assert authenticator.admit(hello(token)) == REVOKED
    assert bench.events() == ["trouble", "trouble"], "another breakage is another trouble"
    assert token not in repr(answers) + repr(bench.said)


MANY = 5 * READ_AT_ONCE + 7


@pytest.fixture
def decoded(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Sizes of the texts of all tokens that are decoded from now on."""
    found: list[int] = []
    decode = tokens._token_of
    monkeypatch.setattr(tokens, "_token_of", lambda text: found.append(len(text)) or decode(text))
    return found


def many(book: TokenBook) -> TokenBook:
    for number in range(MANY):
        book, _ = book.new(draw_token(), NOW_S, room=f"room {number % 7}")
    return book


def test_many_changes_are_decoded_between_ticks_and_hellos_wait(bench: Bench, decoded: list[int]) -> None:
    (token, ident), (late, late_ident) = bench.new(), bench.new()
    bench.edit(many)
    authenticator = bench.authenticator()
    authenticator.revoked()
    bench.edit(lambda book: many(book).revoke(late_ident, NOW_S))
    decoded.clear()
    for _ in range(3):  # a peer who asks again and again moves nothing
        assert authenticator.admit(hello(token)) is None
        assert len(decoded) == READ_AT_ONCE, "of those that are new"
    assert authenticator.shown(hello(token)) == ident, "who is here may resume"
    ticks = 0
    while authenticator.admit(hello(token)) is None:
        before, ticks = len(decoded), ticks + 1
        authenticator.read_on()
        assert len(decoded) - before <= READ_AT_ONCE
    assert len(decoded) == MANY + 1
    assert ticks == 5
    assert authenticator.admit(hello(token)) == Grant("player", ident)
    assert authenticator.admit(hello(late)) == REVOKED
    assert authenticator.revoked() == {late_ident}
    authenticator.read_on()
    assert len(decoded) == MANY + 1
    assert bench.said == []


def test_one_change_in_a_large_book_is_one_token_decoded_for_the_tick_and_for_the_thread(
    bench: Bench, decoded: list[int]
) -> None:
    (once, ident), (other, other_ident) = bench.new(once=True), bench.new()
    bench.edit(many)
    authenticator = bench.authenticator()
    TokenFile(bench.folder).change(lambda book: (book.revoke(other_ident, NOW_S), None))  # another process
    decoded.clear()
    assert authenticator.admit(hello(other)) == REVOKED
    assert len(decoded) == 1
    authenticator.admitted(Grant("player", ident))
    authenticator.close()  # the thread has read the file, and written it
    assert authenticator.admit(hello(once)) == USED
    assert len(decoded) == 2


def test_a_reload_of_many_changes_says_that_it_goes_on_and_reports_at_its_end(bench: Bench) -> None:
    bench.new()
    authenticator = bench.authenticator()
    bench.edit(many)
    assert authenticator.reload() is None
    for _ in range(4):
        authenticator.read_on()
    assert bench.said == []
    for _ in range(3):
        authenticator.read_on()
    assert [each.text for each in bench.said] == [f"tokens were read again: {MANY + 1} of {MANY + 1} are good"]


def test_damage_that_is_found_late_keeps_the_book_before(bench: Bench) -> None:
    token, ident = bench.new()
    authenticator = bench.authenticator()
    bench.edit(many)
    text = bench.folder.tokens.read_bytes()
    last = TokenFile(bench.folder).load().tokens[-1]
    bench.folder.tokens.write_bytes(text.replace(f'"id":"{last.id}"'.encode(), b'"id":"00000000"'))
    assert authenticator.reload() is None
    for _ in range(9):
        authenticator.read_on()
    (trouble,) = [each.text for each in bench.said]
    assert "token 00000000: its id is not the beginning of its hash" in trouble
    for _ in range(2):
        assert authenticator.admit(hello(token)) == Grant("player", ident)
    assert authenticator.reload() is False
    assert bench.events() == ["trouble", "trouble"], "who asks is told, each time"


def test_a_book_that_is_broken_from_the_start_is_an_error(bench: Bench) -> None:
    bench.folder.tokens.write_bytes(b"{")
    bench.folder.tokens.chmod(0o600)
    with pytest.raises(StateError, match="cannot be read as tokens"):
        bench.authenticator()


# --- signed tokens ----------------------------------------------------------------------------------------------------

UNI = Signer()
ANNA = Grant("player", JTI, "lab", "anna")


class SignedBench(Bench):
    """A bench whose server has one key; the clock of signatures does not move."""

    def authenticator(self) -> TokenAuthenticator:
        made = TokenAuthenticator(
            self.file, self.said.append, lambda: self.now_s, fingerprint=FINGERPRINT, clock_ns=lambda: 0
        )
        return self._after.enter_context(closing(made))


@pytest.fixture
def signed(tmp_path) -> Iterator[SignedBench]:
    with ExitStack() as after:
        bench = SignedBench(make_folder(tmp_path / "state"), after)
        bench.edit(lambda book: book.add_key(UNI.key()))
        yield bench


def test_a_key_that_was_added_is_known_at_the_next_hello_and_one_that_was_removed_ends_its_sessions(signed) -> None:
    other = Signer("next", seed=2)
    old, new = UNI.token(seat="anna"), other.token(jti="by-the-next-key")
    authenticator = signed.authenticator()
    assert authenticator.admit(hello(old)) == ANNA
    assert isinstance(authenticator.admit(hello(new)), Denied)
    signed.edit(lambda book: book.add_key(other.key()))
    assert isinstance(authenticator.admit(hello(new)), Grant)
    assert authenticator.revoked() == set()
    signed.edit(lambda book: book.remove_key("uni"))
    assert authenticator.reload()
    assert authenticator.revoked() == {JTI}
    assert authenticator.revoked() == set(), "told once"
    assert isinstance(authenticator.admit(hello(old)), Denied)
    assert authenticator.shown(hello(old)) is None
    assert isinstance(authenticator.admit(hello(new)), Grant)


def test_a_signed_token_is_revoked_in_the_file_or_by_a_kick_and_the_next_server_knows(signed) -> None:
    first, second = UNI.token(), UNI.token(jti="another-one")
    authenticator = signed.authenticator()
    for token in (first, second):
        assert isinstance(authenticator.admit(hello(token)), Grant)
        assert authenticator.shown(hello(token))
    signed.edit(lambda book: book.spend(JTI, "revoke", NOW_S + SPENT_S, NOW_S))
    assert authenticator.admit(hello(first)) == REVOKED
    assert authenticator.revoked() == {JTI}
    authenticator.revoke("another-one")
    assert authenticator.revoked() == {"another-one"}
    authenticator.close()
    after = signed.authenticator()
    assert after.revoked() == {JTI, "another-one"}, "a restored seat may have been taken by it"
    for token in (first, second):
        assert after.admit(hello(token)) == REVOKED
        assert after.shown(hello(token)) is None


def test_a_signed_token_for_one_time_is_used_up_by_the_place_it_gave(signed) -> None:
    token = UNI.token(once=True, seat="anna")
    authenticator = signed.authenticator()
    for _ in range(2):
        assert authenticator.admit(hello(token)) == ANNA, "asking uses nothing up"
    authenticator.admitted(ANNA)
    assert authenticator.admit(hello(token)) == USED
    assert authenticator.shown(hello(token)) == JTI
    authenticator.close()
    assert signed.file.load().spent[0].used == NOW_S
    assert signed.authenticator().admit(hello(token)) == USED, "the next server knows too"


def test_a_standing_signed_token_writes_nothing_and_its_end_ends_the_right_to_resume(signed) -> None:
    token = UNI.token()
    authenticator, stamp = signed.authenticator(), signed.file.stamp()
    grant = authenticator.admit(hello(token))
    assert isinstance(grant, Grant)
    authenticator.admitted(grant)
    signed.now_s = NOW_S + 600 + LEEWAY_S - 1
    assert authenticator.shown(hello(token)) == JTI
    signed.now_s += 1
    assert authenticator.shown(hello(token)) is None
    assert isinstance(authenticator.admit(hello(token)), Denied)
    authenticator.close()
    assert signed.file.stamp() == stamp


def test_a_flood_of_signatures_is_said_once_and_its_hellos_come_again(signed) -> None:
    authenticator = signed.authenticator()
    stranger = Signer(seed=9)
    answers = [
        authenticator.admit(hello(stranger.token(jti=f"wrong-token-{number}")))
        for number in range(SIGNATURES.burst + 5)
    ]
    assert answers[-6:].count(None) == 5
    assert [each.text for each in signed.said] == [TOO_MANY]


def test_signed_tokens_of_a_room_that_was_closed_are_void_also_once_its_name_is_given_again(signed) -> None:
    old, unseen, other = UNI.token(), UNI.token(jti="never-shown-here"), UNI.token(jti="of-another-room", room="hall")
    authenticator = signed.authenticator()
    assert isinstance(authenticator.admit(hello(old)), Grant)
    authenticator.revoke_room("lab")
    authenticator.revoke_room("lab")
    closed = Denied(
        "token", "this token was made before its room was closed, at 2027-01-15 08:00 UTC; ask for a new link"
    )
    for token in (old, unseen):
        assert authenticator.admit(hello(token)) == closed
        assert authenticator.shown(hello(token)) is None
    assert isinstance(authenticator.admit(hello(other)), Grant)
    authenticator.close()
    after = signed.authenticator()
    assert after.admit(hello(old)) == closed, "the next server knows too"
    signed.now_s = NOW_S + LEEWAY_S + 1
    at_s = int(signed.now_s)
    late = UNI.token(jti="made-afterwards", iat=at_s, exp=at_s + 60)
    assert isinstance(after.admit(hello(late)), Grant)
    assert isinstance(after.admit(hello(UNI.token(iat=at_s - 1, exp=at_s + 60))), Denied), "clocks may differ so much"
