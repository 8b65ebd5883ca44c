"""The tokens' file: nothing is lost by two writers or a killed one, and nothing is read that others could have changed."""

import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from cogrip.protocol.wire.join_link import JoinLink
from cogrip.server.admission.tokens import TokenBook, TokenError, encode_book, why_not
from cogrip.server.io import token_file
from cogrip.server.io.state_folder import StateError, StateFolder, make_folder
from cogrip.server.io.token_file import TokenFile, draw_token

WRITE = """
import os, signal, sys
from pathlib import Path
from cogrip.server.io import state_folder
from cogrip.server.io.token_file import TokenFile, draw_token
file, what = TokenFile(state_folder.find_folder(Path(sys.argv[1]))), sys.argv[2]
if what == "killed":
    Path.replace = lambda path, target: os.kill(os.getpid(), signal.SIGKILL)
print("ready", flush=True)
sys.stdin.readline()
for number in range(15):
    file.change(lambda book: book.new(draw_token(), 0, note=f"{what} {number}"))
"""


def writer(folder: StateFolder, what: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-c", WRITE, str(folder.path), what]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def notes(file: TokenFile) -> list[str]:
    return [token.note for token in file.load().tokens]


@pytest.fixture
def folder(tmp_path: Path) -> StateFolder:
    return make_folder(tmp_path / "state")


@pytest.fixture
def file(folder: StateFolder) -> TokenFile:
    return TokenFile(folder)


def add(file: TokenFile, note: str) -> str:
    return file.change(lambda book: book.new(draw_token(), 0, note=note)).id


def test_drawn_tokens_fit_a_link_and_differ() -> None:
    drawn = {draw_token() for _ in range(100)}
    assert len(drawn) == 100
    for token in drawn:
        JoinLink("a", 1, "", "0" * 64, token)


def test_it_begins_empty_and_private(file: TokenFile, folder: StateFolder) -> None:
    assert file.load() == TokenBook()
    assert file.stamp() is None
    before = os.umask(0)
    try:
        add(file, "one")
    finally:
        os.umask(before)
    assert notes(file) == ["one"]
    for path in (folder.tokens, folder.tokens_lock):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_its_stamp_tells_a_change_and_nothing_else(file: TokenFile) -> None:
    ident = add(file, "one")
    stamp = file.stamp()
    file.change(lambda book: (book, None))
    file.load()
    assert file.stamp() == stamp
    file.change(lambda book: (book.revoke(ident, 5), None))
    assert file.stamp() != stamp


def test_two_programs_that_write_at_once_lose_nothing(file: TokenFile, folder: StateFolder) -> None:
    with writer(folder, "left") as left, writer(folder, "right") as right:
        for each in (left, right):
            assert each.stdout is not None
            assert each.stdout.readline() == "ready\n"
        for each in (left, right):
            assert each.stdin is not None
            each.stdin.write("\n")
            each.stdin.flush()
    assert left.returncode == right.returncode == 0
    written = notes(file)
    assert len(written) == 30
    for name in ("left", "right"):
        assert [note for note in written if note.startswith(name)] == [f"{name} {number}" for number in range(15)]


def test_one_that_is_killed_before_it_replaces_leaves_the_old_file_and_no_lock(
    file: TokenFile, folder: StateFolder
) -> None:
    add(file, "one")
    before = folder.tokens.read_bytes()
    with writer(folder, "killed") as killed:
        killed.communicate("\n")
    assert killed.returncode == -signal.SIGKILL
    assert (folder.path / "tokens.json.new").stat().st_size > len(before), "it had written all of it"
    assert folder.tokens.read_bytes() == before
    add(file, "two")
    assert notes(file) == ["one", "two"]
    assert not (folder.path / "tokens.json.new").exists()


def test_an_edit_that_fails_changes_nothing(file: TokenFile) -> None:
    add(file, "one")
    stamp = file.stamp()
    with pytest.raises(TokenError):
        file.change(lambda book: (book.revoke("00000000", 0), None))
    assert file.stamp() == stamp
    add(file, "two")


def test_who_holds_the_lock_for_too_long_is_named(
    file: TokenFile, folder: StateFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(token_file, "LOCK_LIMIT_S", 0.0)
    with (
        token_file.locked(folder.tokens_lock, "busy"),
        pytest.raises(StateError, match="another program has been chang"),
    ):
        add(file, "one")
    assert file.load() == TokenBook()


CURE = "put back a good copy, or remove it together with server.key and server.crt: then all links are void"


@pytest.mark.parametrize(
    ("text", "mode", "words"),
    [
        (b"", 0o600, CURE),
        (b"{", 0o600, CURE),
        (b'{"version": 2, "tokens": []}', 0o600, CURE),
        (b"\x00" * 100, 0o600, CURE),
        (encode_book(TokenBook()), 0o640, "mode 0640, must be 0600"),
        (encode_book(TokenBook()), 0o604, "mode 0604, must be 0600"),
    ],
)
def test_a_file_that_is_damaged_or_that_others_may_read_is_refused_with_the_cure_and_left_as_it_is(
    file: TokenFile, folder: StateFolder, text: bytes, mode: int, words: str
) -> None:
    folder.tokens.write_bytes(text)
    folder.tokens.chmod(mode)
    for use in (file.load, lambda: add(file, "one")):
        with pytest.raises(StateError, match=words):
            use()
    assert folder.tokens.read_bytes() == text


def test_what_was_written_by_a_clock_before_1970_is_read_again(folder: StateFolder) -> None:
    file, then_s = TokenFile(folder), -86_400.5
    made = file.change(lambda book: book.new(draw_token(), then_s, once=True))
    file.change(lambda book: (book.use(made.id, then_s), None))
    file.change(lambda book: (book.revoke(made.id, then_s), None))
    (token,) = file.load().tokens
    assert (token.created, token.used, token.revoked) == (-86_400, -86_400, -86_400)
    assert why_not(token, 0.0) == "was revoked at 1969-12-31 00:00 UTC"
