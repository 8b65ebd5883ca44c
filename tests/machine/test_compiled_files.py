"""Compiled modules that are older than a source that they may have something of are found."""

import os
from pathlib import Path

import pytest

from cogrip.machine.compiled_files import SUFFIX, outdated


def at(path: Path, seconds: int) -> None:
    path.touch()
    os.utime(path, (seconds, seconds))


@pytest.mark.parametrize("suffix", [".py", ".pyx", ".pxd"])
def test_a_source_that_was_changed_later(tmp_path: Path, suffix: str) -> None:
    package, types = tmp_path / "package" / "io", tmp_path / "types" / "io"
    package.mkdir(parents=True)
    types.mkdir(parents=True)
    source = (package if suffix == ".py" else types) / f"ring{suffix}"
    at(package / f"ring{SUFFIX}", 1000)
    at(source, 1000)
    at(tmp_path / "package" / "interpreted.py", 1000)
    assert outdated([str(tmp_path / "package")], tmp_path / "types") == []
    at(source, 1001)
    assert outdated([str(tmp_path / "package")], tmp_path / "types") == ["ring"]


def test_a_constant_of_an_interpreted_module_may_stand_in_a_compiled_one(tmp_path: Path) -> None:
    package, other = tmp_path / "package", tmp_path / "other"
    package.mkdir()
    other.mkdir()
    at(other / "loop.py", 5000)  # nothing is compiled there
    at(package / "rates.py", 1001)
    folders = [str(package), str(other)]
    assert outdated(folders, tmp_path / "none") == []
    for name in ("ring", "clock"):
        at(package / f"{name}.py", 900)
    at(package / f"ring{SUFFIX}", 1000)
    at(package / f"clock{SUFFIX}", 2000)
    assert outdated(folders, tmp_path / "none") == ["rates"], "older than one of them"


def test_a_module_whose_library_is_gone(tmp_path: Path) -> None:
    """Modules share libraries: what lies at a module's place may be a link."""
    at(tmp_path / f"core{SUFFIX}", 1000)
    at(tmp_path / "core.py", 900)
    at(tmp_path / "ring.py", 900)
    (tmp_path / f"ring{SUFFIX}").symlink_to(f"core{SUFFIX}")
    assert outdated([str(tmp_path)], tmp_path / "none") == []
    (tmp_path / f"core{SUFFIX}").unlink()
    assert outdated([str(tmp_path)], tmp_path / "none") == ["ring"]
