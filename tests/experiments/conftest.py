"""Fixtures of comparisons."""

from collections.abc import Iterator

import pytest

from cogrip.experiments.methods import query

from tests.results.conftest import blank, finished, folder, summary  # noqa: F401


@pytest.fixture(scope="module")
def felt_once() -> Iterator[None]:
    """Probe the felt stiffness with one seed: it takes longer than a session."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(query, "FELT_SEEDS", 1)
        yield
