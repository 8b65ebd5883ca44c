"""Fixtures of the server's tests: a state folder for each module, and an encrypted network on it."""

from pathlib import Path

import pytest

from tests.server.encrypted_network import Wire


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("state")


@pytest.fixture
def wire(folder: Path) -> Wire:
    return Wire(folder)
