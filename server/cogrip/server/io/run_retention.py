"""Retention of the runs that servers leave: which of them go, by age and by size; a thread that removes them.

Only folders that a server made are removed, by the lock file that it leaves in each: no link, of this user, finished. A run is
under way while some process holds its lock, or writes one of its recordings. Whoever wants to keep a run removes its lock file.
"""

import os
import shutil
import stat
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from cogrip.machine import server_platform as platform
from cogrip.machine.addition import add_integers
from cogrip.machine.platform import system
from cogrip.protocol.io.recorder import is_being_written

LOCK = "serve.lock"
EVERY_S = 60.0
DAY_S = 86400.0
GB = 10**9


def mark_run(folder: Path) -> int:
    """Mark a run's folder as this server's, under way until the process ends or closes what is returned. Raises OSError."""
    # nobody may find a lock that is free; where no open file can be renamed, it is free for a moment
    new = folder / (f"{LOCK}.new" if system.RENAMES_OPEN_FILES else LOCK)
    file = os.open(new, os.O_RDWR | os.O_CREAT | platform.NO_LINK, 0o644)
    try:
        system.lock(file)
        if system.RENAMES_OPEN_FILES:
            new.replace(folder / LOCK)
    except OSError:
        os.close(file)
        raise
    return file


@dataclass(frozen=True, slots=True)
class LeftRun:
    """Run that a server left. ended_s: when its newest file was written [Unix s]."""

    folder: Path
    ended_s: float
    size_bytes: int
    finished: bool


def runs_below(base: Path) -> list[LeftRun]:
    """Return the runs right below `base` that servers of this user have left, the oldest first. Raises OSError."""
    return sorted(filter(None, map(_run, base.iterdir())), key=lambda run: run.ended_s)


def _run(folder: Path) -> LeftRun | None:
    lock = folder / LOCK
    with suppress(OSError):
        for path, is_kind in ((folder, stat.S_ISDIR), (lock, stat.S_ISREG)):
            found = path.lstat()
            if not is_kind(found.st_mode) or found.st_uid != platform.user_id():
                return None
        files = [(path, path.lstat()) for path in _files(folder)]
        written = any(is_being_written(path) for path, _ in files if path.suffix == ".mcap" or path == lock)
        # what files take on the disk, and where the system does not say it, what they hold
        sizes = add_integers(getattr(each, "st_blocks", each.st_size // 512) * 512 for _, each in files)
        return LeftRun(folder, max(each.st_mtime for _, each in files), sizes, not written)
    return None  # it has gone, or is not to be read


def _files(folder: Path) -> Iterator[Path]:
    for path, _, names in os.walk(folder):
        for name in names:
            yield Path(path, name)


def to_remove(runs: list[LeftRun], now_s: float, keep_s: float | None, keep_bytes: int | None) -> list[LeftRun]:
    """Return the finished runs that are older than `keep_s`, and the oldest ones while all are more than `keep_bytes`."""
    kept_bytes = add_integers(run.size_bytes for run in runs)
    chosen = []
    for run in runs:
        old = keep_s is not None and now_s - run.ended_s > keep_s
        much = keep_bytes is not None and kept_bytes > keep_bytes
        if run.finished and (old or much):
            chosen.append(run)
            kept_bytes -= run.size_bytes
    return chosen


class RunRetention:
    """Removes runs below `base` now and then, in a thread at ordinary priority. `begin` it before the loop takes real time.

    trouble  why more is kept than should be; "" where it is not
    """

    def __init__(self, base: Path, say: Callable[[str], None], keep_s: float | None, keep_bytes: int | None) -> None:
        self.trouble = ""
        self._base, self._say, self._keep_s, self._keep_bytes = base, say, keep_s, keep_bytes
        self._closing = threading.Event()

    def sweep(self, now_s: float) -> None:
        """Remove what is to go, and say so."""
        try:
            runs = runs_below(self._base)
        except OSError as error:
            self.trouble = f"{self._base}: cannot be read: {error.strerror}"
            return
        left, trouble = {run.folder: run for run in runs}, ""
        for run in to_remove(runs, now_s, self._keep_s, self._keep_bytes):
            try:
                shutil.rmtree(run.folder)
            except OSError as error:
                trouble = f"{error.filename or run.folder}: cannot be removed: {error.strerror}"
                continue
            del left[run.folder]
            self._say(f"{run.folder} was removed: {run.size_bytes / 1e6:.1f} MB, as --keep-days and --keep-gb ask for")
        held = add_integers(run.size_bytes for run in left.values())
        if not trouble and self._keep_bytes is not None and held > self._keep_bytes:
            trouble = f"{self._base}: {held / GB:.2f} GB are more than --keep-gb {self._keep_bytes / GB:g}, and still under way"
        self.trouble = trouble

    def begin(self) -> None:
        """Start the thread."""
        threading.Thread(target=self._run, name="retention of runs", daemon=True).start()

    def _run(self) -> None:
        while True:
            self.sweep(time.time())
            if self._closing.wait(EVERY_S):
                return

    def close(self) -> None:
        """Let the thread end."""
        self._closing.set()
