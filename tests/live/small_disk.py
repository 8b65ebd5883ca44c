"""A disk of some megabytes, in memory, in a namespace of its own: it fills as a real one does."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

MOUNT = "mount -t tmpfs -o size={kib}k,mode=755 none {at} && echo mounted && exec cat"


class SmallDisk:
    """path: as processes of this test reach it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._ballast = path / "ballast"

    def fill(self) -> None:
        """Write until there is no room for a byte."""
        file = os.open(self._ballast, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        try:
            for piece in (1 << 16, 1 << 10, 1):
                with suppress(OSError):
                    while True:
                        os.write(file, bytes(piece))
        finally:
            os.close(file)

    def make_room(self) -> None:
        """Remove what filled it."""
        self._ballast.unlink()


@contextmanager
def small_disk(kib: int, at: Path) -> Iterator[SmallDisk]:
    """Mount one over the folder `at`, in a namespace of its own; the test is skipped where that is not allowed."""
    if sys.platform != "linux":
        pytest.skip("namespaces are Linux'")
    command = ["unshare", "-Urm", "sh", "-c", MOUNT.format(at=at, kib=kib)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as holder:
        assert holder.stdin is not None
        assert holder.stdout is not None
        try:
            if holder.stdout.readline() != b"mounted\n":
                pytest.skip("this system allows no file system of one's own")
            yield SmallDisk(Path(f"/proc/{holder.pid}/root{at}"))
        finally:
            holder.stdin.close()
