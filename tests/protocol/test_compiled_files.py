"""Compiled modules that are older than their sources are found, whichever source it is, and no others."""

import os
from pathlib import Path

import pytest

from cogrip.protocol.io.compiled_files import SUFFIX, outdated


def at(path: Path, seconds: int) -> None:
    path.touch()
    os.utime(path, (seconds, seconds))


@pytest.mark.parametrize("suffix", [".py", ".pyx", ".pxd"])
def test_a_source_that_was_changed_later(tmp_path: Path, suffix: str) -> None:
    (tmp_path / "io").mkdir()
    at(tmp_path / "io" / f"ring{SUFFIX}", 1000)
    at(tmp_path / "io" / f"ring{suffix}", 1000)
    at(tmp_path / "interpreted.py", 5000)
    assert outdated([str(tmp_path)]) == []
    at(tmp_path / "io" / f"ring{suffix}", 1001)
    assert outdated([str(tmp_path)]) == ["ring"]
