"""State folder of a server: keys, tokens, checkpoints, for its own user alone.

Linux and macOS. Every file is replaced as a whole, has mode 0600, and is not read if anyone else could.
"""

import errno
import os
import stat
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated

import msgspec

from cogrip.machine import server_platform as platform
from cogrip.machine.platform import system
from cogrip.protocol.wire.join_link import LinkError, check_host

FOLDER_MODE = 0o700
FILE_MODE = 0o600
SHARED = "shared"  # name of a link to the folder that the servers of a cluster share
MOST_BYTES = 4 * 2**20  # longest file that is read back
LEAKED = ", and think whether its secrets are known by now"  # end of a line about a file that may hold secrets
_LOOK_AGAIN_S = 0.005


class StateError(Exception):
    """The state folder, or a file in it, cannot be used. The text says why and what to do."""


class BusyError(StateError):
    """Another process holds it."""


class NoStateError(StateError):
    """There is no such folder."""


class StateFolder:
    """Paths of its files. See `make_folder` and `find_folder`.

    shared       folder of the key, tokens and checkpoints: another one where the server is one of a cluster
    tokens_lock  lock of a change of the tokens
    lock         lock of the one server that uses this folder
    """

    def __init__(self, path: Path) -> None:
        self.path, self.shared = path, path
        if (link := path / SHARED).is_symlink():
            self.shared = link.resolve()
        self.key, self.certificate = self.shared / "server.key", self.shared / "server.crt"
        self.tokens, self.tokens_lock = self.shared / "tokens.json", self.shared / "tokens.lock"
        self.control, self.lock, self.server = path / "control", path / "lock", path / "server.json"

    def checkpoint(self, room: str) -> Path:
        return self.shared / f"checkpoint-{room}.bin"


class ServerRecord(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Record of a server for the commands, `server.json`. It stays when the server ends."""

    host: str  # name or address by which people reach the server
    port: Annotated[int, msgspec.Meta(ge=1, le=65535)]
    # fingerprint of the certificate; "" unencrypted
    fingerprint: Annotated[str, msgspec.Meta(pattern=r"^([0-9a-f]{64})?\Z")]
    rooms: dict[str, list[str]]  # seats of each room, by its name
    pid: Annotated[int, msgspec.Meta(ge=1)]
    templates: dict[str, list[str]] = {}  # seats of the rooms on demand, by template


def state_path(state: Path | None, port: int, environment: Mapping[str, str] = os.environ) -> Path | None:
    """Return the state's path: `state`, else systemd's, else this user's folder for that port; None for port 0."""
    if state is not None:
        return state
    if given := environment.get("STATE_DIRECTORY", "").partition(":")[0]:
        return Path(given)
    if not port:
        return None
    base = Path(environment.get("XDG_STATE_HOME", ""))
    if not base.is_absolute():  # the XDG specification: to be ignored
        base = Path.home() / ".local" / "state"
    return base / "cogrip" / str(port)


def make_folder(path: Path) -> StateFolder:
    """Return the folder at `path`, made if need be. Raises StateError where it cannot be made or others could read it."""
    _need_posix()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileExistsError):
            path.mkdir(FOLDER_MODE)
    except OSError as error:
        raise StateError(f"{path}: cannot be made: {error.strerror}; name another folder with --state") from None
    return find_folder(path)


def find_folder(path: Path) -> StateFolder:
    """Return the folder at `path`. Raises NoStateError where there is none, StateError where others could read it."""
    _need_posix()
    try:
        found = path.stat()
    except FileNotFoundError:
        raise NoStateError(
            f"{path}: there is no such folder; name that of your server by --state or --port, or start the server first"
        ) from None
    except OSError as error:
        raise StateError(f"{path}: cannot be entered: {error.strerror}; run this as the server's user") from None
    if not stat.S_ISDIR(found.st_mode):
        raise StateError(f"{path}: is no folder; name another one with --state")
    _need_private(path, found, FOLDER_MODE)
    return StateFolder(path)


def share(folder: StateFolder, shared: Path | None) -> StateFolder:
    """Return the folder with the key, tokens and checkpoints in `shared`; with its own ones for None. Raises StateError."""
    link = folder.path / SHARED
    if shared is not None and folder.shared == shared.resolve() != folder.path:  # a full disk takes no other link
        make_folder(shared)
        return folder
    try:
        link.unlink(missing_ok=True)
        if shared is not None:
            link.symlink_to(make_folder(shared).path.resolve(), target_is_directory=True)
    except OSError as error:
        raise StateError(f"{link}: cannot be replaced: {error.strerror}; name another folder with --state") from None
    return StateFolder(folder.path)


