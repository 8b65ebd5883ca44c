"""The state folder: where it is, that nobody else may read it, and that one server has it."""

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from cogrip.machine import server_platform as platform
from cogrip.server.io import state_folder
from cogrip.server.io.state_folder import (
    NoStateError,
    ServerRecord,
    StateError,
    StateFolder,
    find_folder,
    locked,
    make_folder,
    one_server,
    read_private,
    read_server,
    state_path,
    write_private,
    write_server,
)

RECORD = ServerRecord("lab.example", 47800, "ab" * 32, {"demo": ["anna", "ben"], "wall": ["carl"]}, 4711)


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@pytest.fixture
def folder(tmp_path: Path) -> StateFolder:
    return make_folder(tmp_path / "state")


@pytest.mark.parametrize(
    ("given", "port", "environment", "path"),
    [
        (Path("here"), 0, {"STATE_DIRECTORY": "/a", "XDG_STATE_HOME": "/b"}, Path("here")),
        (None, 1, {"STATE_DIRECTORY": "/a:/c", "XDG_STATE_HOME": "/b"}, Path("/a")),
        (None, 0, {"STATE_DIRECTORY": "/a"}, Path("/a")),
        (None, 47800, {"STATE_DIRECTORY": "", "XDG_STATE_HOME": "/b"}, Path("/b/cogrip/47800")),
        (None, 7, {"XDG_STATE_HOME": "relative"}, Path.home() / ".local/state/cogrip/7"),
        (None, 7, {}, Path.home() / ".local/state/cogrip/7"),
        (None, 0, {"XDG_STATE_HOME": "/b"}, None),
    ],
)
def test_where_it_is(given, port, environment, path) -> None:
    assert state_path(given, port, environment) == path


def test_it_is_made_for_this_user_alone_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        folder = make_folder(tmp_path / "a" / "b")
        write_private(folder.server, b"{}")
        with one_server(folder):
            pass
    finally:
        os.umask(before)
    assert mode(folder.path) == 0o700
    assert mode(folder.server) == mode(folder.lock) == 0o600
    assert make_folder(folder.path).path == find_folder(folder.path).path == folder.path
    assert folder.checkpoint("demo") == tmp_path / "a" / "b" / "checkpoint-demo.bin"


@pytest.mark.parametrize("open_to", [0o710, 0o701, 0o740, 0o720, 0o777])
def test_a_folder_that_others_may_enter_is_refused(tmp_path: Path, open_to: int) -> None:
    tmp_path.chmod(open_to)
    for find in (find_folder, make_folder):
        with pytest.raises(StateError, match=rf"mode {open_to:04o}, must be 0700\); chmod 700 {tmp_path}"):
            find(tmp_path)
    tmp_path.chmod(0o700)
    find_folder(tmp_path)


@pytest.mark.parametrize("held", [False, True])
def test_only_of_a_folder_that_holds_something_secrets_may_be_known(tmp_path: Path, held: bool) -> None:
    if held:
        (tmp_path / "tokens.json").touch()
    tmp_path.chmod(0o755)
    with pytest.raises(StateError) as refused:
        make_folder(tmp_path)
    assert str(refused.value).endswith(state_folder.LEAKED if held else f"chmod 700 {tmp_path}")


def test_a_folder_of_another_user_is_refused(folder: StateFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: folder.path.stat().st_uid + 12345)
    with pytest.raises(StateError, match=r"belongs to user \S+, and this is \S+; run this as the former"):
        find_folder(folder.path)


def test_what_is_no_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NoStateError, match="there is no such folder; name that of your server by --state or --port"):
        find_folder(tmp_path / "none")
    (tmp_path / "file").touch()
    with pytest.raises(StateError, match="is no folder; name another one with --state"):
        find_folder(tmp_path / "file")
    with pytest.raises(StateError, match=r"cannot be made: .*; name another folder with --state"):
        make_folder(tmp_path / "file" / "below")


def test_a_system_without_modes_and_locks_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "POSIX", False)
    for use in (make_folder, find_folder):
        with pytest.raises(StateError, match=r"needs file modes and locks \(fcntl\) as Linux and macOS have them"):
            use(tmp_path)
    with pytest.raises(StateError, match="fcntl"), locked(tmp_path / "lock", "busy"):
        pass


