"""The client in C, compiled once for all its tests."""

from pathlib import Path
from typing import Any

import pytest

from tests.clients.compiled import build, load


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder for what is compiled."""
    return tmp_path_factory.mktemp("c")


@pytest.fixture(scope="session")
def library(built: Path) -> Any:
    """Return the client without its driver, as a shared library."""
    return load(build(built, "probe.so", "-O1", "-fPIC", "-shared", "-DCOGRIP_NO_DRIVER", "probe.c"))