def read_private(path: Path) -> bytes:
    """Return a file's content. Raises StateError where others could read or write it, FileNotFoundError for no file."""
    try:
        file = os.open(path, os.O_RDONLY | platform.NO_WAIT)
        with open(file, "rb") as stream:
            found = os.fstat(file)
            if not stat.S_ISREG(found.st_mode):
                raise StateError(f"{path}: is no file; move it away")
            _need_private(path, found, FILE_MODE)
            if found.st_size > MOST_BYTES:
                raise StateError(
                    f"{path}: {found.st_size} bytes are more than {MOST_BYTES}; it is none of ours, move it away"
                )
            return stream.read(MOST_BYTES)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise StateError(f"{path}: cannot be read: {error.strerror}; run this as the server's user") from None


def write_private(path: Path, content: bytes, *, durable: bool = True) -> None:
    """Replace a file as a whole: whatever ends this, the old one or the new one is there. One writer at a time (`locked`).

    durable: wait until the folder's entry is on the disk, too; else a loss of power may leave one of some seconds before.
    Raises StateError.
    """
    new = path.with_name(f"{path.name}.new")
    try:
        file = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | platform.NO_LINK, FILE_MODE)
        with open(file, "wb") as stream:
            platform.set_mode(file, FILE_MODE)  # of one that was left over
            stream.write(content)
            stream.flush()
            os.fsync(file)
        new.replace(path)
        if not durable:
            return
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as error:
        with suppress(OSError):
            new.unlink()  # a part of it keeps room from others
        raise StateError(f"{path}: cannot be written: {error.strerror}; make room or name another --state") from None


def overwrite_private(path: Path, content: bytes, at: int) -> None:
    """Overwrite a part of a file that is there, without waiting for the disk: whatever ends this, the rest stays as it is.

    at: first byte of that part. Raises FileNotFoundError for no file, StateError.
    """
    try:
        file = os.open(path, os.O_WRONLY | platform.NO_LINK)
        try:
            os.lseek(file, at, os.SEEK_SET)
            if os.write(file, content) < len(content):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        finally:
            os.close(file)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise StateError(f"{path}: cannot be written: {error.strerror}; make room or name another --state") from None


@contextmanager
def locked(path: Path, busy: str, limit_s: float = 0.0) -> Iterator[None]:
    """Hold the lock file `path`; the end of the process frees it.

    busy: text of the BusyError where another process has held it for `limit_s`
    """
    _need_posix()
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT | platform.NO_LINK, FILE_MODE)
    except OSError as error:
        raise StateError(f"{path}: cannot be opened: {error.strerror}; run this as the server's user") from None
    try:
        until_s = time.monotonic() + limit_s
        while True:
            try:
                system.lock(file)
                break
            except BlockingIOError:
                if time.monotonic() >= until_s:
                    raise BusyError(busy) from None
                time.sleep(_LOOK_AGAIN_S)
            except OSError as error:  # some network file systems have no locks
                raise StateError(
                    f"{path}: cannot be locked: {error.strerror}; name a folder on a local disk with --state"
                ) from None
        yield
    finally:
        os.close(file)


@contextmanager
def one_server(folder: StateFolder) -> Iterator[None]:
    """Hold a folder as its one server. Raises StateError where there is another."""
    busy = f"another server uses {folder.path}: end it, or give this one a folder of its own with --state"
    with locked(folder.lock, busy):
        yield


def write_server(folder: StateFolder, record: ServerRecord) -> None:
    """Write the record for the commands. Raises StateError."""
    write_private(folder.server, msgspec.json.format(msgspec.json.encode(record)) + b"\n")


def read_server(folder: StateFolder) -> ServerRecord | None:
    """Return the record of the last server here; None before the first. Raises StateError."""
    try:
        record = msgspec.json.decode(read_private(folder.server), type=ServerRecord)
        check_host(record.host)
    except FileNotFoundError:
        return None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError, LinkError) as error:
        raise StateError(
            f"{folder.server}: cannot be read as a server's record ({error}); start the server again, which writes it anew"
        ) from None
    return record


def _need_posix() -> None:
    if not platform.POSIX:
        raise StateError(
            f"{sys.platform}: a state folder needs file modes and locks (fcntl) as Linux and macOS have them; "
            "serve unencrypted on loopback, or run the server under Linux (WSL)"
        )


def _need_private(path: Path, found: os.stat_result, mode: int) -> None:
    mine = platform.user_id()
    if found.st_uid != mine:
        raise StateError(
            f"{path}: belongs to user {platform.user_name(found.st_uid)}, and this is {platform.user_name(mine)}; "
            "run this as the former, or name another folder with --state"
        )
    if found.st_mode & 0o077:
        known = "" if stat.S_ISDIR(found.st_mode) and not any(path.iterdir()) else LEAKED
        raise StateError(
            f"{path}: others may enter or read it (mode {stat.S_IMODE(found.st_mode):04o}, must be {mode:04o}); "
            f"chmod {mode:o} {path}{known}"
        )
