"""Count of threads of the linear algebra: one, unless the user has set any of the variables."""

import os

import pytest

from cogrip.cli.main import main
from cogrip.machine.blas_threads import BLAS_THREADS


@pytest.mark.parametrize("set_by_user", ["", *BLAS_THREADS])
def test_the_number_of_threads_is_the_users_where_any_is_set(monkeypatch: pytest.MonkeyPatch, set_by_user: str) -> None:
    for name in BLAS_THREADS:
        monkeypatch.setenv(name, "")  # so that it is as it was, afterwards
        monkeypatch.delenv(name)
    if set_by_user:
        monkeypatch.setenv(set_by_user, "2")
    assert main(["--version"]) == 0
    found = {name: os.environ[name] for name in BLAS_THREADS if name in os.environ}
    assert found == ({set_by_user: "2"} if set_by_user else dict.fromkeys(BLAS_THREADS, "1"))