# --- files ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("open_to", [0o640, 0o604, 0o620, 0o610, 0o666])
def test_a_file_that_others_may_read_is_refused(folder: StateFolder, open_to: int) -> None:
    write_private(folder.key, b"secret")
    folder.key.chmod(open_to)
    with pytest.raises(
        StateError, match=rf"mode {open_to:04o}, must be 0600\); chmod 600 \S+, and think whether"
    ) as caught:
        read_private(folder.key)
    assert "secret" not in str(caught.value).replace("its secrets", "")
    folder.key.chmod(0o400)
    assert read_private(folder.key) == b"secret"


def test_what_is_no_file_of_ours_is_refused(folder: StateFolder) -> None:
    with pytest.raises(FileNotFoundError):
        read_private(folder.key)
    os.mkfifo(folder.key, 0o600)  # must not make anyone wait
    with pytest.raises(StateError, match="is no file; move it away"):
        read_private(folder.key)
    write_private(folder.tokens, bytes(state_folder.MOST_BYTES))
    assert len(read_private(folder.tokens)) == state_folder.MOST_BYTES
    write_private(folder.tokens, bytes(state_folder.MOST_BYTES + 1))
    with pytest.raises(StateError, match="4194305 bytes are more than 4194304"):
        read_private(folder.tokens)


def test_a_file_is_replaced_as_a_whole_and_stays_private(folder: StateFolder) -> None:
    left_over = folder.path / "tokens.json.new"
    left_over.write_bytes(b"x" * 1000)
    left_over.chmod(0o644)
    for content in (b"one", b"two"):
        write_private(folder.tokens, content)
        assert mode(folder.tokens) == 0o600
        assert read_private(folder.tokens) == content
    assert [path.name for path in folder.path.iterdir()] == ["tokens.json"]


def test_a_link_that_lies_in_the_way_is_not_followed(folder: StateFolder, tmp_path: Path) -> None:
    (tmp_path / "other").write_text("kept")
    (folder.path / "tokens.json.new").symlink_to(tmp_path / "other")
    with pytest.raises(StateError, match="cannot be written"):
        write_private(folder.tokens, b"one")
    assert (tmp_path / "other").read_text() == "kept"


def test_a_full_disk_leaves_the_old_file(folder: StateFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    write_private(folder.tokens, b"one")

    def full(file: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StateError, match="cannot be written: No space left on device; make room"):
        write_private(folder.tokens, b"two")
    assert read_private(folder.tokens) == b"one"


# --- one server -------------------------------------------------------------------------------------------------------

HOLD = """
import sys
from pathlib import Path
from cogrip.server.io.state_folder import find_folder, one_server
with one_server(find_folder(Path(sys.argv[1]))):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_folder_has_one_server_until_it_is_killed(folder: StateFolder) -> None:
    held = [sys.executable, "-c", HOLD, str(folder.path)]
    with subprocess.Popen(held, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        try:
            assert other.stdout is not None
            assert other.stdout.readline() == "held\n"
            words = rf"another server uses {folder.path}: end it, or give this one a folder of its own with --state"
            with pytest.raises(StateError, match=words), one_server(folder):
                pass
        finally:
            other.kill()
    with one_server(folder), pytest.raises(StateError, match="another server uses"), one_server(folder):
        pass
    with one_server(folder):
        pass


def test_what_a_server_says_of_itself(folder: StateFolder) -> None:
    assert read_server(folder) is None
    write_server(folder, RECORD)
    assert read_server(folder) == RECORD
    assert mode(folder.server) == 0o600


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{}",
        '{"host":"a b","port":1,"fingerprint":"","rooms":{},"pid":1}',
        '{"host":"a","port":0,"fingerprint":"","rooms":{},"pid":1}',
        '{"host":"a","port":1,"fingerprint":"abc","rooms":{},"pid":1}',
        '{"host":"a","port":1,"fingerprint":"","rooms":["demo"],"pid":1}',
        '{"host":"a","port":1,"fingerprint":"","rooms":{},"pid":1,"more":1}',
    ],
)
def test_a_record_that_is_none_is_refused(folder: StateFolder, text: str) -> None:
    write_private(folder.server, text.encode())
    with pytest.raises(StateError, match=r"cannot be read as a server's record \(.*\); start the server again"):
        read_server(folder)
